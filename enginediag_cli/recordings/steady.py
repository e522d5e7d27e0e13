"""The stability gate: keeps the records in which the engine has settled, and says why the others went.

Statistics over the last seconds before each record, at any time stamps.

Averages over windows that follow each other: one record out of some seconds of steady ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.table import Recording


class TrailingWindows:
    """Windows (t_k − length, t_k] of a recording; they do not reach across gaps or backward steps of time."""

    def __init__(self, time_s: np.ndarray, length_s: float, gap_s: float = np.inf):
        """time_s: (N,), a missing one is that of the last record; a step over gap_s begins a new stretch."""
        n = len(time_s)
        time = np.asarray(time_s, dtype=float).copy()
        if n and np.isnan(time[0]):
            time[0] = 0.0
        known = np.maximum.accumulate(np.where(np.isfinite(time), np.arange(n), 0)) if n else np.zeros(0, int)
        time = time[known]
        step = np.diff(time)
        forward = step[step > 0.0]
        self.period_s = float(np.median(forward)) if len(forward) else 0.0
        breaks = np.concatenate([[True], (step < 0.0) | (step > gap_s)])[:n]
        stretch = np.cumsum(breaks) - 1
        first = np.flatnonzero(breaks)
        self.time = time
        self.end = np.arange(n)
        self.start = np.empty(n, dtype=np.int64)
        for k, begin in enumerate(first):
            stop = first[k + 1] if k + 1 < len(first) else n
            t = time[begin:stop]
            earliest = np.searchsorted(t, t - length_s + 1e-6 * self.period_s, "right")
            self.start[begin:stop] = begin + np.minimum(earliest, np.arange(stop - begin))
        since = time - time[first[stretch]] if n else time
        self.full = since >= length_s - 1.5 * self.period_s

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Maximum minus minimum (N,) in each window, missing values passed over; −inf where all are missing.

        A sparse table of maxima over spans of 2^j records: any window is the union of two such spans.
        """
        missing = ~np.isfinite(values)
        highest = self._maximum(np.where(missing, -np.inf, values))
        lowest = self._maximum(np.where(missing, -np.inf, -values))
        return highest + lowest

    def _maximum(self, values: np.ndarray) -> np.ndarray:
        n = len(values)
        length = self.end - self.start + 1
        level = np.frexp(length)[1] - 1  # floor(log2(length))
        result = np.full(n, -np.inf)
        table = values
        for j in range(int(level.max(initial=0)) + 1):
            if j:
                half = 1 << (j - 1)
                table = np.maximum(table[: len(table) - half], table[half:])
            rows = np.flatnonzero(level == j)
            result[rows] = np.maximum(table[self.start[rows]], table[self.end[rows] - (1 << j) + 1])
        return result

    def slope(self, values: np.ndarray) -> np.ndarray:
        """Least-squares slope per second (N,) in each window; 0 where fewer than two values are there.

        Summed lag by lag, with time counted from the window's end: differences of running sums over the whole
        recording would lose all digits after some hours.
        """
        known = np.isfinite(values)
        if not known.any():
            return np.zeros(len(values))
        x = np.where(known, values - np.mean(values[known]), 0.0)
        n, st, sx, stt, stx = np.zeros((5, len(values)))
        for lag in range(int(np.max(self.end - self.start, initial=0)) + 1):
            rows = np.flatnonzero((self.end - self.start >= lag) & known[np.maximum(self.end - lag, 0)])
            t, y = self.time[rows - lag] - self.time[rows], x[rows - lag]
            n[rows] += 1.0
            st[rows] += t
            sx[rows] += y
            stt[rows] += t * t
            stx[rows] += t * y
        denominator = n * stt - st * st
        good = denominator > 1e-9 * self.period_s**2
        return np.where(good, (n * stx - st * sx) / np.where(good, denominator, 1.0), 0.0)


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
        return f"kept {self.kept} of {self.total} {self.unit}" + (f" (excluded: {why})" if why else "")


def find_failures(recording: Recording, settings: SteadySettings) -> dict[str, np.ndarray]:
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
    window = TrailingWindows(recording["time_s"], settings.window_s, settings.gap_s)
    failed["start or gap"] = ~window.full
    for name, most in settings.spread.items():
        failed[f"spread of {name}"] = window.spread(recording[name]) > most
    for name, most in settings.slope.items():
        failed[f"slope of {name}"] = np.abs(window.slope(recording[name])) > most
    if settings.dwell:
        past = TrailingWindows(recording["time_s"], settings.dwell_s, settings.gap_s)
        failed["dwell (start or gap)"] = ~past.full
        for name, most in settings.dwell.items():
            failed[f"dwell of {name}"] = past.spread(recording[name]) > most


def count_first_reasons(failed: Mapping[str, np.ndarray], candidates: np.ndarray) -> tuple[np.ndarray, dict[str, int]]:
    """Candidates (N,) that pass everything, and how many fail each condition first."""
    keep = candidates.copy()
    reasons: dict[str, int] = {}
    for reason, mask in failed.items():
        reasons[reason] = int(np.count_nonzero(keep & mask))
        keep &= ~mask
    return keep, reasons


COMPLETE = 0.8
"""Share of the records of a window that must be there for it to count as a window."""


def average_windows(
    recording: Recording, window_s: float, failed: Mapping[str, np.ndarray], new: np.ndarray | None = None
) -> tuple[Recording, GateReport]:
    """Means over windows of window_s seconds whose last record passes every condition in `failed`.

    new: (N,) bool, only the windows that end with one of these records; None for all.

    Windows begin at whole multiples of window_s, so that the engines of one flight have the same
    ones. A condition on the last window_s before a record is a condition on the window. Missing
    values are not in the mean; a column without any is missing.
    """
    time = recording["time_s"]
    number = np.floor(np.where(np.isfinite(time), time, -1e300) / window_s)
    first = np.flatnonzero(np.concatenate([[True], np.diff(number) != 0.0])[: len(time)])
    last = np.concatenate([first[1:], [len(time)]])[: len(first)] - 1
    size = last - first + 1
    step = np.diff(time)
    forward = step[step > 0.0]
    expected = window_s / float(np.median(forward)) if len(forward) else 1.0
    complete = (size >= COMPLETE * expected) & np.isfinite(time[first])
    conditions = {"incomplete window": ~complete} | {why: mask[last] for why, mask in failed.items()}
    asked = np.ones(len(first), dtype=bool) if new is None else np.asarray(new)[last]
    keep, reasons = count_first_reasons(conditions, asked)
    report = GateReport(int(keep.sum()), int(asked.sum()), reasons, unit=f"windows of {window_s:g} s")
    return _means(recording, first[keep], size[keep]), report


def _means(recording: Recording, first: np.ndarray, size: np.ndarray) -> Recording:
    """Means of the windows (M,), with the line and the texts of each window's first record."""
    window = np.repeat(np.arange(len(first)), size)
    rows = first[window] + np.arange(len(window)) - np.repeat(np.cumsum(size) - size, size)
    means: dict[str, np.ndarray] = {}
    for name, values in recording.columns.items():
        x = values[rows]
        known = np.isfinite(x)
        with np.errstate(invalid="ignore", divide="ignore"):
            means[name] = np.bincount(window[known], x[known], len(first)) / np.bincount(
                window[known], None, len(first)
            )
    return recording.select(first).with_columns(means)
