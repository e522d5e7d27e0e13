"""A frozen recorder: every judged column repeats to the last digit for many records while time goes on.

Sensors have noise, so that even a steady engine does not read the same in every column for long. Coarse recordings
repeat whole records now and then, or hold each for some records; how often they do is measured on the records that
are not suspect, and a run must be longer than that explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.flights import FlightNumbers
from enginediag_cli.recordings.table import Recording

BY_CHANCE = 1e-3
"""Expected number of natural runs, in the records looked at, that one must be rarer than to count as frozen."""
MOST_WATCHED = 64
"""Flights that a watch keeps the last record of; the one silent longest is forgotten for the next."""


def frozen(
    recording: Recording, flights: np.ndarray, sensors: Sequence[str], inputs: Sequence[str], records: int
) -> np.ndarray:
    """Mask (N,) of the records in runs of at least `records` in which all `sensors` and `inputs` stand still.

    flights: (N,) numbers; a run never reaches from one into another. Records without any reading are missing, not
    frozen. records: 0 finds nothing.
    """
    n = len(recording)
    mask = np.zeros(n, dtype=bool)
    if records <= 0 or n < records or not sensors:
        return mask
    order = np.argsort(flights, kind="stable")
    ids = flights[order]
    same = np.concatenate([[False], ids[1:] == ids[:-1]])
    for column in (*sensors, *inputs):
        x = recording[column][order]
        same[1:] &= (x[1:] == x[:-1]) | (np.isnan(x[1:]) & np.isnan(x[:-1]))
        if not same.any():
            return mask
    if "time_s" in recording:
        step = np.diff(recording["time_s"][order], prepend=0.0)
        same &= ~(step <= 0.0)
    starts = np.flatnonzero(~same)
    lengths = np.diff(np.append(starts, n))
    short = lengths[lengths < records]
    needed = natural_length(int(short.sum() - len(short)), int(short.sum()), n, records)
    mask[order] = np.repeat(lengths >= needed, lengths)
    return mask & np.any([np.isfinite(recording[c]) for c in sensors], axis=0)


def natural_length(repeats: int, rows: int, n: int, records: int) -> int:
    """Records that a run needs to be called frozen: `records`, or more where `repeats` of `rows` unsuspected records
    repeat the one before: with that share p a run of k is met n p^k times in n records."""
    if repeats <= 0 or rows <= 0:
        return records
    p = repeats / rows
    return max(records, int(np.ceil(np.log(BY_CHANCE / max(n, 1)) / np.log(min(p, 1.0 - 1e-9)))))


@dataclass
class _Last:
    row: np.ndarray
    time: float
    run: int = 1


@dataclass
class FrozenWatch:
    """The causal part, for a recording that is still being written: no look ahead, whatever the pieces.

    run: records that the flight seen last has stood still for.
    """

    sensors: Sequence[str]
    inputs: Sequence[str] = ()
    records: int = 20
    run: int = 0
    _flights: FlightNumbers = field(default_factory=FlightNumbers)
    _last: dict[int, _Last] = field(default_factory=dict)
    _seen: int = 0
    _short: int = 0
    _short_repeats: int = 0

    def add(self, recording: Recording) -> np.ndarray:
        """Mask (N,) of the records by which their flight has stood still for long enough to be called frozen."""
        mask = np.zeros(len(recording), dtype=bool)
        if self.records <= 0 or not len(recording) or not self.sensors:
            return mask
        flights = self._flights.of(recording)
        table = np.column_stack([recording[c] for c in (*self.sensors, *self.inputs)])
        time = recording["time_s"] if "time_s" in recording else np.full(len(recording), np.nan)
        known = np.isfinite(table[:, : len(self.sensors)]).any(axis=1)
        for k, (flight, row) in enumerate(zip(flights.tolist(), table, strict=True)):
            last = self._last.pop(flight, None)
            on = last is not None and not time[k] <= last.time and np.array_equal(last.row, row, equal_nan=True)
            if last is not None and not on and last.run < self.records:
                self._short += last.run
                self._short_repeats += last.run - 1
            self.run = last.run + 1 if last is not None and on else 1
            self._last[flight] = _Last(row, float(time[k]), self.run)
            if len(self._last) > MOST_WATCHED:
                self._last.pop(next(iter(self._last)))
            self._seen += 1
            needed = natural_length(self._short_repeats, self._short, self._seen, self.records)
            mask[k] = known[k] and self.run >= needed
        return mask
