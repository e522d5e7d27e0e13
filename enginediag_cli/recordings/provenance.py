"""The `#` lines at the head of a file: which program, command, configuration and seed made it.

The same run gives the same bytes, so there is no time stamp unless the caller adds one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from enginediag_cli import __version__


def header_lines(
    command: str = "",
    *,
    seed: int | None = None,
    configs: Iterable[str | Path] = (),
    notes: Mapping[str, str] | None = None,
    inherited: Sequence[str] = (),
) -> tuple[str, ...]:
    """Lines without the `#`: tool, command, seed, configuration files with their hashes, notes `key: text`.

    inherited: the provenance of the file that was read; it is kept, indented, below. Files are named without
    their folder, so that the bytes do not depend on where the project lies.
    """
    lines = [f"enginediag: {__version__}"]
    if command:
        lines.append(f"command: {command}")
    if seed is not None:
        lines.append(f"seed: {seed}")
    lines += [f"config: {Path(path).name} sha256:{file_sha256(path)[:16]}" for path in configs]
    lines += [f"{key}: {text}" for key, text in {**current_notes(), **(notes or {})}.items()]
    if inherited:
        lines.append("input:")
        lines += [f"  {line}" for line in inherited]
    return tuple(" ".join(line.splitlines()) for line in lines)


class _CurrentNotes:
    """Settings of the present run that are not on its command line."""

    notes: Mapping[str, str] = {}


@contextmanager
def provenance_notes(notes: Mapping[str, str]) -> Iterator[None]:
    """Within it, notes that every header has: options on which results depend, and that a file or the environment
    gives."""
    before, _CurrentNotes.notes = _CurrentNotes.notes, dict(notes)
    try:
        yield
    finally:
        _CurrentNotes.notes = before


def current_notes() -> dict[str, str]:
    """The notes of `provenance_notes`, for what has a head of its own."""
    return dict(_CurrentNotes.notes)


def file_sha256(path: str | Path) -> str:
    """Hexadecimal SHA-256 of a file's bytes. Raises OSError."""
    import hashlib

    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        for block in iter(lambda: stream.read(1 << 20), b""):
            digest.update(block)
    return digest.hexdigest()
