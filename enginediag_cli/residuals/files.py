"""Windows of files: recordings are reduced to sufficient statistics, statistics that `residual` wrote are read back.

**Reference.** An engine's own early records may be the reference of its later ones. Engines of one type differ from the
nominal engine, and from each other, before anything goes wrong. What they differ by, x ~ N(0, C) with C the uncertainty
of nominal and of sensor offsets, is estimated from records believed healthy, s₀ ~ N(F₀ x, F₀), and taken out of every
later window of the same engine:

    x̂ = C₁ s₀        C₁ = (F₀ + C⁻¹)⁻¹        s ← s − F x̂        C ← C₁

**Files of statistics** are read back if they are whole and unedited, of one nominal and one setting, each window once.
Several files may have been put together with `cat`: their `#` lines and repeated headers are passed over.

**Sums** over windows, flights and files, and what is marginalised at which level. Of s ~ N(F (Δθ, x), V) with Δθ what
is monitored and x ~ N(0, C) what is uncertain beside it, the sums s, F, V and N of two windows add as long as both
contain x. x is of two kinds:

- *common*: nominal as identified, errors of its maps: one draw for all windows. It stays a parameter in every sum, in
  unit normals (`reduced.py`), and is marginalised last, once.
- *own*: errors of instruments that each recording has anew. Windows of one recording are added first, then it is
  marginalised, then recordings are added.

V of two windows that follow each other in one recording lacks what noise that is correlated from record to record adds
across their border. At nominal the sum is that of the whole; windows that are linearised at their own estimates are
carried back to θ0, and their sum is about all these points, not about the estimate of the whole.
"""

from __future__ import annotations

import csv
import gzip
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, islice
from typing import Any

import numpy as np

from enginediag_cli.engine.instrument_errors import DRIFT, ELAPSED
from enginediag_cli.errors import DataError, NoVerdictError
from enginediag_cli.intake.loader import LoadedFile, RecordingLoader
from enginediag_cli.parameters import Parameter
from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.residuals.flat import (
    CHECKSUM,
    DIGITS,
    StatisticsOrigin,
    checksum,
    is_flat,
    plan_cells,
    read_flat,
    read_origin,
)
from enginediag_cli.residuals.gross_gate import GrossErrorGate
from enginediag_cli.residuals.monitor import Monitor, Offset
from enginediag_cli.residuals.pipeline import Condense, condense_statistics, window_statistics
from enginediag_cli.residuals.reduced import (
    MonitorCache,
    ReducedMonitor,
    add_sensor_lags,
    keep_monitored,
    reduce_monitor,
)
from enginediag_cli.residuals.score import drop_nuisance, marginalise_nuisance
from enginediag_cli.residuals.statistics import LocalStatistics, covariance_root
from enginediag_cli.residuals.windows import (
    KEYS,
    Extrapolation,
    FlightHours,
    Key,
    WindowPlan,
    WindowStatistics,
    check_inputs,
    group_rows,
    select_inputs,
    unread_window,
)

MAKE_ANEW = "make them anew with `enginediag residual` from the recordings"
IGNORED = {
    "window": "--window",
    "step": "--step",
    "linearise": "--linearise",
    "monitor": "--monitor",
    "recorder": "--recorder",
    "engine_instance": "--engine-instance",
    "reference": "--reference",
    "last": "--last",
    "model_error": "--model-error",
}
"""Choices that were made when the statistics were, and the options that make them."""

Span = tuple[int, int]
Place = tuple[str, str, str]


@dataclass
class Ledger:
    """What one run has read of statistics. nominal: fingerprint of the nominal given beside them, "" for none;
    summed: windows of one flight are added up, so that no record may be in two of them.

    repeated: rows excluded, since they had been there before; overlapping: windows that share records with another,
    though none were asked for that do (two recordings of one name, or one made twice).
    """

    nominal: str = ""
    summed: bool = False
    repeated: int = 0
    overlapping: int = 0
    _origin: tuple[StatisticsOrigin, str] | None = None
    _rows: set[str] = field(default_factory=set)
    _spans: dict[Place, list[Span]] = field(default_factory=dict)

    def admit(self, row: Mapping[str, str], place: str) -> bool:
        """Whether a row may count, and not only repeats an earlier one. DataError names the place of one that is
        edited, old, or made otherwise than the rest."""
        made = read_origin(row)
        if made is None or not row.get(CHECKSUM):
            raise DataError(f"{place}: the row does not say how it was made, nor its checksum: {MAKE_ANEW}")
        if checksum(row) != row[CHECKSUM]:
            what = "the row's checksum does not fit: it was edited after residual wrote it"
            raise DataError(f"{place}:{CHECKSUM}: {what}; {MAKE_ANEW}")
        if self.nominal and made.nominal != self.nominal:
            raise DataError(f"{place}: made with another nominal than the one given; {MAKE_ANEW}")
        first, where = self._origin or (made, place)
        self._origin = first, where
        if differ := made.differences(first):
            what = "; ".join(f"{IGNORED.get(n, n)} {a or 'none'}, there {b or 'none'}" for n, a, b in differ)
            raise DataError(f"{place}: made otherwise than {where}: {what}; {MAKE_ANEW}, all alike")
        # the same records under another file's name give the same numbers; without statistics nothing shows it
        content = checksum(row, without=("source",) if row.get("n", "").strip() else ())
        if content in self._rows:
            self.repeated += 1
            return False
        self._rows.add(content)
        return True

    def place(self, window: WindowStatistics, place: str) -> None:
        """Note the records of a window. DataError when windows are added up and this one shares some with another."""
        if window.statistics is None or self._origin is None:
            return
        if self._origin[0].overlapping and not self.summed:
            return
        spans = self._spans.setdefault((window.source, window.flight, window.engine), [])
        span = (window.first_line, window.last_line)
        latest = spans[0][1] if spans else 0
        shared = span[0] <= latest and any(first <= span[1] and span[0] <= last for first, last in spans[1:])
        spans[:1] = [
            (0, max(latest, span[1]))
        ]  # the first entry holds the last line of all: most windows come in order
        spans.append(span)
        if shared and self.summed:
            raise DataError(
                f"{place}: lines {span[0]} to {span[1]} of {window.source} belong to another window, too, and would "
                "count twice: windows that overlap, or two recordings of one name, cannot be added up"
            )
        self.overlapping += shared


def read_statistics(
    lines: Iterable[str], source: str, ledger: Ledger
) -> Iterator[tuple[WindowStatistics, dict[str, Parameter]]]:
    """Windows, and what their parameters are, of an open file of statistics, each once.

    Raises DataError naming file and line.
    """
    for row, line in _rows(lines, source):
        place = f"{source}:{line}"
        if ledger.admit(row, place):
            for window, known in read_flat([row], source, [line]):
                ledger.place(window, place)
                yield window, known


def refuse_ignored_options(given: Mapping[str, object], source: str) -> None:
    """DataError when options are given that statistics, which are made already, would ignore.

    given: name of a choice as in `IGNORED` → whether the user made it.
    """
    options = [option for name, option in IGNORED.items() if given.get(name)]
    if options:
        raise DataError(
            f"{source} holds statistics, for which {', '.join(options)} would do nothing: give the option to "
            "`enginediag residual`, which makes them"
        )


class _Uncommented:
    """Lines of a CSV file without the `#` lines outside quotes; `number` is that of the line read last."""

    def __init__(self, lines: Iterable[str]):
        self._lines = iter(lines)
        self._quoted = False
        self.number = 0

    def __iter__(self) -> Iterator[str]:
        return self

    def __next__(self) -> str:
        for text in self._lines:
            self.number += 1
            text = text.lstrip("\ufeff") if not self._quoted else text
            if not self._quoted and text.startswith("#"):
                continue
            self._quoted ^= text.count('"') % 2 == 1
            return text
        raise StopIteration


def _rows(lines: Iterable[str], source: str) -> Iterator[tuple[dict[str, str], int]]:
    """Rows by column, and the line on which each begins."""
    bare = _Uncommented(lines)
    reader = csv.reader(bare, strict=True)
    header: list[str] | None = None
    try:
        while True:
            before = bare.number
            row = next(reader, None)
            if row is None:
                return
            line = min(before + 1, bare.number) if any("\n" in cell for cell in row) else bare.number
            cells = [cell.strip() for cell in row]
            if not any(cells):
                continue
            if header is None or cells == header:
                header = _checked_header(cells, source, line)
            elif is_flat(cells):
                raise DataError(
                    f"{source}:{line}: another header in the middle of the file "
                    f"({_header_difference(header, cells)}): the rows below it hold other statistics than those above; "
                    f"{MAKE_ANEW}, all alike"
                )
            elif len(row) != len(header):
                raise DataError(f"{source}:{line}: {len(row)} fields where the header has {len(header)}")
            else:
                yield dict(zip(header, row, strict=True)), line
    except csv.Error as error:
        raise DataError(f"{source}:{bare.number}: {error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{source}: not UTF-8 text ({error.reason})") from error
    except (gzip.BadGzipFile, EOFError) as error:
        raise DataError(f"{source}: damaged gzip file ({error})") from error


def _checked_header(cells: Sequence[str], source: str, line: int) -> list[str]:
    for position, cell in enumerate(cells):
        if not cell:
            raise DataError(f"{source}:{line}: column {position + 1} has no name")
        if cells.index(cell) != position:
            raise DataError(f"{source}:{line}:{cell}: two columns have this name")
    return list(cells)


def _header_difference(header: Sequence[str], cells: Sequence[str]) -> str:
    more = [c for c in cells if c not in header]
    fewer = [c for c in header if c not in cells]
    if not more and not fewer:
        return "its columns are in another order"
    return "; ".join(f"{what} {', '.join(names[:3])}" for what, names in (("new", more), ("gone", fewer)) if names)


def keep_nuisance(monitor: Monitor, *, alone: bool = True) -> Condense:
    """Statistics of all parameters of a monitor. alone: windows may be judged by themselves, and have how uncertain the
    noise is, and what wrong slopes make of a change, as the window alone has them, marginalised."""
    a = len(monitor.monitored)
    own = monitor.names[len(monitor.names) - len(monitor.offsets) :]

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        single = condense_statistics(monitor, statistics, monitor.uncertainty) if alone else None
        slopes = None if single is None else single.slopes
        whole = statistics if isinstance(monitor, ReducedMonitor) else _to_unit_normals(monitor, statistics)
        p = len(whole.parameters)
        whole = replace(
            whole,
            by_sensor=None,
            rows=None,
            kurtosis=None,
            points=None,
            doubt=(0.0, 0.0, 0.0) if single is None else single.doubt,
            additive=True,
            slopes=None if slopes is None else np.pad(slopes, (0, p - a)),
            common=whole.parameters[a : p - len(own)],
            own=own,
        )
        return replace(window, statistics=whole)

    return condense


def count_nuisance(monitor: Monitor) -> int:
    """How many parameters `keep_nuisance` statistics have beside the monitored ones."""
    k = len(monitor.names) - len(monitor.offsets)
    if isinstance(monitor, ReducedMonitor):
        return len(monitor.names) - len(monitor.monitored)
    return covariance_root(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k]).shape[1] + len(monitor.offsets)


def _to_unit_normals(monitor: Monitor, statistics: LocalStatistics) -> LocalStatistics:
    """The statistics with unit normals n in place of what is uncertain but for offsets, x = L n with L Lᵀ = C:

    s' = Tᵀ s,   F' = Tᵀ F T,   V' = Tᵀ V T,   T = (1, L) for the monitored and the normals.
    """
    a, k, p = len(monitor.monitored), len(monitor.names) - len(monitor.offsets), len(monitor.names)
    root = covariance_root(monitor.uncertainty[:k, :k], monitor.prior_sigma[:k])
    r = root.shape[1]
    T = np.zeros((p, a + r + p - k))
    T[:a, :a], T[:k, a : a + r], T[k:, a + r :] = np.eye(a), root, np.eye(p - k)
    return replace(
        statistics,
        parameters=(*monitor.monitored, *(f"nominal.{i + 1}" for i in range(r)), *monitor.names[k:]),
        theta0=np.concatenate([statistics.theta0[:a], np.zeros(r + p - k)]),
        prior_sigma=np.concatenate([statistics.prior_sigma[:a], np.ones(r), statistics.prior_sigma[k:]]),
        s=T.T @ statistics.s,
        F=T.T @ statistics.F @ T,
        V=T.T @ statistics.V @ T,
    )


PLAUSIBLE_SCALE = 0.01
"""Unit in which an added scale offset is measured; it only has to be of the right order."""


def add_scale_offsets(monitor: Monitor, sigma: float = 0.0) -> Monitor:
    """The monitor with a scale offset for every sensor; those added have standard deviation `sigma`."""
    have = {o.sensor for o in monitor.offsets if o.kind == "scale"}
    added = tuple(Offset(j, "scale") for j in range(len(monitor.sensors)) if j not in have)
    k = len(added)
    names = [f"offset.{monitor.sensors[o.sensor]}.scale" for o in added]
    return monitor.add_nuisance(names, np.full(k, PLAUSIBLE_SCALE), sigma**2 * np.eye(k), added)


OWN_SCALE = 0.01
"""By how much the readings of one engine plausibly differ from those of its type, where nominal does not say."""

OWN_HEALTH = 0.25
"""By how much a new engine's monitored parameters plausibly differ from those of its type, as a share of a
plausible change: half a per cent of efficiency, by manufacture and initial wear."""


@dataclass(frozen=True)
class LearnedReference:
    """`shift` x̂ (p,) from nominal and its covariance `uncertainty` C₁ (p, p), in parameter units."""

    shift: np.ndarray
    uncertainty: np.ndarray

    def subtract_shift(self, statistics: LocalStatistics) -> LocalStatistics:
        """The statistics of residuals from which J x̂ is subtracted."""
        moved = statistics.F @ self.shift
        return replace(
            statistics,
            s=statistics.s - moved,
            chi2=statistics.chi2 - 2 * float(self.shift @ statistics.s) + float(self.shift @ moved),
        )


def learn_reference(statistics: LocalStatistics, uncertainty: np.ndarray) -> LearnedReference:
    """Reference from the statistics of all p parameters over healthy records; C (p, p) may be singular."""
    root = covariance_root(uncertainty, statistics.prior_sigma)
    inner = np.eye(root.shape[1]) + root.T @ statistics.F @ root
    gain = np.linalg.solve(inner, root.T)  # C₁ = root gain
    return LearnedReference(root @ (gain @ statistics.s), root @ gain)


def windows_against_reference(
    monitor: Monitor,
    recordings: Iterable[Recording],
    plan: WindowPlan,
    records: int,
    *,
    last: int = 0,
    linearise: str = "estimate",
) -> Iterator[WindowStatistics]:
    """Windows of what follows the first `records` of each flight and engine, judged against these.

    records 0: no reference, windows are judged against nominal as it is. last: of what follows, only the last
    so many records (0: all). A flight whose first records give no reference, or that ends with them, is a window
    without verdict.
    """
    if records:
        monitor = _add_engine_variation(monitor)
    early = _EarlyRecords(monitor, records, linearise)

    def condense(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
        uncertainty = monitor.uncertainty
        if records:
            reference = early.reference(window)
            if reference is None:
                return replace(window, reason=f"the first {records} records of this engine give no reference")
            statistics, uncertainty = reference.subtract_shift(statistics), reference.uncertainty
        return replace(window, statistics=condense_statistics(monitor, statistics, uncertainty))

    later = early.withhold(recordings) if records else recordings
    later = last_records(later, last) if last else later
    yield from window_statistics(monitor, later, plan, linearise=linearise, condense=condense, apart=not records)
    yield from early.windows_without_later_records()


def _add_engine_variation(monitor: Monitor) -> Monitor:
    """The monitor with the uncertainty of how one engine differs from its type, which a reference will reduce."""
    monitor = add_scale_offsets(monitor, OWN_SCALE)
    spread = np.zeros(len(monitor.names))
    healthy = slice(len(monitor.monitored))
    spread[healthy] = OWN_HEALTH * monitor.prior_sigma[healthy]
    return replace(monitor, uncertainty=monitor.uncertainty + np.diag(spread**2))


class _EarlyRecords:
    """Takes the first n records of each flight and engine out of a stream and learns its reference from them."""

    def __init__(self, monitor: Monitor, n: int, linearise: str):
        self._monitor, self._n, self._linearise = monitor, n, linearise
        self._learnt: dict[Key, LearnedReference] = {}
        self._held: dict[Key, list[Recording]] = {}
        self._count: dict[Key, int] = {}
        self._continued: set[Key] = set()

    def reference(self, window: WindowStatistics) -> LearnedReference | None:
        return self._learnt.get((window.source, window.flight, window.engine))

    def withhold(self, recordings: Iterable[Recording]) -> Iterator[Recording]:
        for recording in recordings:
            later = np.ones(len(recording), bool)
            for key, rows in group_rows(recording):
                missing = self._n - self._count.get(key, 0)
                first = rows[:missing] if missing > 0 else rows[:0]
                later[first] = False
                self._count[key] = self._count.get(key, 0) + len(first)
                if len(first):
                    self._held.setdefault(key, []).append(recording.select(first))
                if len(rows) > len(first):
                    self._continued.add(key)
            self._learn([key for key in self._held if self._count[key] == self._n])
            yield recording.select(later)

    def windows_without_later_records(self) -> Iterator[WindowStatistics]:
        for key, count in self._count.items():
            if key not in self._continued:
                reason = f"{count} records are not more than the {self._n} of the reference"
                yield WindowStatistics(*key, 0, 0, np.nan, np.nan, 0, 0, 0, 0, None, reason)

    def _learn(self, complete: list[Key]) -> None:
        parts = [part for key in complete for part in self._held.pop(key)]
        for window in window_statistics(
            self._monitor,
            [concat(parts)] if parts else [],
            WindowPlan(),
            linearise=self._linearise,
            condense=_keep_statistics,
        ):
            if window.statistics is not None:
                key = (window.source, window.flight, window.engine)
                self._learnt[key] = learn_reference(window.statistics, self._monitor.uncertainty)


def _keep_statistics(window: WindowStatistics, statistics: LocalStatistics) -> WindowStatistics:
    """Whatever early records show is how this engine is: nothing counts as noise."""
    return replace(window, statistics=statistics)


def last_records(recordings: Iterable[Recording], n: int) -> Iterator[Recording]:
    """The last n records of each flight and engine, file by file, in the order in which they began."""
    held: dict[Key, Recording] = {}
    for recording in recordings:
        if held and next(iter(held))[0] != recording.source:
            yield from _join_pending(held)
            held = {}
        for key, rows in group_rows(recording):
            part = recording.select(rows[-n:])
            both = concat([held[key], part]) if key in held else part
            held[key] = both.select(slice(max(len(both) - n, 0), None))
    yield from _join_pending(held)


def _join_pending(held: Mapping[Key, Recording]) -> Iterator[Recording]:
    if held:
        yield concat(list(held.values()))


Window = tuple[WindowStatistics, Mapping[str, Parameter]]
"""Statistics of a window, and what its parameters are, by name."""


@dataclass(frozen=True)
class WindowSettings:
    """How recordings become windows: the plan of windows; `linearise` as in `window_statistics`; reference and last:
    counts of records per flight and engine, 0 for none; `model_error`: accuracy of the maps by hand, None for what the
    nominal state says."""

    plan: WindowPlan = field(default_factory=WindowPlan)
    linearise: str = "estimate"
    reference: int = 0
    last: int = 0
    model_error: float | None = None

    @property
    def notes(self) -> Mapping[str, str]:
        """Choices that a result depends on, for its provenance."""
        told = {
            "reference": self.reference and f"first {self.reference}",
            "judged": self.last and f"last {self.last}",
            "model_error": "" if self.model_error is None else f"{self.model_error:g}",
        }
        return {name: str(value) for name, value in told.items() if value}


@dataclass
class WindowReader:
    """Reads files and yields their windows, as statistics.

    Parameters
    ----------
    intake : Intake
        The files, with their recorder and masks.
    monitor : Monitor or None
        None where all files contain statistics.
    judging : WindowSettings
        How recordings are cut into windows.
    on_chunk : callable
        Is passed the chunks of a recording, and returns them.
    summed : bool
        Whether windows of a flight are added up.
    user_options : mapping
        Names of the choices that the user made; statistics would ignore them, and refuse.
    counts, extrapolation : Counter
        Records by what became of them, `windows` and those with `statistics`, so far; and records that training did
        not cover.
    economy : MonitorCache or None
        Chooses the form of the monitor for each file; None: always the exact one.
    series : bool
        Windows are compared with each other (see `monitor_for_series`) and need no reference.
    solutions : bool
        Whether windows keep the engine's unknowns.
    additive : bool
        Windows of recordings keep their nuisance parameters, so that they add, unless a reference is subtracted.
    skip_doubtful : bool
        Recordings that are likelier wrong than the engine are linearised at nominal.
    drifts : bool
        Whether drifts of instruments are read from statistics; only isolation suspects them.

    Attributes
    ----------
    ledger : Ledger
        What was read of statistics.
    """

    intake: RecordingLoader
    monitor: Monitor | None
    judging: WindowSettings = field(default_factory=WindowSettings)
    on_chunk: Callable[[Iterable[Recording]], Iterable[Recording]] = iter
    summed: bool = False
    user_options: Mapping[str, object] = field(default_factory=dict)
    counts: Counter[str] = field(default_factory=Counter)
    extrapolation: Counter[Extrapolation] = field(default_factory=Counter)
    economy: MonitorCache | None = None
    series: bool = False
    solutions: bool = False
    additive: bool = False
    skip_doubtful: bool = False
    drifts: bool = False

    _reduced_monitor: Monitor | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        self.ledger = Ledger(self.monitor.nominal if self.monitor else "", summed=self.summed)

    def windows(self) -> Iterator[Window]:
        """All windows in turn. Raises DataError, NoVerdictError."""
        for file in self.intake.files():
            try:
                statistics = file.table is not None and is_flat(file.table.columns)
                for window, known in self._read_statistics(file) if statistics else self._condense_recording(file):
                    self._count(window)
                    yield window if self.solutions else replace(window, solution=None), known
            except (DataError, NoVerdictError) as error:
                self.intake.skip_file(file.name, error)
        for name, reason in self.intake.unread.items():
            yield unread_window(name, reason), {}

    def _condense_recording(self, file: LoadedFile) -> Iterator[Window]:
        monitor = self.monitor
        if monitor is None:
            raise DataError(f"{file.name}: a recording needs --nominal; only what residual has written does without")
        recordings: Iterable[Recording] = file.masked()
        if ELAPSED in monitor.engine.optional_inputs:
            recordings = FlightHours().add_hours(recordings)
        if self.economy is not None:
            monitor, recordings = self.economy.choose(recordings)
        else:
            monitor = self._reduced(monitor)
        gate = GrossErrorGate(monitor)
        recordings = self.on_chunk(gate.clean(recordings))
        for window in self._windows(monitor, recordings, file.name):
            mine = [left for left in self.intake.excluded if left.file == file.name]
            masked = [run for left in mine if left.engine in ("", window.engine) for run in left.stuck]
            here = (window.source, window.flight, window.engine)
            found = next((one for one in self.intake.mismatches if one.concerns(*here)), None)
            yield replace(gate.annotate(window, masked), disagreement=found), monitor.meaning
        gate.report(left for left in self.intake.excluded if left.file == file.name)

    def _windows(self, monitor: Monitor, recordings: Iterable[Recording], name: str) -> Iterator[WindowStatistics]:
        judging, linearise = self.judging, self.judging.linearise
        if self.skip_doubtful:
            recordings = iter(recordings)
            first = list(islice(recordings, 1))  # as soon as records are read, they have been compared with the engine
            recordings = chain(first, recordings)
            if any(m.source == name and not m.flights and m.is_likely_wrong for m in self.intake.mismatches):
                linearise = "nominal"
        if self.series or self._is_additive:
            later = last_records(recordings, judging.last) if judging.last else recordings
            condense = self._series_condense(monitor)
            yield from window_statistics(monitor, later, judging.plan, linearise=judging.linearise, condense=condense)
            return
        yield from windows_against_reference(
            monitor, recordings, judging.plan, judging.reference, last=judging.last, linearise=linearise
        )

    def _series_condense(self, monitor: Monitor) -> Condense:
        if not self._is_additive:
            return partial(keep_monitored, monitor)
        return keep_nuisance(monitor, alone=not self.series)

    @property
    def nuisance(self) -> int:
        """How many parameters are uncertain beside the monitored ones, where windows hold them."""
        if self.monitor is None or not self._is_additive:
            return 0
        return count_nuisance(self._reduced(self.monitor))

    @property
    def _is_additive(self) -> bool:
        """Whether windows of recordings hold what is uncertain beside the monitored parameters."""
        return self.additive and not self.judging.reference

    def _reduced(self, monitor: Monitor) -> Monitor:
        self._reduced_monitor = self._reduced_monitor or add_sensor_lags(reduce_monitor(monitor))
        return self._reduced_monitor

    def _read_statistics(self, file: LoadedFile) -> Iterator[Window]:
        assert file.table is not None
        refuse_ignored_options(self.user_options, file.table.name)
        self.intake.add_provenance(file.table.provenance)
        form = drop_nuisance if self.series else marginalise_nuisance
        for window, known in read_statistics(file.table.lines, file.table.name, self.ledger):
            drifting = {
                n for n, p in known.items() if p.belongs_to_instrument and p.quantity == DRIFT and not self.drifts
            }
            if window.statistics is not None:
                kept = window.statistics if self.series and self._is_additive else form(window.statistics)
                window = replace(window, statistics=kept.drop_parameters(drifting))
            yield window, {name: p for name, p in known.items() if name not in drifting}

    def _count(self, window: WindowStatistics) -> None:
        self.counts.update(window.counts)
        self.extrapolation.update(window.extrapolation)


def describe_origin(files: WindowReader, monitor: Monitor) -> StatisticsOrigin:
    """How the statistics of these files are made."""
    from enginediag_cli.recordings.source import file_sha256

    judging, source = files.judging, files.intake.source
    return StatisticsOrigin(
        monitor.nominal,
        **plan_cells(judging.plan),
        linearise=judging.linearise,
        monitor=" ".join(monitor.monitored),
        reference=str(judging.reference),
        last=str(judging.last),
        model_error="" if judging.model_error is None else f"{judging.model_error:g}",
        recorder=file_sha256(source.recorder)[:DIGITS] if source.recorder else "",
        engine_instance=source.engine_instance,
    )


STATES = ("ok", "outside the maps", "did not converge", "invalid input")


def record_residuals(monitor: Monitor, recording: Recording) -> Iterator[dict[str, Any]]:
    """One row per record: its place, `<sensor>:residual` in the column's unit, `<sensor>:sigmas`, state.

    The state says why a record has no residual, or that it lies outside the operating points identified.
    """
    check_inputs(monitor, recording)
    taken = select_inputs(monitor, recording)
    inputs, y, incomplete = taken.inputs, taken.y, taken.incomplete
    rows = np.flatnonzero(~incomplete)
    e = np.full(y.shape, np.nan)
    state = np.where(incomplete, "incomplete", "").astype(object)
    if rows.size:
        predicted, _, ok, prediction = monitor.predict({c: v[rows] for c, v in inputs.items()}, monitor.theta0)
        e[rows] = np.where(ok[:, None], y[rows] - predicted, np.nan)
        state[rows] = [STATES[code] for code in np.asarray(prediction.status)]
        for i in np.flatnonzero(~ok):
            state[rows[i]] = prediction.reason(int(i)) or state[rows[i]]
    state[taken.uncovered & (state == "ok")] = "outside the operating points identified"
    sigmas = e / monitor.noise.sigma
    text = {c: recording.text[c] for c in KEYS if c in recording.text}
    time = recording.columns.get("time_s")
    for k in range(len(recording)):
        row: dict[str, Any] = {"source": recording.source, "line": int(recording.line[k])}
        row.update({c: values[k] for c, values in text.items()})
        if time is not None:
            row["time_s"] = time[k]
        for j, sensor in enumerate(monitor.sensors):
            row[f"{sensor}:residual"], row[f"{sensor}:sigmas"] = e[k, j], sigmas[k, j]
        row["state"] = state[k]
        yield row
