"""`trend`: health over flights, since when and how fast it changes, and the EGT margin.

`make_report`: results, or recordings, as one page that opens offline.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from enginediag_cli.api.inputs import Comparison, NominalLike, RecordingsLike, compare, report_exclusions
from enginediag_cli.api.results import MessageLog, Picture, Result, Row
from enginediag_cli.errors import DataError, UsageError
from enginediag_cli.report.messages import Messages
from enginediag_cli.shipped import own_or_shipped
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.detection.series import Series
    from enginediag_cli.fleets.maintenance import MarginSettings, SeriesMargins
    from enginediag_cli.fleets.work_scope import WorkScopeEstimator
    from enginediag_cli.history.deltas import DeltaAlerts, FlightDeltas
    from enginediag_cli.history.engines import EngineTrend
    from enginediag_cli.intake.selection import RecordingSource
    from enginediag_cli.report.evidence import ReportEvidence
    from enginediag_cli.report.result_files import ResultFile
    from enginediag_cli.residuals.files import WindowReader

__all__ = ["MarginOptions", "ReportPage", "TrendResult", "forecast", "make_report", "trend"]

WHAT = ("trend", "flights", "margin", "deltas")


@dataclass(frozen=True)
class MarginOptions:
    """From and to what the EGT margin is counted.

    Attributes
    ----------
    limits_K : mapping of str to float
        Column → limit of the turbine temperature [K].
    consumed_limit_K : (float, float), optional
        EGT margin used when an engine is removed, and its standard deviation [K].
    taken_off : sequence of str
        Engines of these recordings that end where they were removed.
    events_path : str
        CSV of maintenance, ``""`` for none.
    baseline : int
        Number of first flights taken as healthy; 0 for the default.
    limits : mapping of str to float
        Column of a speed, torque or power → its limit, in the column's unit, for the power or thrust available.
    at : mapping of str to float
        Inputs of the condition at which margin and available power are computed, in their units; the others are those
        of the rating on a standard hot day.
    """

    limits_K: Mapping[str, float] = field(default_factory=dict)
    consumed_limit_K: tuple[float, float] | None = None
    taken_off: Sequence[str] = ()
    events_path: str = ""
    baseline: int = 0
    limits: Mapping[str, float] = field(default_factory=dict)
    at: Mapping[str, float] = field(default_factory=dict)

    def __bool__(self) -> bool:
        """Whether a limit, a condition or maintenance is given."""
        stated = self.limits_K or self.limits or self.at
        return bool(stated or self.consumed_limit_K or self.taken_off or self.events_path)

    def add_limits(self, limits: Mapping[str, float]) -> MarginOptions:
        """With limits of columns in kelvins, of turbine temperatures, and of other columns."""
        temperatures = {c: v for c, v in limits.items() if split_column(c)[1] == "K"}
        others = {c: v for c, v in limits.items() if c not in temperatures}
        return replace(self, limits_K={**self.limits_K, **temperatures}, limits={**self.limits, **others})

    @property
    def configs(self) -> list[str]:
        """Files that a result depends on, for its provenance."""
        return [self.events_path] if self.events_path else []

    @property
    def notes(self) -> dict[str, str]:
        """Choices that a result depends on, for its provenance."""
        limits = ", ".join(f"{c} {v:g}" for c, v in {**self.limits_K, **self.limits}.items())
        consumed = " ± ".join(f"{v:g}" for v in self.consumed_limit_K or ())
        made = {
            "limit": limits,
            "at": ", ".join(f"{c}={v:g}" for c, v in self.at.items()),
            "consumed limit": consumed and f"{consumed} K",
            "removed from wing": ", ".join(self.taken_off),
            "baseline": self.baseline and f"first {self.baseline} flights",
        }
        return {name: str(value) for name, value in made.items() if value}

    def question(self, *, healthy: int = 0, sensors: bool = True) -> MarginSettings:
        """Read the events of the file; healthy, sensors: as in `MarginSettings`. Raises ConfigError."""
        from enginediag_cli.fleets.fleet_file import read_events
        from enginediag_cli.fleets.maintenance import MarginSettings

        return MarginSettings(
            limits_K=dict(self.limits_K),
            consumed_limit_K=self.consumed_limit_K,
            taken_off=tuple(self.taken_off),
            events=read_events(Path(self.events_path), named=False) if self.events_path else (),
            events_file=os.path.basename(self.events_path),
            baseline=self.baseline,
            limits=dict(self.limits),
            at=dict(self.at),
            healthy=healthy,
            sensors=sensors,
        )


@dataclass(frozen=True)
class TrendChoices:
    """Arguments of `trend` other than what it reads; `events`: labels of first flights after maintenance."""

    what: str = "trend"
    by: str = "parameter"
    sensors: bool = True
    work_scope: str = "nested"
    events: Sequence[str] = ()
    margin: MarginOptions = field(default_factory=MarginOptions)
    alerts: str | Path | DeltaAlerts | None = None
    setting: str = ""

    @property
    def alerts_path(self) -> list[str]:
        """Path of the file of alert levels, where one is given."""
        return [str(own_or_shipped(self.alerts))] if isinstance(self.alerts, (str, Path)) else []

    def delta_alerts(self) -> DeltaAlerts:
        """Read the alert levels; the power setting that was chosen is that of the option first. Raises ConfigError."""
        from enginediag_cli.history.deltas import DeltaAlerts, load_alerts

        found = load_alerts(*self.alerts_path) if self.alerts_path else self.alerts or DeltaAlerts()
        assert isinstance(found, DeltaAlerts)
        return replace(found, setting=self.setting) if self.setting else found

    @property
    def follows_margin(self) -> bool:
        """Whether the margin of the turbine temperature is followed."""
        return bool(self.margin) or self.what == "margin"

    def check(self, comparison: Comparison) -> None:
        """Raise UsageError for choices that exclude each other."""
        nominal, what = comparison.given, self.what
        refused = {
            f"--what: there is no {what!r}, but {', '.join(WHAT)}": what not in WHAT,
            f"--event needs --nominal, and does not go with --what {what}": bool(self.events)
            and (nominal is None or what not in ("trend", "deltas")),
            "--what deltas needs --nominal: the engine predicts what is read at the same power setting": what
            == "deltas"
            and nominal is None,
            "--alerts and --setting go with --what deltas": what != "deltas"
            and (self.alerts is not None or bool(self.setting)),
            "--what deltas shows readings and not the margin: leave its limits and --events out": what == "deltas"
            and bool(self.margin),
            "--what margin, its limits and --events need --nominal: the engine says what wear heats": (
                self.follows_margin and nominal is None
            ),
        }
        for reason, wrong in refused.items():
            if wrong:
                raise UsageError(reason)


class TrendResult(Result):
    """Rows of health over flights; see `trend`. histories: engine → what is known of it, as soon as there are rows."""

    def __init__(self, comparison: Comparison, choices: TrendChoices):
        from enginediag_cli.residuals.reduced import monitor_for_series

        choices.check(comparison)
        self._choices, self.messages = choices, comparison.messages
        self.histories: dict[str, EngineTrend] = {}
        self._deltas: dict[str, FlightDeltas] | None = None
        judging = comparison.judging
        self._whole, self._healthy = judging.plan.is_whole_flight, judging.reference
        # the options of windows hold for the series, not for a window of it; deltas are readings minus nominal
        linearise = "nominal" if choices.what == "deltas" else judging.linearise
        plain = replace(judging, plan=judging.plan.series_plan, reference=0, linearise=linearise)
        self._comparison = replace(comparison, judging=plain)
        self._alerts = choices.delta_alerts()
        monitor = self._comparison.monitor(sensors=not comparison.options.monitor)
        self._monitor = None if monitor is None else monitor_for_series(monitor)
        self._series, self._margins, self._files = self._read()
        table = self._table()
        intake, margin = self._files.intake, choices.margin
        configs, notes = [*margin.configs, *choices.alerts_path], dict(margin.notes)
        if choices.what == "deltas":
            notes |= {"smoothing": f"{self._alerts.smoothing_flights:g} flights", "setting": self._alerts.setting}
        notes = {name: value for name, value in notes.items() if value}
        head = comparison.head("trend", table, intake, {}, configs=configs, last=notes)
        super().__init__(table=table, head=head, messages=comparison.messages)
        self.unread = intake.unread

    def _table(self) -> Any:
        from enginediag_cli.report.tables import output

        what = self._choices.what
        if what == "trend":
            return output("trend/components" if self._choices.by == "component" else "trend")
        return output(f"trend/{what}")

    def _read(self) -> tuple[Series, SeriesMargins | None, WindowReader]:
        """Read the series of flights, with margins if requested, and the files it comes from."""
        from enginediag_cli.detection.series import build_series
        from enginediag_cli.fleets.maintenance import assess_margins
        from enginediag_cli.history.engines import HistoryWindows
        from enginediag_cli.report.tables.fleet import report_margins
        from enginediag_cli.report.tables.trend import report_instruments_over_flights

        choices, monitor, margins = self._choices, self._monitor, None
        files = self._comparison.files(monitor, summed=self._whole, series=True)
        files.additive = True
        self._history = HistoryWindows(files)
        series = build_series(self._history, "whole" if choices.what == "flights" else "covariance")
        if choices.follows_margin and monitor is not None:
            question = choices.margin.question(healthy=self._healthy, sensors=choices.sensors)
            margins = assess_margins(self._history, series, monitor, question)
            report_margins(self.messages, margins)
            if choices.what == "margin":
                return series, margins, files
        report_instruments_over_flights(self.messages, series)
        if monitor is None and series.stretches and choices.what == "trend":
            self.messages.note(
                "without --nominal it is not known which inputs are weather and which set the power: what follows the "
                "weather may look like a change, and no instrument of an input is checked"
            )
        return series, margins, files

    def _compute(self) -> Iterator[Row]:
        from enginediag_cli.report.tables.fleet import margin_rows
        from enginediag_cli.report.tables.trend import delta_rows, flight_rows, report_deltas

        if self._choices.what == "margin" and self._margins is not None:
            rows = list(margin_rows(self._margins))
        elif self._choices.what == "flights":
            self.histories = dict(self._judged())
            rows = list(flight_rows(self._series, self.histories))
        elif self._choices.what == "deltas":
            rows = [row for engine in self.deltas().values() for row in delta_rows(engine)]
            report_deltas(self.messages, self.deltas())
        else:
            rows = list(self._changes())
        undecided = {engine for engine, found in self.histories.items() if found.undecided}
        self.judged = sum(row.get("engine") not in undecided for row in rows)
        yield from rows
        report_exclusions(self.messages, self._files)
        if self._series.skipped_windows:
            self.messages.warning(f"{self._series.skipped_windows} windows without a verdict were excluded")

    def _changes(self) -> Iterator[Row]:
        """Make the rows of changes in each engine, and of maintenance."""
        from enginediag_cli.detection.series import FEWEST
        from enginediag_cli.fleets.work_scope import WorkScopeEstimator
        from enginediag_cli.report.tables.trend import report_too_few_flights

        choices, series = self._choices, self._series
        for engine, stretches in series.stretches.items():
            if len(stretches) < FEWEST:
                report_too_few_flights(self.messages, engine, len(stretches))
        scoping = None if self._monitor is None or choices.work_scope == "" else WorkScopeEstimator(self._monitor)
        rows: list[Row] = []
        for engine, story in self._judged():
            self.histories[engine] = story
            rows += self._engine_rows(engine, story, scoping, rows)
        return iter(rows)

    def _judged(self) -> Iterator[tuple[str, EngineTrend]]:
        """Each engine with what is known of its history."""
        from enginediag_cli.fleets.maintenance import maintenance_flights
        from enginediag_cli.history.engines import judge_engines

        choices, series = self._choices, self._series
        return judge_engines(
            self._history.engines,
            series,
            reference=self._healthy,
            sensors=choices.sensors,
            maintenance={e: maintenance_flights(series, e, choices.events) for e in series.stretches},
            health=bool(choices.events),
        )

    def _engine_rows(
        self, engine: str, story: Any, scoping: WorkScopeEstimator | None, before: Sequence[Row]
    ) -> list[Row]:
        from enginediag_cli.fleets.maintenance import maintenance_effects, mean_conditions
        from enginediag_cli.report.tables.answers import maintenance_row, report_maintenance, report_work_scope
        from enginediag_cli.report.tables.trend import component_rows, report_trend, trend_rows

        choices, series, messages = self._choices, self._series, self.messages
        form = "" if choices.work_scope == "sentences" else choices.work_scope
        as_rows = component_rows if choices.by == "component" else trend_rows
        report_trend(messages, engine, story, series)
        scope = None
        if scoping is not None and story.events and (form or not messages.quiet):
            scope = scoping.series_scope(story.events, series.parameters, mean_conditions(series.stretches[engine]))
        report_work_scope(messages, engine, scope)
        rows = list(as_rows(engine, story, series, scope, form))
        if scoping is not None:
            for found in maintenance_effects(scoping, story, series, engine, tuple(choices.events)):
                report_maintenance(messages, engine, found, series, scoping)
                rows.append(maintenance_row(engine, found, series, scoping, form, [*before, *rows]))
        return rows

    def deltas(self) -> dict[str, FlightDeltas]:
        """Raw deltas of each engine over its flights, smoothed, with alert levels. Raises DataError."""
        from enginediag_cli.fleets.maintenance import maintenance_flights
        from enginediag_cli.history.deltas import flight_deltas

        if self._deltas is None:
            self._deltas = {
                engine: flight_deltas(
                    self._series,
                    engine,
                    self._alerts,
                    reference=self._healthy,
                    events=maintenance_flights(self._series, engine, self._choices.events),
                )
                for engine in self._series.stretches
            }
        return self._deltas

    def plot(self) -> Picture:
        """Draw the health of the engine that changed, the margin, or a delta, over flights. Raises NoVerdictError."""
        from enginediag_cli.report.plotting.models import chart_svg, margin_chart, trend_chart
        from enginediag_cli.report.plotting.residuals import leading_delta

        rows = self.rows
        if self._choices.what == "deltas":
            return Picture(chart_svg(leading_delta(rows)))
        return Picture(
            chart_svg(
                margin_chart(rows)
                if self._choices.what == "margin"
                else trend_chart(self._series, rows, self.histories)
            )
        )


def trend(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    what: str = "trend",
    by: str = "parameter",
    sensors: bool = True,
    work_scope: str = "nested",
    events: Sequence[str] = (),
    margin: MarginOptions | None = None,
    alerts: str | Path | DeltaAlerts | None = None,
    setting: str = "",
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> TrendResult:
    """Follow the health of engines over flights, in the order of the files and of the flights in them.

    Parameters
    ----------
    nominal : str, Path, Baseline, IdentificationResult or None
        Nominal engine; None where the recordings are statistics that `residual` made.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    what : {"trend", "flights", "margin", "deltas"}
        One row per change with kind, onset and rate; one per flight and parameter; the EGT margin; or one per flight
        and raw delta.
    by : {"parameter", "component"}
        One row per parameter, or per event with all parameters of the component.
    sensors : bool
        Whether instruments may be wrong.
    work_scope : {"nested", "cell", "sentences", ""}
        How the effect of restoring a component is written into the rows.
    events : sequence of str
        First flights after maintenance, by their labels.
    margin : MarginOptions, optional
        From and to what the EGT margin is counted.
    alerts : path or DeltaAlerts, optional
        Alert levels of deltas.
    setting : str
        Power setting at which deltas are compared, a column; by default the engine's own.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read.
    **windows
        Attributes of `WindowOptions`; no change begins in the first ``reference`` records of an engine.

    Returns
    -------
    TrendResult

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    choices = TrendChoices(what, by, sensors, work_scope, tuple(events), margin or MarginOptions(), alerts, setting)
    return TrendResult(compare(nominal, recordings, windows, messages), choices).complete(stream)


def forecast(
    nominal: NominalLike,
    recordings: RecordingsLike,
    *,
    margin: MarginOptions | None = None,
    sensors: bool = True,
    messages: Messages | None = None,
    stream: bool = False,
    **windows: Any,
) -> TrendResult:
    """Forecast for how many flights the EGT margin lasts: `trend` with ``what="margin"``.

    Parameters
    ----------
    nominal : str, Path, Baseline or IdentificationResult
        Nominal engine.
    recordings
        Paths, `Recordings`, arrays or a DataFrame; see `read_recordings`.
    margin : MarginOptions, optional
        What the margin is counted to and from, such as ``MarginOptions(limits_K={"T45_K": 1280.0})``. Without a limit
        the rows say what wear has taken, and that there is no forecast.
    sensors : bool
        Whether instruments may be wrong.
    messages : Messages, optional
        Receives sentences and warnings; by default they are collected in the result.
    stream : bool
        Compute rows only as they are read.
    **windows
        Attributes of `WindowOptions`; no change begins in the first ``reference`` records of an engine.

    Returns
    -------
    TrendResult
        One row per flight, one per event of maintenance and one per engine with its margin [K], the rate at which it
        falls [K per flight] and the flights that are left, median and 90 % interval; or why there is no forecast.

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    return trend(
        nominal, recordings, what="margin", sensors=sensors, margin=margin, messages=messages, stream=stream, **windows
    )


class ReportPage:
    """A page; notebooks show it.

    Attributes
    ----------
    html : str
        The page, complete in itself.
    no_verdict : bool
        Whether the page has no verdict at all.
    """

    def __init__(self, html: str, no_verdict: bool, picture: str = ""):
        self.html, self.no_verdict, self._picture = html, no_verdict, picture

    def plot(self) -> Picture:
        """Draw the first screen: the verdict with its facts, and the first chart."""
        return Picture(self._picture)

    def save(self, path: str | Path) -> None:
        """Write the page, completely or not at all; ``-`` is standard output. Raises OSError."""
        from enginediag_cli.recordings.write import open_output

        with open_output(str(path)) as stream:
            stream.write(self.html)

    def _repr_html_(self) -> str:
        return self.html


def make_report(
    files: RecordingsLike,
    *,
    nominal: NominalLike = None,
    false_alarm: float = 0.01,
    margin: MarginOptions | None = None,
    alerts: str | Path | DeltaAlerts | None = None,
    title: str = "",
    static: bool = False,
    command: Sequence[str] = (),
    messages: Messages | None = None,
    **windows: Any,
) -> ReportPage:
    """Make one page of results: the verdict first, then charts with their tables, then the provenance.

    Parameters
    ----------
    files
        Results of other verbs or commands; with `nominal`, recordings among them are judged here.
    nominal : str, Path, Baseline or IdentificationResult, optional
        Nominal engine of the recordings.
    false_alarm : float
        Probability of a false alarm [1].
    margin : MarginOptions, optional
        From and to what the EGT margin is counted.
    alerts : path or DeltaAlerts, optional
        Alert levels of raw deltas.
    title : str
        Headline.
    static : bool
        Static pictures even if bokeh is installed.
    command : sequence of str
        Commands that the page shows as its origin.
    messages : Messages, optional
        Receives notes and warnings; by default they are collected in the result.
    **windows
        Attributes of `WindowOptions`.

    Returns
    -------
    ReportPage

    Raises
    ------
    UsageError, ConfigError, DataError, NoVerdictError
    """
    from enginediag_cli.report.html import EngineState, first_screen, plots_can_move, rendered, versions
    from enginediag_cli.report.page import build_page
    from enginediag_cli.report.plotting.interactive import WITHOUT

    comparison = compare(nominal, files, windows, messages if messages is not None else MessageLog())
    if margin and comparison.given is None:
        raise UsageError("limits and --events need -n NOMINAL; of results, give what trend --what margin wrote")
    if alerts is not None and comparison.given is None:
        raise UsageError("--alerts needs -n NOMINAL; of results, give what trend --what deltas --alerts wrote")
    results, unreadable = _results(comparison)
    levels = TrendChoices(what="deltas", alerts=alerts).delta_alerts()
    evidence, left_out = _evidence(comparison, results, false_alarm, margin or MarginOptions(), levels)
    if not static and not plots_can_move():
        comparison.messages.note(WITHOUT)
    page = build_page(
        evidence, title=title, command=list(command), left_out=[*unreadable, *left_out], versions=versions(static)
    )
    silent = [lead for lead in page.leads if lead.state is EngineState.NO_VERDICT]
    for lead in silent:
        whose = f"engine {lead.engine}: " if lead.engine else ""
        comparison.messages.warning(f"{whose}no verdict: {lead.sentence}")
    return ReportPage(rendered(page, static), len(silent) == len(page.leads), first_screen(page).text())


def _results(comparison: Comparison) -> tuple[list[ResultFile], list[str]]:
    """Read the results, with reasons for unreadable files. Raises DataError if none can be read."""
    from enginediag_cli.report.result_files import read_result

    source: RecordingSource = comparison.source
    results, unreadable = [], []
    for path in source.files:
        try:
            results.append(read_result(path, source.label(path), recordings=comparison.given is not None))
        except DataError as error:
            if len(source.files) == 1:
                raise
            unreadable.append(f"{error}: excluded")
    if not results:
        raise DataError("; ".join(unreadable))
    for sentence in unreadable:
        comparison.messages.warning(sentence)
    return results, unreadable


def _evidence(
    comparison: Comparison,
    results: list[ResultFile],
    false_alarm: float,
    margin: MarginOptions,
    alerts: DeltaAlerts,
) -> tuple[ReportEvidence, list[str]]:
    """Collect the findings of the results and of recordings that are judged here."""
    from enginediag_cli.report import result_files
    from enginediag_cli.report.evidence import RecordingsQuestion, collect_evidence, judge_recordings
    from enginediag_cli.report.result_files import known_parameters, nominal_result

    recordings = tuple(result.path for result in results if result.kind is result_files.RECORDING)
    if not recordings:
        if comparison.given is not None:
            raise DataError(f"--nominal {comparison.nominal}: none of the files is a recording that it could judge")
        return collect_evidence(results, known_parameters(results)), []
    if "-" in recordings:
        raise DataError("standard input can be read once, and recordings are read several times: name a file")
    source = replace(comparison.source, files=recordings)
    comparison = replace(comparison, source=source)
    monitor = comparison.monitor()
    silent = replace(comparison, messages=Messages(quiet=True))
    suspicious, isolating = silent.monitor(sensors=True), silent.monitor(sensors=True, drifts=True)
    assert monitor is not None and suspicious is not None and isolating is not None
    margins = margin.question(healthy=comparison.judging.reference)
    judging = comparison.judging
    question = RecordingsQuestion(source, monitor, suspicious, isolating, judging, false_alarm, margins, alerts)
    return judge_recordings(question, [*results, nominal_result(comparison.nominal)])
