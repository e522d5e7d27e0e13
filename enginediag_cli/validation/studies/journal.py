"""The journal of a study: its finished batches."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from enginediag_cli import __version__
from enginediag_cli.validation.journal import Form, Journal
from enginediag_cli.validation.studies.batches import Batch
from enginediag_cli.validation.studies.study_file import Study
from enginediag_cli.validation.studies.tally import Tally

Tallies = dict[str, Tally]
"""Tally of every method, by its name."""
Finished = dict[Batch, Tallies]


def study_key(study: Study, seed: int, repetitions: int | None) -> str:
    """Hash of all that the result depends on: program version, study file, engine file, seed and repetitions."""
    digest = hashlib.sha256(f"{__version__} {seed} {repetitions}".encode())
    for path in (study.path, Path(study.monitor.engine.path)):  # type: ignore[attr-defined]
        digest.update(b"\0" + path.read_bytes())
    return digest.hexdigest()


def study_journal(path: Path, key: str) -> Journal[Batch, Tallies]:
    """The journal at `path` of the study with this key."""
    return Journal(path, key, _FORM)


def _line(batch: Batch, tallies: Tallies) -> Mapping[str, Any]:
    return {
        "batch": [batch.case, batch.first, batch.count],
        "methods": {name: one.as_json() for name, one in tallies.items()},
    }


def _entry(line: Mapping[str, Any]) -> tuple[Batch, Tallies]:
    return Batch(*line["batch"]), {name: Tally.from_json(one) for name, one in line["methods"].items()}


_FORM = Form(
    "study",
    "the journal of a study",
    "the journal of another study, or of this one before it was changed",
    "--journal",
    _line,
    _entry,
)
