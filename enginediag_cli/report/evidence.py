"""Results sorted by engine: all that is known of each, whichever files it came from.

A report straight from recordings: what `detect`, `isolate`, `trend` and `residual` would write, in one run.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from enginediag_cli.detection.verdict import format_size
from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import EngineHistory, event_number
from enginediag_cli.fleets.maintenance import MarginSettings
from enginediag_cli.history.deltas import DeltaAlerts, flight_deltas
from enginediag_cli.history.posterior import EVENT
from enginediag_cli.history.search import leading_suspects
from enginediag_cli.intake.loader import RecordingLoader
from enginediag_cli.intake.selection import RecordingSource, required_columns
from enginediag_cli.parameters import Parameter, unspecified
from enginediag_cli.progress import each, stage
from enginediag_cli.report import result_files
from enginediag_cli.report.plotting import RowOrigin, date_words
from enginediag_cli.report.plotting.models import OperatingMap, operating_maps
from enginediag_cli.report.result_files import (
    ResidualRecords,
    ResultFile,
    ResultKind,
    Row,
    parse_alternative,
    residual_records,
)
from enginediag_cli.report.sentences import display_scale, listed
from enginediag_cli.report.tables.answers import MAINTENANCE
from enginediag_cli.report.tables.recordings import excluded_lines, not_judged_lines, outside_envelope_lines
from enginediag_cli.residuals.files import WindowReader, WindowSettings, record_residuals
from enginediag_cli.residuals.monitor import Monitor, recording_agreement
from enginediag_cli.residuals.windows import WindowStatistics
from enginediag_cli.units import is_date

UNCHANGED = ("", "steady", "cannot tell", MAINTENANCE)
"""Kinds of rows of `trend` that report no change."""
TAKES_PART = 0.5
"""Probability, relative to its component's, from which a parameter is one of those that changed."""


@dataclass(frozen=True)
class ReportedChange:
    """One change as `trend` has it: its rows, one for each parameter of the likeliest suspect, and all suspects with
    their probabilities, likeliest first."""

    rows: Sequence[Row]
    suspects: Sequence[tuple[str, float]]

    @property
    def kind(self) -> str:
        return self.rows[0].text("kind")

    @property
    def probability(self) -> float:
        """That it happened, whoever changed."""
        return min(sum(p for _, p in self.suspects), 1.0)

    @property
    def own(self) -> float:
        """Of the likeliest suspect."""
        return self.suspects[0][1]

    @property
    def group(self) -> Sequence[tuple[str, float]]:
        """The suspect that is named, or the ambiguity group."""
        return leading_suspects(self.suspects, self.probability)

    @property
    def changed(self) -> Sequence[Row]:
        """The parameters that take part."""
        return [row for row in self.rows if row.number("probability") >= TAKES_PART * self.own]

    @property
    def remaining(self) -> Sequence[Row]:
        """The parameters that are off nominal at the last flight."""
        return [row for row in self.changed if row.number("change_low") * row.number("change_high") > 0]

    @property
    def ended(self) -> bool:
        """Whether it was taken back, at least in part."""
        return bool(self.rows[0].text("end"))


@dataclass
class EngineEvidence:
    """Rows of one engine, by kind and in the order of the files, its windows of statistics with their places, its
    flights as the series has them, its residuals, how many readings of each sensor were masked, and its compressors'
    maps with the points flown."""

    engine: str
    rows: dict[ResultKind, list[Row]] = field(default_factory=dict)
    windows: list[tuple[WindowStatistics, RowOrigin]] = field(default_factory=list)
    flights: list[tuple[WindowStatistics, RowOrigin]] = field(default_factory=list)
    records: ResidualRecords | None = None
    masked: dict[str, int] = field(default_factory=dict)
    maps: Sequence[OperatingMap] = ()

    def rows_of_kind(self, kind: ResultKind) -> list[Row]:
        return self.rows.get(kind, [])

    @property
    def isolated(self) -> list[list[Row]]:
        """Rows of `isolate`, window by window."""
        return group_by_window(self.rows_of_kind(result_files.ISOLATED))

    @property
    def changes(self) -> list[ReportedChange]:
        """What happened by `trend`, in the order of its rows."""
        found: dict[tuple[str, ...], list[Row]] = {}
        for row in self.rows_of_kind(result_files.TREND):
            if row.text("kind") not in UNCHANGED:
                key = (row.text("component"), row.text("kind"), row.text("onset"), row.text("rivals"))
                found.setdefault(key, []).append(row)
        events = []
        for (owner, *_), rows in found.items():
            own = max(row.number("probability") for row in rows)
            others = [(" & ".join(names), p) for names, p in map(parse_alternative, rows[0].list("rivals"))]
            events.append(ReportedChange(rows, [(owner, own), *(other for other in others if other[1] == other[1])]))
        return [event for event in events if event.probability >= EVENT]

    def flight_date(self, number: int) -> str:
        """Date of a flight, counted from 1, where the recordings have dates."""
        times = [
            row.number("time_s") for row in self.rows_of_kind(result_files.FLIGHTS) if row.count("number") == number
        ]
        return date_words(times[0]) if times and is_date(times[0]) else ""

    @property
    def changed_rows(self) -> list[Row]:
        """Rows of `trend` of parameters that have probably changed."""
        return [row for event in self.changes for row in event.changed]


@dataclass
class ReportEvidence:
    """All results by engine.

    Attributes
    ----------
    results : sequence of ResultFile
        The files.
    engines : dict of str to EngineEvidence
        Engine → its results.
    parameters : dict of str to Parameter
        Meaning of parameters, as far as any file holds it.
    engine_type : str
        What engines these are, as far as any file holds it.
    false_alarm : float
        Level of the tests of windows.
    """

    results: Sequence[ResultFile]
    engines: dict[str, EngineEvidence]
    parameters: dict[str, Parameter]
    engine_type: str = ""
    false_alarm: float = 0.01

    _sources: dict[tuple[str, ...], str] = field(default_factory=dict, repr=False)

    def add(self, kind: ResultKind, row: Row, by: str) -> None:
        """Take a row over; by: the file, or what else, that holds it. Raises DataError where another one holds the
        same window or parameter, which would count twice."""
        engine = row.text("engine")
        place = (kind.name, engine, *(row.text(name) for name in PLACE))
        before = self._sources.setdefault(place, by)
        if before != by:
            of = f"engine {engine}" if engine else "an engine without a name"
            raise DataError(f"{before} and {by} both hold {kind.name} of the same part of {of}: give one of them")
        self.engines.setdefault(engine, EngineEvidence(engine)).rows.setdefault(kind, []).append(row)

    def documents(self, kind: ResultKind) -> list[ResultFile]:
        return [result for result in self.results if result.kind is kind]

    def smallest_words(self, sizes: Mapping[str, float]) -> str:
        """Of each component the parameter that shows best, in shares of what is plausible, with its size."""
        smallest: dict[str, tuple[float, str]] = {}
        for name, size in sizes.items():
            parameter = self.parameters.get(name)
            if parameter is None or parameter.belongs_to_instrument or not math.isfinite(size):
                continue
            known = smallest.get(parameter.component)
            if known is None or size < known[0]:
                smallest[parameter.component] = size, f"{parameter.words or name} by {format_size(parameter, size)}"
        return listed([words for _, words in smallest.values()], "or")

    def owner_words(self, owner: str) -> str:
        """A component or an instrument as an engineer says it."""
        return next((p.part for p in self.parameters.values() if p.component == owner and p.part), owner)

    def owners(self, names: str) -> set[str]:
        """Components and instruments of parameters that are joined by "&"."""
        return {self.parameters[n].component for n in names.split(" & ") if n in self.parameters}

    def one_of_each_component(self) -> list[str]:
        """The first parameter of each component that is shown in per cent."""
        found: dict[str, str] = {}
        for name, known in self.parameters.items():
            if not known.belongs_to_instrument and not known.fails_alone and display_scale(known)[1] == "%":
                found.setdefault(known.component, name)
        return list(found.values())

    def parameters_of_owner(self, owner: str) -> list[str]:
        """Parameters of a component, and the plainest error of an instrument."""
        found = [p for p in self.parameters.values() if p.component == owner]
        return [p.name for p in (found[:1] if found and found[0].belongs_to_instrument else found)]


PLACE = ("source", "flight", "first_line", "last_line", "parameter", "components", "block", "column", "row", "number")
"""Cells that say of which window or parameter a row is, as far as it has them."""


def collect_evidence(results: Sequence[ResultFile], known: Mapping[str, Parameter] | None = None) -> ReportEvidence:
    """Sort results by engine.

    Parameters
    ----------
    results : sequence of ResultFile
        Files of results.
    known : mapping of str to Parameter, optional
        Meaning of parameters.

    Returns
    -------
    ReportEvidence

    Raises
    ------
    DataError
        For damaged statistics, and for two files that hold the same window or parameter.
    """
    from enginediag_cli.residuals.files import Ledger, read_statistics
    from enginediag_cli.residuals.score import marginalise_nuisance

    found = ReportEvidence(results, {}, dict(known or {}), _stated_type(results))
    ledger = Ledger()
    for result in results:
        if result.kind is result_files.RECORDS:
            _records(found, result)
            continue
        for row in result.rows if result.kind is not result_files.LOCATED else ():
            found.add(result.kind, row, result.name)
        if result.kind is result_files.STATISTICS:
            first = next(k for k, line in enumerate(result.lines) if not line.startswith("#")) + 2
            for number, (window, meaning) in enumerate(read_statistics(result.lines, result.name, ledger)):
                for name, parameter in meaning.items():
                    found.parameters.setdefault(name, parameter)
                mine = found.engines.setdefault(window.engine, EngineEvidence(window.engine))
                if window.statistics is not None:
                    window = replace(window, statistics=marginalise_nuisance(window.statistics))
                mine.windows.append((window, RowOrigin(result.name, str(first + number))))
    for name, unit in _named_parameters(found):
        found.parameters.setdefault(name, unspecified(name, unit))
    return found


def _stated_type(results: Sequence[ResultFile]) -> str:
    """The engine that the heads of the files name; several, or none, are nothing."""
    lines = {line.strip() for result in results for line in result.provenance if line.strip().startswith(ENGINE_LINE)}
    return lines.pop().removeprefix(ENGINE_LINE) if len(lines) == 1 else ""


ENGINE_LINE = "engine: "
"""Begin of the line of a file's head that names the engine."""


def _records(found: ReportEvidence, result: ResultFile) -> None:
    by_engine: dict[str, list[Row]] = {}
    for row in result.rows:
        by_engine.setdefault(row.text("engine"), []).append(row)
    for engine, rows in by_engine.items():
        mine = found.engines.setdefault(engine, EngineEvidence(engine))
        if mine.records is not None:
            raise DataError(f"{result.name}: residuals of these records come from another file, too: give one of them")
        mine.records = residual_records(rows)


def _named_parameters(found: ReportEvidence) -> Iterator[tuple[str, str]]:
    """Parameters that rows name, with their units."""
    for engine in found.engines.values():
        for kind in (result_files.ISOLATED, result_files.TREND, result_files.FLIGHTS):
            for row in engine.rows_of_kind(kind):
                if name := row.text("parameter"):
                    yield name, row.text("unit")
                for isolated in row.list("isolated"):
                    yield isolated, ""


def group_by_window(rows: Sequence[Row]) -> list[list[Row]]:
    """Rows that are of one window together."""
    found: dict[tuple[str, ...], list[Row]] = {}
    for row in rows:
        place = tuple(row.text(name) for name in ("source", "flight", "engine", "first_line", "last_line"))
        found.setdefault((row.origin.file, *place), []).append(row)
    return list(found.values())


@dataclass(frozen=True)
class RecordingsQuestion:
    """Recordings that a report judges, and how; as `detect`, `isolate` and `trend` would.

    Attributes
    ----------
    source : RecordingSource
        The recordings.
    monitor : Monitor
        It watches the engine alone, for the test of each window.
    suspicious : Monitor
        It watches every instrument, too, for series and residuals.
    isolating : Monitor
        It watches every instrument and its drift within a flight, for isolation.
    judging : WindowSettings
        How records are divided into windows and linearised.
    false_alarm : float
        Level of the tests.
    margins : MarginSettings
        What is computed of the margin.
    alerts : DeltaAlerts
        Levels, power setting and smoothing of deltas.
    """

    source: RecordingSource
    monitor: Monitor
    suspicious: Monitor
    isolating: Monitor
    judging: WindowSettings
    false_alarm: float
    margins: MarginSettings = field(default_factory=MarginSettings)
    alerts: DeltaAlerts = field(default_factory=DeltaAlerts)


def judge_recordings(question: RecordingsQuestion, given: Sequence[ResultFile]) -> tuple[ReportEvidence, list[str]]:
    """Judge recordings as `detect`, `isolate`, `trend` and `residual` do, and add results that were given.

    Parameters
    ----------
    question : RecordingsQuestion
        The recordings, and how they are judged.
    given : sequence of ResultFile
        Further results.

    Returns
    -------
    evidence : ReportEvidence
    excluded : list of str
        Excluded data, in words.

    Raises
    ------
    DataError, NoVerdictError
    """
    left_out: list[str] = []
    windows: list[WindowStatistics] = []
    detected = list(_detection_rows(question, left_out))
    last = {row.text("engine"): number for number, row in enumerate(detected, start=1)}
    series = SeriesEvidence()
    rows = {
        result_files.DETECTED: detected,
        result_files.ISOLATED: list(_isolation_rows(question, windows, frozenset(last.values()))),
        **_trend_rows(question, series),
        result_files.MARGIN: _margin_rows(question, left_out),
        result_files.DELTAS: _delta_rows(question),
    }
    evidence = collect_evidence(given, question.isolating.meaning)
    evidence.engine_type, evidence.false_alarm = engine_words(question.monitor.engine), question.false_alarm
    for kind, found in rows.items():
        for row in found:
            evidence.add(kind, row, "what is judged here")
    for engine, flights in series.flights.items():
        mine = evidence.engines.setdefault(engine, EngineEvidence(engine))
        mine.flights, mine.maps = flights, series.maps.get(engine, ())
    for window in windows:
        mine = evidence.engines.setdefault(window.engine, EngineEvidence(window.engine))
        mine.windows.append((window, _window_origin(window)))
    _add_records(question, evidence)
    return evidence, left_out


def _detection_rows(question: RecordingsQuestion, left_out: list[str]) -> Iterator[Row]:
    from enginediag_cli.detection.verdict import judge
    from enginediag_cli.report.tables.detection import DETECT, DETECTABLE
    from enginediag_cli.residuals.reduced import MonitorCache

    files = _judged_files(question, question.monitor)
    # whether anything has changed does not depend on what wrong slopes of maps would make of the change
    files.economy = MonitorCache(replace(question.monitor, slopes=None))
    for window, _ in each(files.windows(), "windows judged"):
        row = DETECT.row(judge(window, question.false_alarm, monitor=question.monitor), DETECTABLE)
        yield Row(row, _window_origin(window))
    for left in files.intake.excluded:
        left_out += excluded_lines(left)
    left_out += [*not_judged_lines(files.counts), *outside_envelope_lines(files.extrapolation)]


def _isolation_rows(
    question: RecordingsQuestion, windows: list[WindowStatistics], last: frozenset[int]
) -> Iterator[Row]:
    """last: numbers, from 1, of the windows of which the sensitivity of the conclusion is of interest."""
    from enginediag_cli.isolation.diagnosis import DiagnosisOptions
    from enginediag_cli.isolation.methods import IsolationOptions
    from enginediag_cli.isolation.windows import WindowIsolation
    from enginediag_cli.report.tables.isolation import isolated_rows
    from enginediag_cli.residuals.long_windows import RecentRecords

    judging, kept = question.judging, None
    if not judging.reference and judging.linearise == "estimate":
        kept = RecentRecords(question.isolating, short_windows=not judging.plan.is_whole_flight)
    nonlinear = "auto" if judging.linearise == "estimate" else "never"
    options = DiagnosisOptions(isolation=IsolationOptions(false_alarm=question.false_alarm), nonlinear=nonlinear)
    isolating = WindowIsolation(
        _judged_files(question, question.isolating),
        options,
        question.false_alarm,
        kept_records=kept,
        wants_sensitivity=lambda number, named: named and number in last,
    )
    for found in each(isolating.windows(), "windows isolated"):
        windows.append(found.verdict.window)
        for row in isolated_rows(found, forms={"flips": "nested"}):
            yield Row(row, _window_origin(found.verdict.window))


@dataclass
class SeriesEvidence:
    """By engine, its flights with what the series has of each, and the maps of its compressors."""

    flights: dict[str, list[tuple[WindowStatistics, RowOrigin]]] = field(default_factory=dict)
    maps: dict[str, list[OperatingMap]] = field(default_factory=dict)


@stage("following the series")
def _trend_rows(question: RecordingsQuestion, evidence: SeriesEvidence) -> dict[result_files.ResultKind, list[Row]]:
    from enginediag_cli.detection.series import build_series
    from enginediag_cli.fleets.maintenance import mean_conditions
    from enginediag_cli.fleets.work_scope import WorkScopeEstimator
    from enginediag_cli.history.engines import HistoryWindows, judge_engines
    from enginediag_cli.report.tables.trend import flight_rows, trend_rows
    from enginediag_cli.residuals.reduced import monitor_for_series

    monitor = monitor_for_series(question.suspicious)
    files = _series_files(question, monitor)
    files.additive = True
    windows = HistoryWindows(files)
    series = build_series(windows)
    rows: dict[result_files.ResultKind, list[Row]] = {result_files.FLIGHTS: [], result_files.TREND: []}
    histories = dict(
        judge_engines(
            windows.engines,
            series,
            reference=question.judging.reference,
            maintenance={
                engine: _restored(question, EngineHistory(engine, "", x, windows.engines[engine], 0))
                for engine, x in series.stretches.items()
            },
        )
    )
    for row in flight_rows(series, histories):
        window = series.stretches[row["engine"]][row["number"] - 1].window
        rows[result_files.FLIGHTS].append(Row(row, _window_origin(window)))
    scoping = WorkScopeEstimator(monitor)
    for engine, stretches in series.stretches.items():
        flown = [(replace(x.window, statistics=x.statistics), _window_origin(x.window)) for x in stretches]
        evidence.flights[engine] = flown
        found = histories.get(engine)
        now = {} if found is None else {name: size for name, (size, _) in found.flight_levels(found.flights).items()}
        evidence.maps[engine] = operating_maps(question.monitor, [window for window, _ in flown], now)
        if found is None:
            continue
        scope = None
        if found.events:
            scope = scoping.series_scope(found.events, series.parameters, mean_conditions(stretches))
        rows[result_files.TREND] += [
            Row(row, flown[-1][1]) for row in trend_rows(engine, found, series, scope, "nested")
        ]
    return rows


def _restored(question: RecordingsQuestion, history: EngineHistory) -> list[int]:
    """Numbers, from 1, of the flights that are the first after maintenance."""
    events = [event for event in question.margins.events if event.engine in ("", history.serial)]
    numbers = [event_number(event, history) for event in events]
    return [number + 1 for number in numbers if number < len(history.stretches)]


@stage("following the margin")
def _margin_rows(question: RecordingsQuestion, left_out: list[str]) -> list[Row]:
    from enginediag_cli.detection.series import build_series
    from enginediag_cli.fleets.maintenance import assess_margins
    from enginediag_cli.history.engines import HistoryWindows
    from enginediag_cli.report.tables.fleet import margin_rows, odd_events
    from enginediag_cli.residuals.reduced import monitor_for_series

    monitor = monitor_for_series(question.suspicious)
    files = _series_files(question, monitor)
    files.additive = True
    windows = HistoryWindows(files)
    margins = assess_margins(windows, build_series(windows, "covariance"), monitor, question.margins)
    left_out += odd_events(margins)
    told = []
    for row in margin_rows(margins):
        stretches = margins.series.stretches[row["engine"]]
        told.append(Row(row, _window_origin(stretches[(row["number"] or len(stretches)) - 1].window)))
    return told


@stage("deltas of the readings")
def _delta_rows(question: RecordingsQuestion) -> list[Row]:
    """Of each flight and reading, about nominal."""
    from enginediag_cli.detection.series import build_series
    from enginediag_cli.history.engines import HistoryWindows
    from enginediag_cli.report.tables.trend import delta_rows
    from enginediag_cli.residuals.reduced import monitor_for_series

    monitor = monitor_for_series(question.suspicious)
    about_nominal = replace(question, judging=replace(question.judging, linearise="nominal"))
    files = _series_files(about_nominal, monitor)
    files.additive = True
    windows = HistoryWindows(files)
    series = build_series(windows, "covariance")
    rows = []
    for engine, stretches in series.stretches.items():
        events = _restored(question, EngineHistory(engine, "", stretches, windows.engines[engine], 0))
        reference = question.judging.reference
        found = flight_deltas(series, engine, question.alerts, reference=reference, events=events)
        for row in delta_rows(found):
            rows.append(Row(row, _window_origin(stretches[row["number"] - 1].window)))
    return rows


def _add_records(question: RecordingsQuestion, evidence: ReportEvidence) -> None:
    """Residuals of every record, with the inputs."""
    monitor = question.suspicious
    inputs = [c for c in monitor.engine.inputs]
    found: dict[str, list[tuple[dict[str, Any], dict[str, float]]]] = {}
    intake = _intake(question, monitor)
    for chunk in each(intake.chunks(), "chunks of residuals"):
        values = {c: chunk.columns[c] for c in inputs if c in chunk.columns}
        for k, row in enumerate(record_residuals(monitor, chunk)):
            found.setdefault(str(row.get("engine", "")), []).append((row, {c: float(v[k]) for c, v in values.items()}))
    for engine, rows in found.items():
        mine = evidence.engines.setdefault(engine, EngineEvidence(engine))
        mine.records = _computed_records(monitor, rows)
        for left in intake.excluded:
            if left.engine in ("", engine):
                for column, reasons in left.columns.items():
                    mine.masked[column] = mine.masked.get(column, 0) + sum(reasons.values())


def _computed_records(monitor: Monitor, rows: Sequence[tuple[dict[str, Any], dict[str, float]]]) -> ResidualRecords:
    def column(name: str, of: Callable[[tuple[dict[str, Any], dict[str, float]]], Any]) -> np.ndarray:
        return np.array([float(of(entry).get(name, np.nan)) for entry in rows])

    power = getattr(monitor.engine, "power_setting", "")
    return ResidualRecords(
        [row["source"] for row, _ in rows],
        [row["line"] for row, _ in rows],
        [str(row.get("flight", "")) for row, _ in rows],
        column("time_s", lambda entry: entry[0]),
        {s: column(s + result_files.SIGMAS, lambda entry: entry[0]) for s in monitor.sensors},
        {s: column(s + result_files.RESIDUAL, lambda entry: entry[0]) for s in monitor.sensors},
        {c: column(c, lambda entry: entry[1]) for c in rows[0][1]},
        ALTITUDE if ALTITUDE in rows[0][1] else "",
        power if power in rows[0][1] else "",
    )


def engine_words(engine: Any) -> str:
    """What an engine is, as its file says it: "turbofan (two-spool with booster)"."""
    described = str(getattr(engine, "description", ""))
    return f"{engine.name} ({described})" if described else str(engine.name)


ALTITUDE = "altitude_m"
"""The input of every engine that flies."""


def _judged_files(question: RecordingsQuestion, monitor: Monitor) -> WindowReader:
    return WindowReader(_intake(question, monitor), monitor, question.judging)


def _series_files(question: RecordingsQuestion, monitor: Monitor) -> WindowReader:
    """Windows that are compared with each other; a reference is of the series, not of a window."""
    plan = question.judging.plan
    judging = replace(question.judging, plan=plan.series_plan, reference=0)
    return WindowReader(_intake(question, monitor), monitor, judging, summed=plan.is_whole_flight, series=True)


def _intake(question: RecordingsQuestion, monitor: Monitor) -> RecordingLoader:
    wanted = required_columns(monitor.engine, monitor.sensors)
    return RecordingLoader(question.source, wanted, agreement=recording_agreement(monitor), keep_going=True)


def _window_origin(window: Any) -> RowOrigin:
    return RowOrigin(window.source, f"{window.first_line}–{window.last_line}")
