"""Which recordings are meant: files, the recorder that maps them, the one engine that is wanted."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from enginediag_cli.errors import DataError

STDIN = "-"
"""A file's name that stands for standard input."""


@dataclass(frozen=True)
class Source:
    """`files` as given, "-" for standard input; `recorder`: recorder file of foreign recordings, if they are;
    `engine_instance`: use only this engine of the recordings, "" for all; `accept_mismatch`: go on with a recording
    that cannot be of the engine, or in these units."""

    files: tuple[str, ...]
    recorder: str | None = None
    engine_instance: str = ""
    accept_mismatch: bool = False

    @property
    def configs(self) -> list[str]:
        """Files beside the recordings that a result depends on."""
        return [self.recorder] if self.recorder else []

    @property
    def notes(self) -> Mapping[str, str]:
        """Choices that a result depends on, for its provenance."""
        found = {"engine instance": self.engine_instance} if self.engine_instance else {}
        return found | ({"mismatch": "accepted"} if self.accept_mismatch else {})

    def label(self, file: str) -> str:
        """How a file is called: without its folder, unless two files would be called alike."""
        if file == STDIN:
            return "stdin"
        name = os.path.basename(file)
        return name if [os.path.basename(f) for f in self.files].count(name) == 1 else file


def refuse_repeated(files: Sequence[str]) -> None:
    """Raises DataError when two of the files are the same one, or have the same bytes: what a recording says would
    count twice. Pipes are not looked into."""
    by_size: dict[int, list[str]] = {}
    for file in files:
        path = Path(file)
        if file != STDIN and path.is_file() and os.access(file, os.R_OK) and path.stat().st_size:
            by_size.setdefault(path.stat().st_size, []).append(file)
    for alike in by_size.values():
        seen: dict[str, str] = {}
        for file in alike if len(alike) > 1 else []:
            first = seen.get(digest := _digest(file))
            if first is not None:
                same = "are the same file" if os.path.samefile(first, file) else "hold the same bytes"
                raise DataError(f"{first} and {file} {same}: what they say would count twice; give one of them")
            seen[digest] = file


def _digest(file: str) -> str:
    from enginediag_cli.recordings.provenance import sha256_of

    return sha256_of(file)
