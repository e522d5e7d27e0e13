"""Windows that follow each other or move, cut along a grid of blocks so that a window is a sum of blocks.

A window never reaches across two flights or engines: each has its own `WindowAssembler`. Records or pieces of
records come in order and in chunks of any size; memory holds one window.

**Which records can be judged.** They have inputs and a reading, and are inside the identified envelope. Beyond it a
model whose error begins to grow there still answers, with limits widened accordingly, up to a distance
at which its error is not known any more (`Envelope.reachable`).

`WindowStatistics` is one window: its statistics, and what was counted, rejected, flown and read in it.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from math import gcd, inf
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from enginediag_cli.engine.instrument_errors import ELAPSED
from enginediag_cli.error_model.maps import MapErrorModel
from enginediag_cli.errors import DataError
from enginediag_cli.intake.agreement import RecordingMismatch
from enginediag_cli.intake.loader import GrossCounts
from enginediag_cli.recordings.table import Recording, find_missing_columns
from enginediag_cli.residuals.instruments import InstrumentFault
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import LocalStatistics

KEYS = ("flight", "engine")
HOUR_S = 3600.0
"""Seconds of an hour."""
Key = tuple[str, str, str]


def group_rows(recording: Recording) -> list[tuple[Key, np.ndarray]]:
    """Row numbers (n,) of each (file, flight, engine) of a chunk, in order of first appearance.

    The key holds an empty text where the recording has no such column.
    """
    labels = []
    for column in KEYS:
        if column in recording.text:
            labels.append(list(recording.text[column]))
        elif column in recording.columns:
            labels.append([f"{value:g}" for value in recording.columns[column]])
        else:
            labels.append([""] * len(recording))
    rows: dict[Key, list[np.ndarray]] = {}
    first = 0
    for (flight, engine), same in groupby(zip(*labels, strict=True)):  # records of a flight mostly follow each other
        stop = first + len(list(same))
        rows.setdefault((recording.source, flight, engine), []).append(np.arange(first, stop))
        first = stop
    return [(key, np.concatenate(stretches)) for key, stretches in rows.items()]


@dataclass
class Timeline:
    """Position of the records of one group across chunks (count, or seconds since the first), and lags."""

    count: int = 0
    first_time: float = float("nan")
    last_time: float = float("nan")
    interval: float = float("nan")
    breaks: int = field(default=0)

    def advance(self, n: int, time: np.ndarray | None, in_time: bool) -> tuple[np.ndarray, np.ndarray]:
        """Positions (n,) for the window grid and lags (n,), steps since the record before.

        Without times every record is one step. A step of time is the median interval of the first chunk; time
        that runs backwards starts a new stretch, unrelated to the one before.
        """
        start = self.count
        self.count += n
        lags = np.ones(n)
        if time is None or not np.all(np.isfinite(time)):
            if start == 0 and n:
                lags[0] = np.inf
            return np.arange(start, self.count, dtype=float), lags
        if start == 0 and n:
            self.first_time = float(time[0])
        steps = np.diff(np.concatenate([[self.last_time], time]))
        if not np.isfinite(self.interval):
            forward = steps[np.isfinite(steps) & (steps > 0)]
            self.interval = float(np.median(forward)) if forward.size else float("nan")
        if np.isfinite(self.interval):
            lags = np.maximum(np.round(steps / self.interval), 1.0)
        lags = np.where(np.isnan(steps) | (steps < 0), np.inf, lags)
        self.breaks += int(np.sum(steps < 0))
        self.last_time = float(time[-1])
        position = time - self.first_time if in_time else np.arange(start, self.count, dtype=float)
        return position, lags


@dataclass
class FlightHours:
    """Writes into recordings how many hours lie between each record and the first of its flight; 0 without times."""

    _first: dict[Key, float] = field(default_factory=dict)

    def add_hours(self, recordings: Iterable[Recording]) -> Iterator[Recording]:
        """Chunks of files in turn with the column `ELAPSED`."""
        for chunk in recordings:
            hours = np.zeros(len(chunk))
            time = chunk.columns.get("time_s")
            if time is not None:
                for key, rows in group_rows(chunk):
                    known = rows[np.isfinite(time[rows])]
                    if known.size:
                        first = self._first.setdefault(key, float(time[known[0]]))
                        hours[known] = (time[known] - first) / HOUR_S
            yield chunk.with_columns({ELAPSED: hours})


Piece = TypeVar("Piece")

UNITS = {"": None, "s": 1.0, "min": 60.0, "h": 3600.0}
UNITS_TEXT = "a number of records (60) or a time (300s, 10min, 1h)"


@dataclass(frozen=True)
class WindowPlan:
    """Windows of `length`, one every `step`, in records or, if `in_time`, seconds; inf: the whole flight.

    whole_flights: only a recording without flights is cut so, each flight of another is one window."""

    length: float = inf
    step: float = inf
    in_time: bool = False
    whole_flights: bool = False

    def flight_plan(self, flight: str) -> WindowPlan:
        """The plan for the records of one flight, "" where the recording states none."""
        return WindowPlan() if self.whole_flights and flight else self

    @property
    def series_plan(self) -> WindowPlan:
        """The plan for a series: where each flight is one window, each record of a recording without flights is."""
        return WindowPlan(1, 1, whole_flights=True) if self.is_whole_flight else self

    @property
    def is_whole_flight(self) -> bool:
        """Whether each flight is one window."""
        return self.length == inf

    @property
    def grid(self) -> float:
        """Length of a block: the largest that divides both length and step (1 ms is the finest time)."""
        if self.length == inf:
            return inf
        unit = 1000 if self.in_time else 1
        return gcd(round(self.length * unit), round(self.step * unit)) / unit

    def blocks(self, position: np.ndarray) -> np.ndarray:
        """Number of the block of each record at `position` (N,): its count, or seconds since the first."""
        if self.grid == inf:
            return np.zeros(len(position), int)
        return np.floor(position / self.grid + 1e-9).astype(int)


def plan_windows(length: str | None, step: str | None = None) -> WindowPlan:
    """Read a plan of windows from texts.

    Parameters
    ----------
    length : str or None
        "60" (records) or "10min"; None for whole flights.
    step : str, optional
        Distance of windows; by default the length, so that windows follow each other.

    Returns
    -------
    WindowPlan

    Raises
    ------
    ValueError
        With what is wrong with the text.
    """
    if length is None:
        if step is not None:
            raise ValueError("a step needs a window length")
        return WindowPlan()
    size, in_time = _amount(length)
    pace, pace_in_time = (size, in_time) if step is None else _amount(step)
    if pace_in_time != in_time:
        raise ValueError("window and step must both be records or both be times")
    if pace > size:
        raise ValueError("a step longer than the window would skip records")
    return WindowPlan(size, pace, in_time)


def _amount(text: str) -> tuple[float, bool]:
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(s|min|h|)\s*", text)
    if not match:
        raise ValueError(f"{text!r} is not {UNITS_TEXT}")
    factor = UNITS[match[2]]
    value = float(match[1]) * (factor or 1.0)
    if value < (0.001 if factor else 1) or (factor is None and value != int(value)):
        raise ValueError(f"{text!r} is not {UNITS_TEXT}")
    return value, factor is not None


class WindowAssembler(Generic[Piece]):
    """Collects pieces by block number; hands back each window, as the list of its pieces, once complete."""

    def __init__(self, plan: WindowPlan):
        whole = plan.grid == inf
        self._span = 1 if whole else round(plan.length / plan.grid)
        self._stride = 1 if whole else round(plan.step / plan.grid)
        self._pieces: deque[tuple[int, Piece]] = deque()
        self._first = 0  # first block of the window being filled
        self._uncovered = False  # a piece has come that no finished window holds

    @property
    def pieces(self) -> list[Piece]:
        """Those of the window being filled."""
        return [piece for _, piece in self._pieces]

    def push(self, block: int, piece: Piece) -> list[list[Piece]]:
        """Add a piece of block number `block` (never descending); returns the windows now complete."""
        finished = []
        while block >= self._first + self._span:
            finished += self.flush()
            behind = block - self._span - self._first
            self._first += self._stride * (1 if self._pieces else max(behind // self._stride, 1))
            while self._pieces and self._pieces[0][0] < self._first:
                self._pieces.popleft()
        self._pieces.append((block, piece))
        self._uncovered = True
        return finished

    def flush(self) -> list[list[Piece]]:
        """The window being filled, complete or not, if it holds something that no window before it held."""
        if not self._uncovered:
            return []
        self._uncovered = False
        return [self.pieces]


def check_inputs(monitor: Monitor, recording: Recording) -> None:
    """DataError unless the recording has every input column and at least one sensor of the monitor."""
    if missing := find_missing_columns(monitor.engine.inputs, recording.columns):
        words = ", ".join(map(str, missing))
        raise DataError(f"{recording.source}: no column {words}, which {monitor.engine.name} needs")
    if not any(c in recording.columns for c in monitor.sensors):
        raise DataError(f"{recording.source}: none of the sensors {', '.join(monitor.sensors)}")


class Extrapolation(NamedTuple):
    """Where records lie that training did not cover: the input that is farthest beyond its range, "" where it is their
    combination, and whether they are judged all the same."""

    column: str
    judged: bool


@dataclass(frozen=True)
class JudgedInputs:
    """Inputs (N,) by column, measurements y (N, m), masks (N,): incomplete, outside (too far to be judged), and beyond:
    not covered by training, judged or not. columns: of `beyond_by`, (N,), −1 for a combination."""

    inputs: dict[str, np.ndarray]
    y: np.ndarray
    incomplete: np.ndarray
    outside: np.ndarray
    uncovered: np.ndarray
    uncovered_column: np.ndarray
    columns: tuple[str, ...]

    @property
    def judged(self) -> np.ndarray:
        """Which records can be judged, (N,)."""
        return ~self.incomplete & ~self.outside

    def select(self, rows: np.ndarray) -> JudgedInputs:
        """Some of the records."""
        inputs = {c: v[rows] for c, v in self.inputs.items()}
        y, incomplete, outside = self.y[rows], self.incomplete[rows], self.outside[rows]
        return JudgedInputs(
            inputs, y, incomplete, outside, self.uncovered[rows], self.uncovered_column[rows], self.columns
        )

    def count_extrapolation(self, rows: slice | np.ndarray) -> Counter[Extrapolation]:
        """Of some records: how many lie where."""
        found: Counter[Extrapolation] = Counter()
        if not self.uncovered[rows].any():
            return found
        for judged in (True, False):
            here = self.uncovered[rows] & (self.outside[rows] != judged)
            for j, n in zip(*np.unique(self.uncovered_column[rows][here], return_counts=True), strict=True):
                found[Extrapolation(self.columns[j] if j >= 0 else "", judged)] += int(n)
        return found


def select_inputs(monitor: Monitor, recording: Recording, *, widening: bool = True) -> JudgedInputs:
    """What can be judged of a recording. widening: whether limits become as wide as the error of the model is beyond
    what training covered, where that is known."""
    engine, N = monitor.engine, len(recording)
    inputs = {c: recording.columns[c] for c in engine.inputs}
    for column, default in engine.optional_inputs.items():
        values = recording.columns.get(column, np.full(N, default))
        inputs[column] = np.where(np.isfinite(values), values, default)
    y = np.column_stack([recording.columns.get(c, np.full(N, np.nan)) for c in monitor.sensors])
    y = np.where(np.isfinite(y), y, np.nan)
    complete = np.all([np.isfinite(inputs[c]) for c in engine.inputs], axis=0) & np.isfinite(y).any(axis=1)
    outside, beyond, by, columns = np.zeros(N, bool), np.zeros(N, bool), np.full(N, -1), tuple[str, ...]()
    envelope = monitor.envelope
    if envelope is not None and N:
        columns = envelope.inputs
        distance = np.asarray(envelope.distance(inputs))
        beyond = complete & ~(distance <= envelope.threshold)
        outside = beyond
        if beyond.any():
            if widening and isinstance(monitor.engine, MapErrorModel):
                outside = complete & ~envelope.reachable(inputs, distance)
            by[beyond] = envelope.farthest_input({c: inputs[c][beyond] for c in columns})
    for control, unclear in getattr(engine, "undecided", lambda _: {})(inputs).items():
        columns = (*columns, f"whether {control} acts")
        by[complete & unclear] = len(columns) - 1
        outside, beyond = outside | complete & unclear, beyond | complete & unclear
    return JudgedInputs(inputs, y, ~complete, outside, beyond, by, columns)


@dataclass(frozen=True)
class NominalResiduals:
    """N records compared with nominal, before any change is estimated: `inputs`, column -> (N,), what the engine
    freezes at nominal among them; readings y (N, m), NaN where there is none; predicted (N, m), J (N, m, p); ok (N,):
    those that the engine can compute; x: its unknowns (nx, N) there, None where it shows none."""

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    predicted: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    x: np.ndarray | None

    @property
    def e(self) -> np.ndarray:
        """Residuals (N, m), NaN where there is none."""
        return np.where(self.ok[:, None], self.y - self.predicted, np.nan)

    def select(self, some: slice | np.ndarray) -> NominalResiduals:
        """Some of the records."""
        inputs = {c: np.asarray(v)[some] for c, v in self.inputs.items()}
        x = None if self.x is None else self.x[:, some]
        return NominalResiduals(inputs, self.y[some], self.predicted[some], self.J[some], self.ok[some], x)


def nominal_residuals(
    monitor: Monitor, inputs: Mapping[str, np.ndarray], y: np.ndarray, distinct: np.ndarray | None = None
) -> NominalResiduals:
    """Records that are judged compared with nominal: inputs (N,) by column and readings y (N, m). distinct (N,): number
    of each record, where windows share some."""
    rows = slice(None) if distinct is None else np.unique(distinct, return_index=True)[1]
    asked = {c: v[rows] for c, v in inputs.items()}
    predicted, J, ok, prediction = monitor.predict(asked, monitor.theta0)
    # a fault is hypothesised with the errors of the maps where nominal has the machines: see `error_model.maps`
    known = {**asked, **getattr(prediction, "frozen", {})}
    # unknowns of the engine, from which the next solution is near
    found = NominalResiduals(known, y[rows], predicted, J, np.asarray(ok), getattr(prediction, "x", None))
    return found if distinct is None else found.select(np.unique(distinct, return_inverse=True)[1])


@dataclass(frozen=True)
class WindowStatistics:
    """Statistics of the monitored parameters over one window; `statistics` is None where there is no verdict.

    records: in the window; outside: too far from the operating points seen; elsewhere: how many were not seen, by where
    they lie and whether they are judged; incomplete: without an input or without any reading; failed: not computed by
    the engine; reason: why there is no verdict, or empty. sensors: how many of the `sensors_of` that the nominal has
    gave a reading in a record that was judged (0 of 0: not known); silent: the monitored errors of those that gave
    none, of which nothing can be said and which are no suspects. conditions: mean of each input over the
    records that were judged; readings: mean of each sensor over them; flown: inputs of a few of them, evenly chosen,
    column -> (k,), and read: their readings (k, m), NaN where missing; of so few records as cannot be checked against
    each other these are all. checked: whether they could be, for gross errors.
    solution: the engine's unknowns (nx, n) at nominal in the records that were judged, where
    they are known, from which whoever asks the engine again of these records may begin. gross: readings and records
    that were rejected as gross errors. instruments: those that are stuck or scatter; weights (n, m, m): what multiplies
    the readings of each record that was judged, where some scatter. disagreement: that the recording is hardly of this
    engine, or in these units, which was accepted.
    """

    source: str
    flight: str
    engine: str
    first_line: int
    last_line: int
    start_s: float
    end_s: float
    records: int
    outside: int
    incomplete: int
    failed: int
    statistics: LocalStatistics | None
    reason: str = ""
    notes: tuple[str, ...] = ()
    sensors: int = 0
    sensors_of: int = 0
    silent: tuple[str, ...] = ()
    extrapolation: Counter[Extrapolation] = field(default_factory=Counter)
    conditions: Mapping[str, float] = field(default_factory=dict)
    readings: Mapping[str, float] = field(default_factory=dict)
    sample_inputs: Mapping[str, np.ndarray] = field(default_factory=dict, repr=False, compare=False)
    sample_readings: np.ndarray | None = field(default=None, repr=False, compare=False)
    checked: bool = True
    solution: np.ndarray | None = field(default=None, repr=False, compare=False)
    gross: GrossCounts = field(default_factory=GrossCounts)
    instruments: tuple[InstrumentFault, ...] = ()
    weights: np.ndarray | None = field(default=None, repr=False, compare=False)
    disagreement: RecordingMismatch | None = field(default=None, repr=False, compare=False)

    def drop_parameters(self, names: Collection[str]) -> WindowStatistics:
        """The window without the suspects `names` and those that are silent, in its statistics, too."""
        silent = tuple(dict.fromkeys((*self.silent, *names)))
        statistics = self.statistics and self.statistics.drop_parameters(silent)
        return replace(self, silent=silent, statistics=statistics)

    @property
    def is_doubtful(self) -> bool:
        """Whether the recording is likelier wrong than the engine."""
        return self.disagreement is not None and self.disagreement.is_likely_wrong

    @property
    def counts(self) -> dict[str, int]:
        """What is counted of a window, and summed over many."""
        return {
            "windows": 1,
            "statistics": self.statistics is not None,
            "records": self.records,
            "outside": self.outside,
            "incomplete": self.incomplete,
            "failed": self.failed,
        }

    @property
    def extrapolated(self) -> int:
        """Records that are judged although training did not cover where they lie."""
        return sum(n for where, n in self.extrapolation.items() if where.judged)


def unread_window(source: str, reason: str) -> WindowStatistics:
    """A recording that could not be read, or not to its end, in the place of its windows."""
    nan = float("nan")
    return WindowStatistics(source, "", "", 0, 0, nan, nan, 0, 0, 0, 0, None, reason)


def join_bookkeeping(parts: Sequence[WindowStatistics]) -> WindowStatistics:
    """Bookkeeping of a window from that of its pieces, in order."""
    first, last = parts[0], parts[-1]

    def total(name: str) -> int:
        return sum(getattr(part, name) for part in parts)

    return replace(
        first,
        last_line=last.last_line,
        end_s=last.end_s,
        records=total("records"),
        outside=total("outside"),
        incomplete=total("incomplete"),
        failed=total("failed"),
        extrapolation=sum((part.extrapolation for part in parts), Counter()),
        instruments=tuple(fault for part in parts for fault in part.instruments),
    )


def describe_excluded(window: WindowStatistics) -> str:
    """Why a window has no verdict, where none of its records could be judged."""
    counts = [
        (window.outside, "outside the operating points identified"),
        (window.incomplete, "incomplete"),
        (window.failed, "not computed by the engine"),
    ]
    return "no record could be judged: " + ", ".join(f"{n} {what}" for n, what in counts if n)


Pieces = Callable[[Recording, JudgedInputs, Key, np.ndarray, np.ndarray], Iterable[tuple[int, Piece]]]
"""pieces(records of one group in one chunk, what is judged of them, group, block (n,) and lag (n,) of each record) ->
number and piece of each block."""


def cut_windows(
    monitor: Monitor,
    recordings: Iterable[Recording],
    plan: WindowPlan,
    pieces: Pieces[Piece],
    keep: Callable[[list[Piece]], None] = lambda pieces: None,
) -> Iterator[list[list[Piece]]]:
    """The windows that each chunk completes, each as its pieces; chunks of one file come in order. keep: is shown the
    pieces of each window that goes on, after every chunk.

    Raises DataError when a recording lacks an input of the engine, or a time that windows in time need.
    """
    assemblers: dict[Key, WindowAssembler[Piece]] = {}
    timelines: dict[Key, Timeline] = {}
    source = None
    for recording in recordings:
        complete: list[list[Piece]] = []
        if recording.source != source:  # a new file: what was open in the old one is complete
            complete.extend(window for assembler in assemblers.values() for window in assembler.flush())
            assemblers, timelines, source = {}, {}, recording.source
        check_inputs(monitor, recording)
        groups = group_rows(recording)
        taken = select_inputs(monitor, recording)
        # a flight of which a whole chunk tells nothing has ended: memory holds the flights of one chunk
        for ended in [key for key in assemblers if key not in dict(groups)]:
            complete.extend(assemblers.pop(ended).flush())
            del timelines[ended]
        for key, rows in groups:
            mine = plan.flight_plan(key[1])
            assembler = assemblers.setdefault(key, WindowAssembler(mine))
            part = recording.select(rows)
            position, lags = _grid_positions(timelines.setdefault(key, Timeline()), part, mine)
            for number, piece in pieces(part, taken.select(rows), key, mine.blocks(position), lags):
                complete.extend(assembler.push(number, piece))
            keep(assembler.pieces)
        yield complete
    yield [window for assembler in assemblers.values() for window in assembler.flush()]


def _grid_positions(timeline: Timeline, part: Recording, plan: WindowPlan) -> tuple[np.ndarray, np.ndarray]:
    """Position for the grid of the plan (n,), and lag (n,), of records."""
    time = part.columns.get("time_s")
    if plan.in_time and (time is None or not np.all(np.isfinite(time))):
        raise DataError(f"{part.source}: windows in time need a column time_s without gaps")
    position, lags = timeline.advance(len(part), time, plan.in_time)
    if plan.in_time and timeline.breaks:
        raise DataError(
            f"{part.source}: time_s runs backwards; windows in time need one stretch of "
            "time per flight (a column `flight` separates flights)"
        )
    return position, lags
