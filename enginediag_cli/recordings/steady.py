"""The stability gate: keeps the records in which the engine has settled, and says why the others went."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.trailing import Trailing


@dataclass(frozen=True)
class SteadySettings:
    """Limits are in the units of the recorder's columns; an empty mapping asks for nothing.

    spread: largest maximum minus minimum within the last window_s; slope: largest trend per second there;
    dwell: largest spread within the last dwell_s (the last change was longer ago: heat soak is over);
    minimum, maximum: limits of the value; neighbours: largest difference from the record before and the one
    after, for files without time stamps.
    """

    window_s: float = 0.0
    gap_s: float = np.inf
    spread: Mapping[str, float] = field(default_factory=dict)
    slope: Mapping[str, float] = field(default_factory=dict)
    dwell_s: float = 0.0
    dwell: Mapping[str, float] = field(default_factory=dict)
    minimum: Mapping[str, float] = field(default_factory=dict)
    maximum: Mapping[str, float] = field(default_factory=dict)
    neighbours: Mapping[str, float] = field(default_factory=dict)

    @property
    def timed(self) -> bool:
        return bool(self.spread or self.slope or self.dwell)

    @property
    def columns(self) -> tuple[str, ...]:
        conditions = (self.spread, self.slope, self.dwell, self.minimum, self.maximum, self.neighbours)
        names = [name for condition in conditions for name in condition]
        return tuple(dict.fromkeys((["time_s"] if self.timed else []) + names))


@dataclass(frozen=True)
class GateReport:
    """kept of total; reasons: why each of the others went, by the first condition that it failed."""

    kept: int
    total: int
    reasons: Mapping[str, int]
    unit: str = "records"

    def report_line(self) -> str:
        why = ", ".join(f"{reason} {n}" for reason, n in self.reasons.items() if n)
        return f"kept {self.kept} of {self.total} {self.unit}" + (f" (left out: {why})" if why else "")


def failures(recording: Recording, settings: SteadySettings) -> dict[str, np.ndarray]:
    """Condition → mask (N,) of the records that fail it, in the order in which they are reported."""
    failed: dict[str, np.ndarray] = {}
    for name in settings.columns:
        failed[f"missing {name}"] = ~np.isfinite(recording[name])
    for name, least in settings.minimum.items():
        failed[f"{name} < {least:g}"] = recording[name] < least
    for name, most in settings.maximum.items():
        failed[f"{name} > {most:g}"] = recording[name] > most
    if settings.timed:
        _timed(recording, settings, failed)
    for name, most in settings.neighbours.items():
        step = np.abs(np.diff(recording[name]))
        # the first and the last record have one neighbour to answer for
        ok = np.concatenate([[True], step < most]) & np.concatenate([step < most, [True]])
        failed[f"neighbours of {name}"] = ~ok
    return failed


def _timed(recording: Recording, settings: SteadySettings, failed: dict[str, np.ndarray]) -> None:
    window = Trailing(recording["time_s"], settings.window_s, settings.gap_s)
    failed["start or gap"] = ~window.full
    for name, most in settings.spread.items():
        failed[f"spread of {name}"] = window.spread(recording[name]) > most
    for name, most in settings.slope.items():
        failed[f"slope of {name}"] = np.abs(window.slope(recording[name])) > most
    if settings.dwell:
        past = Trailing(recording["time_s"], settings.dwell_s, settings.gap_s)
        failed["dwell (start or gap)"] = ~past.full
        for name, most in settings.dwell.items():
            failed[f"dwell of {name}"] = past.spread(recording[name]) > most


def gate(recording: Recording, settings: SteadySettings) -> tuple[np.ndarray, GateReport]:
    """Mask (N,) of the steady records, and the report."""
    keep, reasons = first_reasons(failures(recording, settings), np.ones(len(recording), dtype=bool))
    return keep, GateReport(int(keep.sum()), len(recording), reasons)


def first_reasons(failed: Mapping[str, np.ndarray], candidates: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
    """Candidates (N,) that pass everything, and how many fail each condition first."""
    keep = candidates.copy()
    reasons: dict[str, int] = {}
    for reason, mask in failed.items():
        reasons[reason] = int(np.count_nonzero(keep & mask))
        keep &= ~mask
    return keep, reasons
