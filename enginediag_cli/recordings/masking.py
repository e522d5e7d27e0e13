"""Readings and records that are excluded from a stream: gross errors, and records in which the engine is not steady.

**Masks** are the same, with the same counts, whatever the chunks, and take bounded memory. A file is judged in blocks
that begin at whole multiples of their length, counted in records from its start, each with a halo of records on either
side that its readings are compared with; the last block takes the rest, and so a file of up to 3,000 records is judged
as one. Beyond the halo only this is carried forward: the span that a sensor has been seen to read, whether it was stuck
when the last block ended, and the memory of the search for repeated rows.

One rule for every caller: an input (a command, the air outside) may well stand still for hours, so only its limits
are checked; a sensor that does so while others move is stuck. Inputs are witnesses in that search. Outliers are single
records, or two in a row, far from both sides and from all that the column reads at any time; what lies within its
usual range is judged by the model (`identification/gross_errors.py`). Every mask is counted.

**The stability gate** keeps the records in which the engine has settled, judged over the last seconds before each
record at any time stamps, and counts the reasons for the others. Steady records may be averaged over some seconds.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.recordings.repeated import (
    DuplicateRows,
    FrozenWatch,
    RepeatWatch,
    StuckRun,
    append_runs,
    find_frozen,
    find_held_readings,
    find_stuck,
    list_stuck_runs,
)
from enginediag_cli.recordings.table import FlightNumbers, Recording, concat
from enginediag_cli.units import find_unit, split_column

WINDOW = 9
"""Records of the median: four on either side, so that a spike of two in a row does not move it."""
TOLERATED = 3
"""A spike is at most this many records less one long; what lasts longer is left for detection to judge."""
GROSS = 0.05
"""Share of the column's usual span (5th to 95th percentile) below which nothing counts as gross."""
OUTSIDE = 0.2
"""A value this share of the span (0.5th to 99.5th percentile) beyond it is not of the engine's doing."""


@np.errstate(all="ignore")  # readings near the largest number: their span is infinite, which is what it should be
def find_spikes(values: np.ndarray, threshold: float = 8.0, isolation: float = 2.5) -> np.ndarray:
    """Mask (N,) of the spikes of a column (N,) that lie outside its usual span, by a Hampel filter.

    Hampel (1974), Davies and Gather (1993, JASA 88): r_k = x_k − median of the 9 records around k. A spike
    has |r_k| above `threshold` robust standard deviations of r over the recording, above 4 quanta of the
    sensor, above 5 % of the column's usual span, and above `isolation` times the third largest
    deviation from the median in that window. The last condition spares steps, ramps and throttle
    transients, where the neighbours deviate too. NaN are passed over. A column that stands still in most records (a
    valve, a flap) may move at any time: it has no outliers. On Gaussian data none is marked in 10⁵.
    """
    spike = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < WINDOW:
        return spike
    x = values[finite]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, WINDOW // 2, mode="reflect"), WINDOW)
    centre = np.partition(windows, WINDOW // 2, axis=1)[:, WINDOW // 2]
    residual = np.abs(x - centre)
    scale = 1.4826 * np.median(residual)
    if scale == 0.0 or not residual.max() > threshold * scale:  # the usual case, without the search for the span
        return spike
    lowest, low, high, highest = np.percentile(x, [0.5, 5.0, 95.0, 99.5])
    least = max(threshold * scale, GROSS * (high - low))
    margin = OUTSIDE * (highest - lowest)
    suspects = np.flatnonzero((residual > least) & ((x < lowest - margin) | (x > highest + margin)))
    if not suspects.size:
        return spike
    levels = np.unique(x)
    quantum = np.diff(levels).min() if len(levels) > 1 else 0.0
    deviations = np.sort(np.abs(windows[suspects] - centre[suspects, None]), axis=1)[:, -TOLERATED]
    grave = (residual[suspects] > 4.0 * quantum) & (residual[suspects] > isolation * deviations)
    spike[finite[suspects[grave]]] = True
    return spike


REASONS = ("missing", "dropped", "out of limits", "held", "stuck", "outlier")

WHOLE_RECORDS = {
    "frozen": "in which every reading is constant, not used",
    "repeated": "that were there already, excluded",
}
"""Reasons that concern whole records, and how they are reported."""

_PHYSICAL = (
    (r"([a-z]+_)?(T\d*|ITT|itt|EGT|TGT|TIT|TAT|SAT|tat|sat|temperature)", "temperature", 100.0, 3500.0),
    (r"([a-z]+_)?(P\d*|Ps\d*|pressure)", "pressure", 1.0, 1e8),
    (r"([a-z]+_)?N\d*", "rotational speed", 0.0, 3e5),
    (r"([a-z]+_)?(Wf|W\d*|fuel_flow)", "mass flow", -1.0, 1e4),
    (r"altitude", "length", -1000.0, 30000.0),
)
"""Name of the quantity, dimension, lowest and highest value in SI. The margins are wide: these catch the
codes that recorders write for no value (−9999, 0 K), not bad readings."""

BEYOND_ANY = 1e100
"""No instrument reads so much in any unit; beyond it squares and products of readings cannot be computed any more."""


@dataclass(frozen=True)
class QualitySettings:
    """How much is needed before a value is masked; 0 turns off the search for stuck sensors or for outliers.
    Records are those of the file, whatever their rate."""

    dropped_records: int = 10
    """Missing values in a row that count as a dropped sensor, not as single missing values."""
    stuck_records: int = 20
    outlier_sigma: float = 8.0
    frozen_records: int = 20
    """Records in a row with every judged reading the same, to the last digit: the recorder stands still. As many as
    for one stuck sensor; several together repeat far more rarely than one, and a recorder that writes 10 to 16 times
    for each reading of its sensors stays below."""


def physical_limits(column: str) -> tuple[float, float]:
    """What a gas turbine's sensor can truthfully read, in the column's unit; ±BEYOND_ANY if nothing is known.

    Only for names that say what they are: temperatures, pressures, speeds and flows (not differences).
    """
    quantity, suffix = split_column(column)
    if suffix:
        unit = find_unit(suffix)
        for pattern, dimension, low, high in _PHYSICAL:
            if unit.dimension == dimension and re.fullmatch(pattern, quantity):
                return (low - unit.offset) / unit.factor, (high - unit.offset) / unit.factor
    return (-0.1, 10.0) if column == "mach" else (-BEYOND_ANY, BEYOND_ANY)


def long_runs(mask: np.ndarray, shortest: int) -> np.ndarray:
    """The part of a mask (N,) that lies in runs of at least `shortest` records."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    starts, ends = edges[::2], edges[1::2]
    long = ends - starts >= shortest
    change = np.zeros(len(mask) + 1, dtype=np.int64)
    change[starts[long]] += 1
    change[ends[long]] -= 1
    return np.cumsum(change[:-1]) > 0


def count_new(found: Mapping[str, np.ndarray]) -> tuple[np.ndarray, dict[str, int]]:
    """Union of the masks, and how many values each adds to those before it."""
    union: np.ndarray | None = None
    counts: dict[str, int] = {}
    for reason, mask in found.items():
        new = mask if union is None else mask & ~union
        counts[reason] = int(np.count_nonzero(new))
        union = mask if union is None else union | mask
    assert union is not None
    return union, counts


HALO = 1000
"""Records on either side of a block; a run must show its least length within them, so they are at least twice that.
A block is two halos long: a third of the work is done twice, and a record waits for at most 3,000 others."""


@dataclass(frozen=True)
class MaskingRules:
    """What a masker judges: `inputs` by their limits, `sensors` also by their behaviour; `limits`: column → (lowest,
    highest) value that it can truthfully give, `physical_limits` where none is stated; frozen, repeated: whether whole
    records are judged as well."""

    sensors: Sequence[str]
    inputs: Sequence[str] = ()
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    settings: QualitySettings = field(default_factory=QualitySettings)
    frozen: bool = True
    repeated: bool = True

    @property
    def columns(self) -> tuple[str, ...]:
        """All judged columns, inputs first; never `time_s`."""
        return tuple(c for c in dict.fromkeys((*self.inputs, *self.sensors)) if c != "time_s")


@dataclass
class MaskCounts:
    """columns: column → reason → readings masked, each once; readings: column → readings there were;
    frozen, repeated: whole records, counted once and in no column; records: handed out, those frozen included; stuck:
    the runs of stuck readings among those masked."""

    columns: dict[str, Counter[str]] = field(default_factory=dict)
    readings: Counter[str] = field(default_factory=Counter)
    frozen: int = 0
    repeated: int = 0
    records: int = 0
    stuck: list[StuckRun] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Single readings masked; those of frozen records are not among them."""
        return sum(sum(reasons.values()) for reasons in self.columns.values())

    def report_lines(self) -> list[str]:
        """One line per column that lost readings, and for whole records."""
        lines = []
        for column, reasons in self.columns.items():
            lost, why = sum(reasons.values()), ", ".join(f"{reason} {n}" for reason, n in reasons.items() if n)
            if lost:
                lines.append(f"{column}: {lost} of {self.readings[column]} values masked ({why})")
        for reason, n in (("frozen", self.frozen), ("repeated", self.repeated)):
            lines += [f"{n} record{'s' * (n > 1)} {WHOLE_RECORDS[reason]} ({reason})"] if n else []
        return lines

    def add_block(self, recording: Recording, counts: Mapping[str, Mapping[str, int]], frozen: int) -> None:
        """Add what was found in some records."""
        self.records += len(recording)
        self.frozen += frozen
        for column, reasons in counts.items():
            self.readings[column] += len(recording)
            self.columns.setdefault(column, Counter()).update(reasons)


class RecordMasker:
    """Masks the records of ONE file. `add` and `end` hand out what has become final, in order; `counts` says what was
    masked in what was handed out."""

    def __init__(self, judged: MaskingRules):
        self.judged = judged
        self.counts = MaskCounts()
        s = judged.settings
        self.halo = max(HALO, 2 * max(s.dropped_records, s.stuck_records, s.frozen_records))
        self.block = 2 * self.halo
        self._flights = FlightNumbers()
        self._repeats = DuplicateRows()
        self._waiting: list[Recording] = []
        self._before = self._after = 0
        self._span: dict[str, tuple[float, float]] = {}
        self._stuck_at: dict[str, float] = {}
        self._latest = (0, np.nan, 0)  # of the last record kept: line, time, copies
        self._lifeless: set[int] = set()

    def add(self, chunk: Recording) -> list[Recording]:
        """Blocks that have become final by these further records (N,), in file order."""
        if self.judged.repeated and len(chunk):
            again = self._repeats.add(chunk, self._flights.numbers(chunk))
            self._count_repeats(chunk, again)
            chunk = chunk.select(~again) if again.any() else chunk
        if len(chunk) or not self._waiting:
            self._waiting.append(chunk)
            self._after += len(chunk)
        done = []
        while self._after > self.block + self.halo:
            done.append(self._judge(self.block))
        return done

    def _count_repeats(self, chunk: Recording, again: np.ndarray) -> None:
        """Count repeated rows (N,); one that was written again and again, as by a frozen recorder, is no record."""
        if not len(chunk) or "time_s" not in chunk:
            return
        self.counts.repeated += int(again.sum())
        n, time = len(chunk), chunk["time_s"]
        own = np.maximum.accumulate(np.where(again, -1, np.arange(n)))  # the record that a row may be a copy of
        before = own < 0
        copy = again & (time == np.where(before, self._latest[1], time[own]))
        copies = np.bincount(own[copy & ~before], minlength=n)
        enough = max(self.judged.settings.frozen_records - 1, 1)
        line, at, seen = self._latest
        seen += int(np.sum(copy & before))
        found = chunk.line[copies >= enough].tolist()
        self._lifeless |= {*found, *([line] if seen >= enough else [])}
        last = int(own[-1])
        self._latest = (line, at, seen) if last < 0 else (int(chunk.line[last]), float(time[last]), int(copies[last]))

    def end(self) -> list[Recording]:
        """The last block; empty before the first `add`."""
        return [self._judge(self._after)] if self._waiting else []

    def _judge(self, size: int) -> Recording:
        """Judge the next `size` records; `_before` records of halo stand before them in what waits."""
        held = concat(self._waiting)
        context = held.select(slice(0, min(len(held), self._before + size + self.halo)))
        block = slice(self._before, self._before + size)
        clean = self._clean(context, block)
        first = max(0, block.stop - self.halo)
        self._waiting = [held.select(slice(first, None))]
        self._before, self._after = block.stop - first, self._after - size
        return clean

    def _clean(self, context: Recording, block: slice) -> Recording:
        judged, settings = self.judged, self.judged.settings
        own = context.select(block)
        found = {c: find_local_errors(context[c], self._limits(c), settings) for c in judged.columns}
        usable = {c: np.where(np.any(list(f.values()), axis=0), np.nan, context[c]) for c, f in found.items()}
        sensors = [c for c in judged.columns if c not in judged.inputs]
        still = np.zeros(len(context), dtype=bool)
        flights = self._flights.numbers(context)
        held, every = find_held_readings(usable, judged.inputs, flights) if judged.repeated else ({}, 1)
        for column, mask in held.items():
            found[column]["held"] = mask
            usable[column] = np.where(mask, np.nan, usable[column])
        if judged.frozen:
            inputs = [c for c in judged.columns if c in judged.inputs]
            # a recorder that holds every reading for so many records stands still only when it does so for longer
            records = max(settings.frozen_records, 3 * every) if every > 1 else settings.frozen_records
            still = find_frozen(context, flights, sensors, inputs, records)
            if self._lifeless:
                still = still | np.isin(context.line, list(self._lifeless))
            if still.any():
                usable |= {c: np.where(still, np.nan, usable[c]) for c in sensors}
        self._search(usable, sensors, block, found)
        counts, masks = {}, {}
        for column, reasons in found.items():
            masks[column], counts[column] = count_new({why: mask[block] for why, mask in reasons.items()})
            if column not in judged.inputs:
                append_runs(
                    self.counts.stuck, list_stuck_runs(column, own[column], own.line, found[column]["stuck"][block])
                )
                masks[column] = masks[column] | still[block]
        self.counts.add_block(own, counts, int(np.count_nonzero(still[block])))
        return own.with_columns({c: np.where(masks[c], np.nan, own[c]) if masks[c].any() else own[c] for c in masks})

    def _search(
        self,
        usable: Mapping[str, np.ndarray],
        sensors: Sequence[str],
        block: slice,
        found: dict[str, dict[str, np.ndarray]],
    ) -> None:
        settings = self.judged.settings
        for column in sensors:
            x = usable[column]
            mask = np.zeros(len(x), dtype=bool)
            if settings.stuck_records > 0:
                rest = {c: v for c, v in usable.items() if c != column}
                mask = find_stuck(x, rest, settings.stuck_records, self._span.get(column, (np.inf, -np.inf)))
                self._continue_stuck(column, x, mask, block)
            found[column]["stuck"] = mask
            spiked = settings.outlier_sigma > 0.0
            found[column]["outlier"] = (
                find_spikes(x, settings.outlier_sigma) if spiked else np.zeros(len(x), dtype=bool)
            )

    def _continue_stuck(self, column: str, x: np.ndarray, mask: np.ndarray, block: slice) -> None:
        """A sensor that was stuck when the last block ended is so until it moves; keep how this one ends."""
        known = block.start + np.flatnonzero(np.isfinite(x[block]))
        if known.size:
            value = self._stuck_at.get(column)
            if value is not None:
                moved = np.flatnonzero(x[known] != value)
                mask[known[: moved[0] if moved.size else known.size]] = True
            if mask[known[-1]]:
                self._stuck_at[column] = float(x[known[-1]])
            else:
                self._stuck_at.pop(column, None)
            low, high = self._span.get(column, (np.inf, -np.inf))
            self._span[column] = (min(low, float(x[known].min())), max(high, float(x[known].max())))

    def _limits(self, column: str) -> tuple[float, float]:
        return self.judged.limits.get(column) or physical_limits(column)


class LiveMasker:
    """For a file that is still being written, where nobody can wait for a halo: limits, missing values, repeated rows
    and a recorder that has stood still for long enough by now. What takes a look ahead is not searched for."""

    def __init__(self, judged: MaskingRules):
        self.judged = judged
        self.counts = MaskCounts()
        self._flights = FlightNumbers()
        self._repeats = DuplicateRows()
        self._held = RepeatWatch()
        sensors = [c for c in judged.columns if c not in judged.inputs]
        inputs = [c for c in judged.columns if c in judged.inputs]
        self.watch = FrozenWatch(sensors, inputs, judged.settings.frozen_records if judged.frozen else 0)

    def add(self, chunk: Recording) -> list[Recording]:
        """The records (N,) with unusable values set to NaN, without those that were there already."""
        if self.judged.repeated and len(chunk):
            again = self._repeats.add(chunk, self._flights.numbers(chunk))
            self.counts.repeated += int(again.sum())
            chunk = chunk.select(~again) if again.any() else chunk
        still = self.watch.add(chunk)
        columns, counts = {}, {}
        whole = QualitySettings(dropped_records=0)  # how long a gap lasts depends on what comes
        sensors = {c: chunk[c] for c in self.judged.columns if c not in self.judged.inputs}
        held = self._held.add(sensors, chunk.line) if self.judged.repeated else {}
        self.counts.stuck = list(self._held.stuck)
        for column in self.judged.columns:
            limits = self.judged.limits.get(column) or physical_limits(column)
            reasons = find_local_errors(chunk[column], limits, whole)
            mask, counts[column] = count_new({**reasons, "held": held[column]} if column in held else reasons)
            mask = mask if column in self.judged.inputs else mask | still
            columns[column] = np.where(mask, np.nan, chunk[column])
        self.counts.add_block(chunk, counts, int(np.count_nonzero(still)))
        return [chunk.with_columns(columns)]

    def end(self) -> list[Recording]:
        """Nothing: all has been handed out."""
        return []


def find_local_errors(
    values: np.ndarray, limits: tuple[float, float], settings: QualitySettings
) -> dict[str, np.ndarray]:
    """Reason → mask (N,) of what a column's own values (N,) show: missing, dropped, out of limits."""
    absent = ~np.isfinite(values)
    dropped = long_runs(absent, settings.dropped_records) if settings.dropped_records else np.zeros(len(values), bool)
    return {
        "missing": absent & ~dropped,
        "dropped": dropped,
        "out of limits": ~absent & ((values < limits[0]) | (values > limits[1])),
    }


def mask_chunks(chunks: Iterable[Recording], masker: RecordMasker | LiveMasker) -> Iterator[Recording]:
    """The records of one file's chunks, masked; `masker.counts` is complete when the iterator ends."""
    for chunk in chunks:
        yield from masker.add(chunk)
    yield from masker.end()


def mask_recording(recording: Recording, judged: MaskingRules) -> tuple[Recording, MaskCounts]:
    """A whole file (N records) masked as its stream would be, without repeated rows."""
    masker = RecordMasker(judged)
    return concat(list(mask_chunks([recording], masker))), masker.counts


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
