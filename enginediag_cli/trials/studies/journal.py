"""The journal of a study: finished batches, one JSON line each, from which an interrupted study goes on.

The first line says which study it is: a journal of another one, or of one that was changed since, is refused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from enginediag_cli import __version__
from enginediag_cli.errors import DataError
from enginediag_cli.trials.json_lines import append, parsed, rewrite
from enginediag_cli.trials.studies.batches import Batch
from enginediag_cli.trials.studies.study_file import Study
from enginediag_cli.trials.studies.tally import Tally

Finished = dict[Batch, dict[str, Tally]]


def study_key(study: Study, seed: int, repetitions: int | None) -> str:
    """Hash of all that the result depends on: program version, study file, engine file, seed and repetitions."""
    digest = hashlib.sha256(f"{__version__} {seed} {repetitions}".encode())
    for path in (study.path, Path(study.monitor.engine.path)):  # type: ignore[attr-defined]
        digest.update(b"\0" + path.read_bytes())
    return digest.hexdigest()


class Journal:
    """A file to which finished batches are added, each at once and to stay."""

    def __init__(self, path: Path, key: str):
        self.path, self._key = path, key

    def read(self) -> Finished:
        """Batches finished before; none when there is no file. A last line cut short is dropped.

        Raises DataError when the file is the journal of another study, or no journal.
        """
        if not self.path.exists() or not self.path.stat().st_size:
            return {}
        lines = self.path.read_text(encoding="utf-8").split("\n")
        whole, cut = lines[:-1], lines[-1]
        head = parsed(whole[0]) if whole else None
        if head is None or "study" not in head:
            raise DataError(f"{self.path}: not the journal of a study; name another one with --journal")
        if head["study"] != self._key:
            raise DataError(
                f"{self.path}: the journal of another study, or of this one before it was changed; "
                "remove it or name another one with --journal"
            )
        if cut:
            rewrite(self.path, whole)
        finished: Finished = {}
        for number, line in enumerate(whole[1:], start=2):
            entry = parsed(line)
            try:
                assert entry is not None
                finished[Batch(*entry["batch"])] = {n: Tally.from_json(v) for n, v in entry["methods"].items()}
            except (AssertionError, KeyError, TypeError, AttributeError):
                raise DataError(f"{self.path}:{number}: not a line of a journal") from None
        return finished

    def add(self, batch: Batch, tallies: Mapping[str, Tally]) -> None:
        """Append one batch and see it on the disk."""
        new = not self.path.exists() or not self.path.stat().st_size
        head = [json.dumps({"study": self._key})] if new else []
        entry = {
            "batch": [batch.case, batch.first, batch.count],
            "methods": {name: one.as_json() for name, one in tallies.items()},
        }
        append(self.path, *head, json.dumps(entry))
