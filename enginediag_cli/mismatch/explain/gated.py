"""What a recorder's stability gate keeps from the search: effects that are there only while an engine moves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.mismatch.fit.evidence import Dataset


@dataclass(frozen=True)
class UnsteadyRecords:
    """`records` of `of` that were left out because the engine was not steady, counted in `unit`; `effects`, by label,
    that remember and would show there and nowhere else."""

    records: int
    of: int
    unit: str
    effects: tuple[str, ...]


def gated_out(evidence: Dataset, effects: Sequence[Effect], intake: RecordingLoader | None) -> UnsteadyRecords | None:
    """None where no gate has left records out, or where those that it kept know their past all the same."""
    if intake is None or any(MOMENT in f.columns for f in evidence.flights):
        return None
    gates = [left.gate for left in intake.excluded if left.gate is not None]
    out = sum(g.total - g.kept for g in gates)
    labels = tuple(e.label for e in effects if MOMENT in e.term.INPUTS)
    return UnsteadyRecords(out, sum(g.total for g in gates), gates[0].unit, labels) if out and labels else None
