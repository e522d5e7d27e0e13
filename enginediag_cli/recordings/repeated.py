"""Readings that repeat: rows written twice, held readings, stuck sensors and frozen recorders.

**Repeated rows** are records of a flight that are there already, to the last digit and with the same time.

Only a record whose time does not go on can be one, so a file in order costs no search. Without `time_s` equal rows
are no proof (hourly means of a coarse sensor) and none is called repeated.

**Held readings.** A reading is held where a channel is sampled more slowly than rows are written: it changes every k-th
record and at no other, k the same throughout. Rounding makes readings repeat as well, but irregularly, or by one step
at a time.

**Stuck sensors** repeat a reading to the last digit while the others move.

**Frozen recorders.** Every judged column repeats to the last digit for many records while time goes on.

Sensors have noise, so that even a steady engine does not read the same in every column for long. Coarse recordings
repeat whole records now and then, or hold each for some records; how often they do is measured on the records that
are not suspect, and a run must be longer than that explains.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.recordings.table import FlightNumbers, Recording

COARSE = 0.01
"""Share of records that repeat the one before, from which a sensor counts as coarse (quantised)."""
END_OF_SCALE = 1e-3
"""Readings this close to their smallest or largest, as a share of the span, are saturated or off scale."""


@dataclass(frozen=True)
class StuckRun:
    """Identical readings of a column that should have moved: their value in the column's unit, the lines of the first
    and the last of them in the file, and how many they are. opens, closes: it begins with the first, ends with the last
    reading of the piece of the file in which it was found, and so may go on before or after it."""

    column: str
    value: float
    first_line: int
    last_line: int
    records: int
    opens: bool = field(default=False, compare=False)
    closes: bool = field(default=False, compare=False)

    def overlaps(self, first_line: int, last_line: int) -> bool:
        """Whether some of it lies in these lines."""
        return self.first_line <= last_line and self.last_line >= first_line


def label_runs(labels: np.ndarray) -> list[tuple[int, int]]:
    """(start, stop) of stretches of equal neighbours in labels (n,)."""
    edges = [0, *(np.flatnonzero(np.diff(labels)) + 1).tolist(), len(labels)]
    return [(i, k) for i, k in pairwise(edges) if k > i]


def list_stuck_runs(column: str, values: np.ndarray, line: np.ndarray, mask: np.ndarray) -> Iterator[StuckRun]:
    """The masked (N,) of the readings of a column (N,), on these lines (N,), as runs of one value."""
    rows = np.flatnonzero(mask)
    if not rows.size:
        return
    others = np.cumsum(np.isfinite(values) & ~mask)  # readings that are not stuck, up to each record
    new = np.flatnonzero(np.r_[True, (np.diff(values[rows]) != 0.0) | (np.diff(others[rows]) > 0)])
    for first, stop in zip(new, np.r_[new[1:], rows.size], strict=True):
        own = rows[first:stop]
        opens, closes = bool(others[own[0]] == 0), bool(others[own[-1]] == others[-1])
        yield StuckRun(column, float(values[own[0]]), int(line[own[0]]), int(line[own[-1]]), len(own), opens, closes)


def extend_to_runs(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The masked (N,) and whatever stands beside them with the same value (N,), in a row."""
    run = np.cumsum(np.r_[0, values[1:] != values[:-1]])
    return np.isin(run, run[mask])


def append_runs(known: list[StuckRun], more: Iterator[StuckRun]) -> None:
    """Add runs to those that are known, in order; one that goes on from a block to the next stays one."""
    for run in more:
        before = next((k for k in range(len(known) - 1, -1, -1) if known[k].column == run.column), None)
        if before is not None and known[before].value == run.value and known[before].closes and run.opens:
            old = known[before]
            records = old.records + run.records
            known[before] = replace(old, last_line=run.last_line, records=records, closes=run.closes)
        else:
            known.append(run)


@np.errstate(over="ignore", invalid="ignore")  # readings near the largest number: of infinite spread, they tell nothing
def find_stuck(
    values: np.ndarray,
    others: Mapping[str, np.ndarray],
    records: int = 20,
    seen: tuple[float, float] = (np.inf, -np.inf),
) -> np.ndarray:
    """Mask (N,) of the runs of `records` or more identical readings that are not natural.

    A sensor with a fine resolution never repeats itself while anything else changes: any long run is stuck, be it at
    the end of the scale, where a filler is found, too. One with a coarse resolution does in steady flight; its run is
    stuck only when it is three times longer than any other and the other columns, by a linear regression outside the
    run, say that it should have moved by more than 6 residual standard deviations; at the end of its scale (an
    air-speed indicator on the ground) it gives no evidence, nor does a column that never changes: neither is called
    stuck.
    seen: smallest and largest reading of the file before these records, which belong to the scale, too.
    """
    mask = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < 2 * records:
        return mask
    x = values[finite]
    starts = np.flatnonzero(np.r_[True, x[1:] != x[:-1]])
    lengths = np.diff(np.r_[starts, len(x)])
    lowest, highest = min(x.min(), seen[0]), max(x.max(), seen[1])
    margin = END_OF_SCALE * (highest - lowest)
    within = (x[starts] > lowest + margin) & (x[starts] < highest - margin)
    suspects = np.flatnonzero(lengths >= records)
    if len(suspects) == 0 or len(lengths) == 1:
        return mask
    predictors = _standardised(others, finite)
    for k in suspects:
        run = slice(starts[k], starts[k] + lengths[k])
        elsewhere = np.delete(lengths, k)
        # a sensor that is stuck more than once is no coarse one, but one that rests again at one end of its scale is
        stop = (x[starts] == x[starts[k]]) & ~within[k]
        usual = np.delete(lengths, k)[np.delete((lengths < records) | stop, k)]
        repeats = 1.0 - len(usual) / usual.sum() if usual.size else 1.0
        if repeats < COARSE:
            is_stuck = bool(np.any(np.ptp(predictors[run], axis=0) > 0.0)) if predictors.shape[1] else False
        elif not within[k] or lengths[k] < 3 * elsewhere.max():
            is_stuck = False
        else:
            moved, error = _predicted_span(x, predictors, run)
            is_stuck = moved > 6.0 * error
        if is_stuck:
            mask[finite[run]] = True
    return mask


def _standardised(others: Mapping[str, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """(n, q) columns of mean 0 and variance 1, gaps at the mean; without those that never change."""
    columns = []
    for values in others.values():
        x = values[rows]
        known = np.isfinite(x)
        spread = np.std(x[known]) if known.any() else 0.0
        if spread > 0.0:
            columns.append(np.where(known, (x - np.mean(x[known])) / spread, 0.0))
    return np.column_stack(columns) if columns else np.zeros((len(rows), 0))


def _predicted_span(x: np.ndarray, predictors: np.ndarray, run: slice) -> tuple[float, float]:
    """How far x should have moved within the run, and the residual standard deviation of the regression."""
    outside = np.ones(len(x), dtype=bool)
    outside[run] = False
    design = np.column_stack([np.ones(len(x)), predictors])
    if predictors.shape[1] == 0 or outside.sum() <= design.shape[1]:
        return 0.0, np.inf
    coefficients = np.linalg.lstsq(design[outside], x[outside], rcond=None)[0]
    predicted = design @ coefficients
    return float(np.ptp(predicted[run])), float(np.std(x[outside] - predicted[outside]))


SEGMENT = 65_536
"""Rows of a segment; half a megabyte."""
SEGMENTS = 16
"""Rows are remembered in sorted segments, 8 bytes a row; the last SEGMENT · SEGMENTS rows, about a million (8 MB), so
that memory stays bounded. A copy further back than that is not seen."""

LEAST_RUNS = 8
"""Runs of equal readings by which a channel is called held; of fewer, regular lengths may be chance."""
REGULAR, SINGLE = 0.9, 0.6
"""Shares of the runs that last k records, one more or less, or a multiple (two readings in turn may be the same), and
that last k: of rounded noise a run is as likely to go on as the one before, and a third of them lasts one record."""
LONE = 0.02
"""Share of runs of one record up to which a channel is held: where a recorder begins anew."""
LONE_LIVE = 0.1
"""The same of a recording that is being written, which has few runs to begin with."""
RARE = 0.01
"""Share of the changes of a channel that are followed by a repeat, up to which its resolution is fine: one that repeats
itself then was not read anew."""
ONE_STEP = 0.5
"""Share of changes of one and the same size from which they are steps of rounding, as a slow climb makes them."""

_PRIME = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio, odd: Knuth's multiplicative hashing spreads neighbouring numbers over all bits."""
_SHIFT = np.uint64(29)
"""Folds high bits down between columns, so that low bits of the next one meet them."""


@dataclass
class DuplicateRows:
    """Finds repeated rows of one file, given in chunks of any size."""

    _latest: dict[int, float] = field(default_factory=dict)
    _segments: list[np.ndarray] = field(default_factory=list)
    _open: list[np.ndarray] = field(default_factory=list)
    _open_rows: int = 0

    def add(self, recording: Recording, flights: np.ndarray) -> np.ndarray:
        """Mask (N,) of the records that repeat an earlier one of their flight number in `flights` (N,)."""
        found = np.zeros(len(recording), dtype=bool)
        if "time_s" not in recording:
            return found
        time, rows = recording["time_s"], _hashes(recording, flights)
        start = 0
        while start < len(rows):  # never across the end of a segment: what is remembered must not depend on chunks
            stop = min(len(rows), start + SEGMENT - self._open_rows)
            piece = slice(start, stop)
            candidates = np.flatnonzero(self._not_later(time[piece], flights[piece]))
            if candidates.size:
                found[piece] = self._find_earlier(rows[piece], candidates)
            self._remember(rows[piece])
            start = stop
        return found

    def _not_later(self, time: np.ndarray, flights: np.ndarray) -> np.ndarray:
        """Records (n,) whose time is not later than every one before in their flight."""
        result = np.zeros(len(time), dtype=bool)
        known = np.where(np.isfinite(time), time, -np.inf)
        order = np.argsort(flights, kind="stable")
        edges = [0, *(np.flatnonzero(np.diff(flights[order])) + 1).tolist(), len(order)]
        for begin, end in pairwise(edges):
            rows = order[begin:end]
            key = int(flights[rows[0]])
            before = np.maximum.accumulate(np.concatenate([[self._latest.get(key, -np.inf)], known[rows]]))
            result[rows] = (known[rows] <= before[:-1]) & np.isfinite(time[rows])
            self._latest[key] = float(before[-1])
        return result

    def _find_earlier(self, rows: np.ndarray, candidates: np.ndarray) -> np.ndarray:
        wanted = rows[candidates]
        seen = np.zeros(len(wanted), dtype=bool)
        for segment in self._segments:
            place = np.minimum(np.searchsorted(segment, wanted), len(segment) - 1)
            seen |= segment[place] == wanted
        if self._open:
            self._open = [np.concatenate(self._open)]
            seen |= np.isin(wanted, self._open[0])
        first = np.unique(rows, return_index=True)
        seen |= first[1][np.searchsorted(first[0], wanted)] < candidates
        found = np.zeros(len(rows), dtype=bool)
        found[candidates] = seen
        return found

    def _remember(self, rows: np.ndarray) -> None:
        self._open.append(rows)
        self._open_rows += len(rows)
        if self._open_rows == SEGMENT:
            self._segments = [*self._segments[1 - SEGMENTS :], np.sort(np.concatenate(self._open))]
            self._open, self._open_rows = [], 0


def _hashes(recording: Recording, flights: np.ndarray) -> np.ndarray:
    """(N,) uint64 of all numbers of each record and its flight; equal for equal rows, missing values included."""
    rows = flights.astype(np.uint64) * _PRIME
    for name in sorted(recording.columns):
        values = recording[name] + 0.0  # −0 becomes 0
        bits = np.where(np.isnan(values), np.nan, values).view(np.uint64)
        rows = (rows ^ bits) * _PRIME
        rows ^= rows >> _SHIFT
    return rows


def hold_length(values: np.ndarray, flights: np.ndarray) -> int:
    """k, records for which a channel (N,) holds each reading, 1 where it is not held; flights (N,) numbers."""
    known = np.flatnonzero(np.isfinite(values))
    x, flight = values[known], flights[known]
    if len(x) < 2 * LEAST_RUNS:
        return 1
    new = np.r_[True, (x[1:] != x[:-1]) | (flight[1:] != flight[:-1])]
    starts = np.flatnonzero(new)
    lengths = np.diff(starts)
    # the first and the last run of a flight may be cut
    whole = np.zeros(len(lengths), bool)
    whole[1:] = (flight[starts[1:-1]] == flight[starts[:-2]]) & (flight[starts[1:-1]] == flight[starts[2:]])
    lengths, step = lengths[whole], np.abs(np.diff(x[starts]))[whole]
    if len(lengths) < LEAST_RUNS or np.mean(lengths == 1) > LONE:
        return 1
    k = int(np.sort(lengths)[len(lengths) // 2])
    times = np.maximum(np.round(lengths / max(k, 1)), 1)
    regular = np.abs(lengths - k * times) <= 1
    usual = np.sort(step)[len(step) // 2]
    rounded = np.mean(np.abs(step - usual) <= 1e-4 * usual) > ONE_STEP
    if k < 2 or regular.mean() < REGULAR or np.mean(times == 1) < SINGLE or rounded:
        return 1
    return k


def find_held_readings(
    columns: Mapping[str, np.ndarray], inputs: Collection[str], flights: np.ndarray
) -> tuple[dict[str, np.ndarray], int]:
    """Masks (N,) of the readings that say nothing new, by column, and for how many records the fastest channel holds
    each reading. Where inputs are held a record without a fresh one of the slowest of them is as old as that: of every
    sensor no reading there counts, and elsewhere one that has changed since the last record that counts."""
    k = {c: hold_length(x, flights) for c, x in columns.items()}
    if max(k.values(), default=1) < 2:
        return {}, 1
    n = len(flights)
    start = np.r_[True, flights[1:] != flights[:-1]]

    def fresh(column: str) -> np.ndarray:
        """Where a run of equal readings begins, and every k records of one that lasts longer."""
        x = columns[column]
        new = start | np.r_[True, (x[1:] != x[:-1]) & ~(np.isnan(x[1:]) & np.isnan(x[:-1]))]
        place = np.arange(n) - np.maximum.accumulate(np.where(new, np.arange(n), 0))
        return np.asarray(place % k[column] == 0)

    slowest = max((c for c in columns if c in inputs), key=lambda c: k[c], default="")
    counts = fresh(slowest) if slowest and k[slowest] > 1 else np.ones(n, bool)
    masks = {}
    for column in columns:
        if column in inputs:
            continue
        mask = ~counts
        if k[column] > 1:
            changes = np.cumsum(fresh(column))
            at = np.flatnonzero(counts)
            seen = np.diff(changes[at], prepend=-1) > 0
            mask[at] = ~seen
        if mask.any():
            masks[column] = mask
    return masks, min((k[c] for c in columns if c not in inputs), default=1)


STUCK = 20
"""Repeats in a row from which a channel is stuck, and not rounded: as many as the search of whole files asks for."""


@dataclass
class RepeatWatch:
    """The causal part, for a recording that is still being written. A reading that repeats the one before is held
    until the channel has changed often enough from one record to the next, as one does that is rounded; in a channel
    that hardly ever repeats a reading it is held, or stuck. A record in which every reading repeats is another matter.
    stuck: runs of STUCK repeats and more of a channel that changed from record to record before, and of one that has
    never changed, which `opens`: it may be coarse, and whoever knows what it should read decides.
    """

    stuck: list[StuckRun] = field(default_factory=list)
    _since: dict[str, int] = field(default_factory=dict)
    _last: dict[str, float] = field(default_factory=dict)
    # changes, those a record after another, runs of repeats that began, and how long the present one is
    _runs: dict[str, tuple[int, int, int, int]] = field(default_factory=dict)
    _changed: dict[str, bool] = field(default_factory=dict)

    def add(self, columns: Mapping[str, np.ndarray], line: np.ndarray) -> dict[str, np.ndarray]:
        """Masks (N,) of the readings of the next records, on these lines (N,), that say nothing new, by column."""
        again, masks = {}, {}
        for column, x in columns.items():
            before = np.r_[self._last.get(column, np.nan), x[:-1]]
            again[column] = x == before
            if len(x):
                self._last[column] = float(x[-1])
        moves = np.any([~same & np.isfinite(columns[c]) for c, same in again.items()], axis=0) if again else None
        for column, same in again.items():
            changed = ~same & np.isfinite(columns[column])
            twice = changed & np.r_[self._changed.get(column, False), changed[:-1]]
            begun = same & np.r_[self._changed.get(column, False), changed[:-1]]
            changes, lone, repeats, run = self._runs.get(column, (0, 0, 0, 0))
            changes, lone, repeats = changes + int(changed.sum()), lone + int(twice.sum()), repeats + int(begun.sum())
            at = np.arange(len(same))
            lasts = at - np.maximum.accumulate(np.where(same, -1 - run, at)) if len(same) else at
            repeats -= int(np.sum(same & (lasts == STUCK)))  # it is stuck: that makes no channel a rounded one
            self._runs[column] = changes, lone, repeats, int(lasts[-1]) if len(same) else run
            if len(changed):
                self._changed[column] = bool(changed[-1])
            held = lone <= LONE_LIVE * changes or repeats <= max(1.0, RARE * changes)
            if moves is not None and (same & moves).any() and held:
                masks[column] = same & moves
                if lone > LONE_LIVE * changes or changes <= 1:
                    like = StuckRun(column, 0.0, 0, 0, 0, opens=changes <= 1)
                    self._note(like, line, lasts, columns[column])
            if changed.any():
                self._since[column] = int(line[changed][-1])
        return masks

    def _note(self, like: StuckRun, line: np.ndarray, lasts: np.ndarray, x: np.ndarray) -> None:
        """Note runs of STUCK repeats and more like this one; lasts (N,): how many there are up to each record."""
        for k in np.flatnonzero((lasts >= STUCK) & (np.r_[lasts[1:], 0] == 0)).tolist():
            n = int(lasts[k])
            first = int(line[k - n]) if k >= n else self._since.get(like.column, int(line[0]))
            found = replace(like, value=float(x[k]), first_line=first, last_line=int(line[k]), records=n + 1)
            others = [run for run in self.stuck if (run.column, run.first_line) != (like.column, first)]
            self.stuck = [*others, found]


BY_CHANCE = 1e-3
"""Expected number of natural runs, in the records looked at, that one must be rarer than to count as frozen."""
MOST_WATCHED = 64
"""Flights that a watch keeps the last record of; the one silent longest is forgotten for the next."""


def find_frozen(
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
class _LastRow:
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
    _last: dict[int, _LastRow] = field(default_factory=dict)
    _seen: int = 0
    _short: int = 0
    _short_repeats: int = 0

    def add(self, recording: Recording) -> np.ndarray:
        """Mask (N,) of the records by which their flight has stood still for long enough to be called frozen."""
        mask = np.zeros(len(recording), dtype=bool)
        if self.records <= 0 or not len(recording) or not self.sensors:
            return mask
        flights = self._flights.numbers(recording)
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
            self._last[flight] = _LastRow(row, float(time[k]), self.run)
            if len(self._last) > MOST_WATCHED:
                self._last.pop(next(iter(self._last)))
            self._seen += 1
            needed = natural_length(self._short_repeats, self._short, self._seen, self.records)
            mask[k] = known[k] and self.run >= needed
        return mask
