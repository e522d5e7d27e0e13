"""Columns at a lower rate than the file's: empty cells between readings, held or interpolated for a stated while."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.recordings.table import Recording, concat


@dataclass(frozen=True)
class Fill:
    """method: "hold" the last reading, or "interpolate" in time between two (in records without time_s); records: the
    most records that a reading is carried, or that two readings lie apart. What is further stays missing."""

    method: str
    records: int


class Filler:
    """Fills columns of a stream; what waits for the next reading of an interpolated column is handed out later, so the
    result does not depend on chunks."""

    def __init__(self, fills: Mapping[str, Fill]):
        self._fills = fills
        self._reach = max((f.records for f in fills.values()), default=0)
        self._held: Recording | None = None
        self._done = 0

    def add(self, recording: Recording, *, end: bool = False) -> Recording:
        """The records that have become final by these."""
        if not self._fills:
            return recording
        every = concat([self._held, recording]) if self._held is not None else recording
        n = len(every)
        final = n if end else min([n, *(self._ready(every[c], f) for c, f in self._fills.items())])
        final = max(final, self._done)
        time = every["time_s"] if "time_s" in every else np.arange(float(n))
        filled = every.with_columns({c: fill(every[c], time, f) for c, f in self._fills.items()})
        result = filled.select(slice(self._done, final))
        first = max(0, final - self._reach - 1)
        self._held, self._done = every.select(slice(first, None)), final - first
        return result

    def _ready(self, values: np.ndarray, how: Fill) -> int:
        n = len(values)
        if how.method == "hold":
            return n
        known = np.flatnonzero(np.isfinite(values))
        return max(int(known[-1]) + 1 if known.size else 0, n - how.records)


def fill(values: np.ndarray, time: np.ndarray, how: Fill) -> np.ndarray:
    """(N,) values with gaps filled as `how` says; time: (N,) at which they were read."""
    n = len(values)
    known = np.isfinite(values)
    if not known.any():
        return values
    rows = np.arange(n)
    before = np.maximum.accumulate(np.where(known, rows, -1))
    if how.method == "hold":
        carried = ~known & (before >= 0) & (rows - before <= how.records)
        return np.where(carried, values[before], values)
    after = np.minimum.accumulate(np.where(known, rows, n)[::-1])[::-1]
    between = ~known & (before >= 0) & (after < n)
    between &= np.where(between, after - before, 0) <= how.records
    a, b = before[between], after[between]
    span = time[b] - time[a]
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(span > 0.0, (time[rows[between]] - time[a]) / span, np.nan)
    result = values.copy()
    result[between] = values[a] + share * (values[b] - values[a])
    return result
