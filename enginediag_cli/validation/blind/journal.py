"""The journal of blind trials: every trial with its sealed answer and its marks, by number."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from enginediag_cli import __version__
from enginediag_cli.validation.blind.trial import Plan
from enginediag_cli.validation.journal import Form, Journal

Record = Mapping[str, Any]


def plan_key(plan: Plan) -> str:
    """Hash of all that a trial depends on but its number."""
    said = f"{__version__} {plan.seed} {plan.truths} {plan.kinds} {plan.false_alarm}"
    digest = hashlib.sha256(said.encode())
    for engine in dict.fromkeys((plan.engine, *plan.engines)):
        digest.update(b"\0" + Path(engine).read_bytes())
    return digest.hexdigest()


def trials_journal(path: Path, key: str) -> Journal[int, Record]:
    """The journal at `path` of the plan with this key."""
    return Journal(path, key, _FORM)


def _line(number: int, record: Record) -> Record:
    return record


def _entry(line: Mapping[str, Any]) -> tuple[int, Record]:
    if not isinstance(line["trial"], int) or "marks" not in line:
        raise ValueError("not a trial")
    return line["trial"], line


_FORM = Form(
    "plan",
    "a file of trials",
    "trials of another seed, choice or engine, or of this one before it was changed",
    "--trials-output",
    _line,
    _entry,
)
