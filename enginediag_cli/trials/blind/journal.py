"""The journal of blind trials: one JSON line a trial, from which an interrupted run goes on.

The first line says what was run: a journal of another plan, or of the plan before the engine file was changed, is
refused.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from enginediag_cli import __version__
from enginediag_cli.errors import DataError
from enginediag_cli.trials.blind.trial import Plan
from enginediag_cli.trials.json_lines import append, parsed, rewrite


def plan_key(plan: Plan) -> str:
    """Hash of all that a trial depends on but its number."""
    said = f"{__version__} {plan.seed} {plan.truths} {plan.kinds} {plan.false_alarm}"
    digest = hashlib.sha256(said.encode())
    digest.update(b"\0" + Path(plan.engine).read_bytes())
    return digest.hexdigest()


class Journal:
    """A file to which finished trials are added, each at once and to stay."""

    def __init__(self, path: Path, key: str):
        self.path, self._key = path, key

    def read(self) -> dict[int, dict[str, Any]]:
        """Trials finished before, by number; none when there is no file. A last line cut short is dropped.

        Raises DataError when the file is the journal of another plan, or no journal.
        """
        if not self.path.exists() or not self.path.stat().st_size:
            return {}
        lines = self.path.read_text(encoding="utf-8").split("\n")
        whole = lines[:-1]
        head = parsed(whole[0]) if whole else None
        if head is None or "plan" not in head:
            raise DataError(f"{self.path}: not a file of trials; name another one with --trials-output")
        if head["plan"] != self._key:
            raise DataError(
                f"{self.path}: trials of another seed, choice or engine, or of this one before it was "
                "changed; remove the file or name another one with --trials-output"
            )
        if lines[-1]:
            rewrite(self.path, whole)
        finished = {}
        for number, line in enumerate(whole[1:], start=2):
            entry = parsed(line)
            if entry is None or not isinstance(entry.get("trial"), int) or "marks" not in entry:
                raise DataError(f"{self.path}:{number}: not a line of a file of trials")
            finished[entry["trial"]] = entry
        return finished

    def begin(self) -> None:
        """A new journal, empty but for its head."""
        rewrite(self.path, [json.dumps({"plan": self._key})])

    def add(self, record: Mapping[str, Any]) -> None:
        """Append one trial and see it on the disk."""
        append(self.path, json.dumps(record, ensure_ascii=False))

    def end(self, records: Iterable[Mapping[str, Any]]) -> None:
        """The finished journal: trials in their order, whoever finished first."""
        ordered = sorted(records, key=lambda r: r["trial"])
        rewrite(self.path, [json.dumps({"plan": self._key}), *(json.dumps(r, ensure_ascii=False) for r in ordered)])
