"""Tapes: what a recording shows of an engine's inputs, record by record, so that any record finds its own past.

Whoever asks for predictions may leave records out, take them in blocks or shuffle them. So the past is not looked for
among the records that are asked for, but on the tape that the column MOMENT of a record names: all records of its
recording, those included that are judged by nobody.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from types import MappingProxyType

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.filters import FilterClock

MOMENT = "moment"
"""Input column that says which record of which tape a record is; −1: its past is not known, it is taken as steady."""
NO_MOMENT = -1.0
"""Of a record whose past is not known."""
PAST: Mapping[str, float] = MappingProxyType({MOMENT: NO_MOMENT})
"""What terms with memory read beside the engine's own inputs."""
RECORDS = 2**26
"""Records that a tape may have: two years at 1 Hz. MOMENT is the tape's number times this, plus the record's."""
AT_ONCE_S = 1e-6
"""What two records of one time lie apart: a step between them, not a quantity with two values."""
START = 6
"""Readings at the beginning of a stretch whose median tells where a memory begins, where one shows it; a stretch of
fewer begins in equilibrium, else these would be told by themselves: of hourly records, each a stretch of its own, any
misfit would be a lag. Judgement: of an even number those of a meter that alternates between two values cancel."""
GAP_S = 900.0
"""A longer step of time begins a new stretch, at its steady state: an engine may have been shut down and started
meanwhile. Over a shorter one columns are taken to run straight. Judgement."""


@dataclass(frozen=True)
class Tape:
    """One recording: `time` (N,) s and columns (N,) by name, all finite; `first` (N,): where a stretch begins. Records
    are in the order of time within a stretch; `place` (N,): of each record as it was read among these."""

    time: Array
    columns: Mapping[str, Array]
    first: Array
    place: Array

    def __len__(self) -> int:
        return len(self.time)

    def clock(self, shown_by: str = "") -> FilterClock:
        """The clock of filters; `shown_by`: column that shows their output, from which it is known at the beginnings of
        stretches: the median of the first START readings of each that has as many."""
        if shown_by not in self.columns:
            return FilterClock(self.time, self.first)
        start, x = np.full(len(self), np.nan), self.columns[shown_by]
        for k, stop in pairwise([*np.flatnonzero(self.first).tolist(), len(self)]):
            if stop - k >= START:
                start[k] = np.median(x[k : k + START])
        return FilterClock(self.time, self.first, start)

    def has_column(self, column: str) -> bool:
        """Whether the recording has readings of a column."""
        return column in self.columns


def make_tape(columns: Mapping[str, Array], names: Sequence[str]) -> Tape | None:
    """The tape of a recording with `time_s` and those columns of `names` that it has; None where it has no time.

    A recording that was written backwards is turned round. Where time goes back once, or stands still for lack of a
    reading, what follows is another stretch; gaps in a column are bridged by straight lines, at the ends by the
    nearest reading.
    """
    time = np.asarray(columns.get("time_s", ()), float)
    if len(time) < 2 or not np.isfinite(time).any():
        return None
    N = len(time)
    lost = ~np.isfinite(time)
    if lost.any():
        time = np.interp(np.arange(N), np.flatnonzero(~lost), time[~lost])
    steps = np.diff(time)
    order = np.arange(N)
    if np.count_nonzero(steps < 0.0) > np.count_nonzero(steps > 0.0):
        order = order[::-1]
    time = time[order].copy()
    steps = np.diff(time)
    first = np.append(True, (steps < 0.0) | (steps > GAP_S))
    for k in np.flatnonzero(steps == 0.0).tolist():  # one after the other, however little
        time[k + 1] = max(time[k + 1], time[k] + AT_ONCE_S)
    kept = {}
    for name in names:
        x = np.asarray(columns.get(name, ()), float)
        known = np.isfinite(x)
        if len(x) == N and known.any():
            x = x if known.all() else np.interp(np.arange(N), np.flatnonzero(known), x[known])
            kept[name] = x[order]
    place = np.empty(N, int)
    place[order] = np.arange(N)
    return Tape(time, kept, first, place)


@dataclass
class Tapes:
    """All tapes of an engine, shared by its copies. `names`: columns that are kept, where a recording has them."""

    names: tuple[str, ...]
    tapes: list[Tape] = field(default_factory=list)
    parts: dict[Hashable, tuple[int, list[Mapping[str, Array]]]] = field(default_factory=dict)

    def add(self, columns: Mapping[str, Array]) -> Array:
        """Remember a recording (N records); its MOMENT (N,)."""
        return self._moments(columns, None, 0)

    def extend(self, key: Hashable, columns: Mapping[str, Array]) -> Array:
        """Remember further records (N) of the recording `key`; their MOMENT (N,). What was known of earlier records
        stays as it is: only filters that look ahead would know more."""
        number, parts = self.parts.setdefault(key, (len(self.tapes), []))
        before = sum(len(p["time_s"]) for p in parts)
        kept = {c: np.asarray(v, float) for c, v in columns.items() if c in self.names or c == "time_s"}
        parts.append(kept)
        whole = {c: np.concatenate([p.get(c, np.full(len(p["time_s"]), np.nan)) for p in parts]) for c in kept}
        return self._moments(whole, number, before)

    def _moments(self, columns: Mapping[str, Array], number: int | None, since: int) -> Array:
        tape = make_tape(columns, self.names)
        N = len(np.asarray(next(iter(columns.values()), ())))
        if tape is None:
            return np.full(N - since, NO_MOMENT)
        if number is None or number == len(self.tapes):
            number = len(self.tapes)
            self.tapes.append(tape)
        else:
            self.tapes[number] = tape
        return number * float(RECORDS) + tape.place[since:]

    def locate(self, moment: Array) -> tuple[Array, Array]:
        """Number of the tape of each record (N,), −1 where it is on none, and its place there (N,)."""
        moment = np.asarray(moment, float)
        known = np.isfinite(moment) & (moment >= 0.0) & (moment < len(self.tapes) * float(RECORDS))
        number = np.where(known, np.floor_divide(np.where(known, moment, 0.0), RECORDS), -1).astype(int)
        place = np.where(known, moment - number * float(RECORDS), 0.0).astype(int)
        sizes = np.array([*map(len, self.tapes), 0])
        return np.where(place < sizes[number], number, -1), place
