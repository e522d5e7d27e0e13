"""`trend`: its tables and its words, what changed over flights and since when, and how much margin is left.

One row per parameter, per event, per flight and parameter, or per flight and event of maintenance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from enginediag_cli.detection.series import estimate_flight_change, has_times
from enginediag_cli.isolation.events import CANNOT_TELL, HALF
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.sentences import (
    change,
    instrument_in_flights,
    listed,
    probability,
)
from enginediag_cli.report.tables import Columns, Table, object_column
from enginediag_cli.report.tables.answers import WORK_SCOPE, work_scope_cells

if TYPE_CHECKING:
    from enginediag_cli.detection.series import FlightWindow, Series
    from enginediag_cli.fleets.work_scope import WorkScope
    from enginediag_cli.isolation.events import EventSuspect, SeriesDiagnosis, SeriesEvent


LEAST_INCLUSION = 0.01
"""Probability below which a suspect's parameter has no row of its own."""


class Onset(NamedTuple):
    """Since when something has changed: flights of the series, counted from 1, and where that flight is recorded."""

    onset: int
    onset_low: int
    onset_high: int
    onset_flight: str
    onset_source: str
    onset_line: int
    onset_s: float | None


class ChangeSize(NamedTuple):
    """Change up to the last flight and, where it grows, its mean rate since the onset, with 95 % intervals."""

    change: float
    change_low: float
    change_high: float
    rate_per_flight: float | None = None
    rate_low: float | None = None
    rate_high: float | None = None


class TrendRow(NamedTuple):
    """What a row is about: the series of an engine, an event in it, one of its suspects and a parameter of that."""

    engine: str
    story: SeriesDiagnosis
    series: Series
    event: SeriesEvent | None = None
    member: EventSuspect | None = None
    parameter: str = ""
    work_scope: Any = None

    @property
    def onset(self) -> Onset | None:
        if self.event is None:
            return None
        e, window = self.event, self.series.stretches[self.engine][self.event.onset - 1].window
        time_s = window.start_s if has_times(window) else None
        return Onset(e.onset, e.low, e.high, window.flight, window.source, window.first_line, time_s)

    @property
    def place(self) -> int:
        """Of the parameter among those of the suspect."""
        return self.member.parameters.index(self.parameter) if self.member else 0

    @property
    def size(self) -> ChangeSize | None:
        if self.event is None or self.member is None:
            return None
        x, half = self.member.change[self.place], NORMAL_95 * self.member.deviation[self.place]
        sizes = (x, x - half, x + half)
        if self.event.kind == "step":
            return ChangeSize(*sizes)
        span = max(self.story.flights - self.event.onset, 1)
        return ChangeSize(*sizes, *(size / span for size in sizes))

    @property
    def probability(self) -> float:
        if self.event is None or self.member is None:
            return self.story.inclusion.get(self.series.parameters[self.parameter].component, 0.0)
        return self.event.probability * self.member.probability * self.member.inclusion[self.place]

    @property
    def kind(self) -> str:
        if self.event is not None:
            return self.event.kind
        return CANNOT_TELL if self.story.differs_from_start or self.story.verdict == CANNOT_TELL else "steady"

    @property
    def rivals(self) -> list[str]:
        """The other suspects."""
        suspects = self.event.members if self.event and self.member else ()
        return _format_suspects(
            self.event, [m for m in suspects if self.member and m.component != self.member.component]
        )


def _format_suspects(event: SeriesEvent | None, members: Sequence[EventSuspect]) -> list[str]:
    chance = event.probability if event else 1.0
    return [f"{m.component} ({chance * m.probability:.2g})" for m in members]


row_column: Columns[TrendRow] = Columns()
story_column: Columns[SeriesDiagnosis] = Columns()
onset_column: Columns[Onset] = Columns()
size_column: Columns[ChangeSize] = Columns()
part_column: Columns[Any] = Columns()

_SERIES = (
    row_column("engine", "text", "engine, as its recording calls it"),
    row_column("flights", "integer", "flights, or windows, of the series", lambda row: row.story.flights),
)
_FIT = (
    *row_column.part(
        lambda row: row.story,
        (
            story_column(
                "verdict",
                "text",
                "of the engine: changed, steady, differs from nominal from the first flight on, or cannot tell",
            ),
            story_column("fit_before", "number?", "reduced χ² without any change", lambda story: story.fit.chi2_before),
            story_column("fit", "number?", "reduced χ² with this change", lambda story: story.fit.chi2_after),
            story_column("unlisted", "number?", "probability that it is something that is not among the suspects"),
        ),
    ),
    row_column(
        "instruments",
        "texts?",
        "instruments that are stuck or scatter, in words",
        lambda row: [instrument_in_flights(found) for found in row.series.instruments.get(row.engine, ())],
    ),
)
_ONSET = row_column.part(
    lambda row: row.onset,
    (
        onset_column("onset", "integer?", "flight from which on, counted from 1 in the series"),
        onset_column("onset_low", "integer?", "lower end of its 95 % interval"),
        onset_column("onset_high", "integer?", "upper end of its 95 % interval"),
        onset_column("onset_flight", "text?", "that flight, as its recording calls it"),
        onset_column("onset_source", "text?", "file that holds it"),
        onset_column("onset_line", "integer?", "its first line there"),
        onset_column("onset_s", "number?", "its time, where the recording has one", unit="s"),
    ),
)
_SCOPE = object_column(WORK_SCOPE, lambda row: row.work_scope, "--work-scope, or json")
_PARAMETER = "of the parameter"
_COURSE = ("onset_low", "onset_high", "onset_flight", "onset_line", "flights", "fit_before", "fit", "rivals")
"""What a terminal shows last of every change over flights, whatever changed."""

TREND: Table[TrendRow] = Table(
    "trend",
    1,
    "one row per parameter: what changed over flights, and since when",
    (
        *_SERIES,
        row_column("parameter", "text", "the parameter"),
        *_FIT,
        row_column(
            "component",
            "text",
            "component or instrument that it belongs to",
            lambda row: row.member.component if row.member else row.series.parameters[row.parameter].component,
        ),
        row_column(
            "kind",
            "text",
            "steady, step, deterioration, or cannot tell where the series is not steady and no change is named",
        ),
        row_column("probability", "number", "probability that it changed at all"),
        *_ONSET,
        *row_column.part(
            lambda row: row.size,
            (
                size_column("change", "number?", "change from before the onset to the last flight", unit=_PARAMETER),
                size_column("change_low", "number?", "lower end of its 95 % interval", unit=_PARAMETER),
                size_column("change_high", "number?", "upper end of its 95 % interval", unit=_PARAMETER),
                size_column("rate_per_flight", "number?", "mean rate since the onset", unit=_PARAMETER),
                size_column("rate_low", "number?", "lower end of its 95 % interval", unit=_PARAMETER),
                size_column("rate_high", "number?", "upper end of its 95 % interval", unit=_PARAMETER),
            ),
        ),
        row_column(
            "unit",
            "text",
            "unit of change and rate; 1 is a share of nominal",
            lambda row: row.series.parameters[row.parameter].unit,
        ),
        row_column("rivals", "texts", "other suspects of the same change, with their probabilities"),
        _SCOPE,
    ),
    ("engine", "verdict", "parameter", "kind", "probability", "onset", "rate_per_flight", "change", "unit", *_COURSE),
)


def _likelihood(row: TrendRow) -> float:
    """Of the change; without an event, that nothing changed. Flights that differ for certain leave nothing to that."""
    if row.event is not None:
        return row.event.probability * sum(m.probability for m in row.event.named)
    story = row.story
    return max(1 - story.unlisted - max(story.inclusion.values(), default=0.0), 0.0) * (not story.departures)


def _suspects(row: TrendRow) -> list[str]:
    """Of the event; without one those of which it is not known whether they changed."""
    undecided = row.story.undecided.members if row.story.undecided else ()
    return _format_suspects(row.event, row.event.members if row.event else undecided)


EVENTS: Table[TrendRow] = Table(
    "trend/components",
    1,
    "trend --by component: one row per event, one alone where there is none",
    (
        *_SERIES,
        *_FIT,
        row_column(
            "components",
            "texts",
            "the component that changed, or those that are indistinguishable",
            lambda row: [m.component for m in row.event.named] if row.event else [],
        ),
        row_column(
            "probability", "number", "probability of the change; without an event, that nothing changed", _likelihood
        ),
        row_column("kind", "text?", "step or deterioration", lambda row: row.event.kind if row.event else None),
        *_ONSET,
        row_column("rivals", "texts", "all suspects, with their probabilities", _suspects),
        _SCOPE,
    ),
    ("engine", "verdict", "components", "probability", "kind", "onset", *_COURSE),
)


def trend_rows(
    engine: str, story: SeriesDiagnosis, series: Series, scope: WorkScope | None = None, form: str = ""
) -> Iterator[dict[str, Any]]:
    """One row per parameter: those of the suspects of each event, then the steady ones. form: of what restoring would
    bring, "" without, "cell" as text, "nested" in full."""
    restored, optional = work_scope_cells(scope, form)
    changed = set()
    for event in story.events:
        for member in event.members:
            for name in member.parameters:
                row = TrendRow(engine, story, series, event, member, name, restored)
                if row.probability >= LEAST_INCLUSION:
                    changed.add(name)
                    yield TREND.row(row, optional)
    wrong = {series.parameters[name].component for name in changed if series.parameters[name].belongs_to_instrument}
    for name, parameter in series.parameters.items():
        if name not in changed and parameter.component not in wrong:  # the other form of an instrument's error
            yield TREND.row(TrendRow(engine, story, series, parameter=name, work_scope=restored), optional)


def component_rows(
    engine: str, story: SeriesDiagnosis, series: Series, scope: WorkScope | None = None, form: str = ""
) -> Iterator[dict[str, Any]]:
    """One row per event, with the component or the class of components; one alone where nothing changed or it is not
    known whether anything did, with the suspects as alternatives. form: as of `trend_rows`."""
    restored, optional = work_scope_cells(scope, form)
    for event in story.events or (None,):
        yield EVENTS.row(TrendRow(engine, story, series, event, work_scope=restored), optional)


class FlightParameter(NamedTuple):
    """The change of a parameter in one flight of a series."""

    engine: str
    number: int
    stretch: FlightWindow
    records: int
    parameter: str
    change: float
    error: float
    unit: str


flight_column: Columns[FlightParameter] = Columns()

FLIGHTS: Table[FlightParameter] = Table(
    "trend/flights",
    1,
    "trend --what flights: one row per flight and parameter",
    (
        flight_column("engine", "text", "engine, as its recording calls it"),
        flight_column("source", "text", "file that holds the flight", lambda row: row.stretch.window.source),
        flight_column("flight", "text", "flight, as its recording calls it", lambda row: row.stretch.window.flight),
        flight_column("number", "integer", "its number in the series, from 1"),
        flight_column("records", "integer", "records judged"),
        flight_column("parameter", "text", "the parameter"),
        flight_column("change", "number", "its change from nominal", unit=_PARAMETER),
        flight_column(
            "low", "number", "lower end of the 95 % interval", lambda r: r.change - NORMAL_95 * r.error, _PARAMETER
        ),
        flight_column(
            "high", "number", "upper end of the 95 % interval", lambda r: r.change + NORMAL_95 * r.error, _PARAMETER
        ),
        flight_column("unit", "text", "unit of the change; 1 is a share of nominal"),
    ),
    ("engine", "number", "flight", "parameter", "change", "low", "high", "unit", "records", "source"),
)


def flight_rows(series: Series) -> Iterator[dict[str, Any]]:
    """Changes from nominal, in the parameter's unit, with 95 % intervals."""
    counts: Counter[str] = Counter()
    for engine, stretches in series.stretches.items():
        for stretch in stretches:
            counts[engine] += 1
            found = estimate_flight_change(stretch.statistics)
            for name, size, error in zip(found.parameters, found.change, found.standard_error, strict=True):
                unit = series.parameters[name].unit
                yield FLIGHTS.row(
                    FlightParameter(engine, counts[engine], stretch, found.records, name, size, error, unit)
                )


def report_instruments_over_flights(messages: Messages, series: Series) -> None:
    """Instruments that are stuck or scatter in some flights of the engines of a series, in words."""
    for engine, wrong in series.instruments.items():
        for found in wrong:
            name = f"engine {engine}: " if engine else ""
            messages.note(f"{name}{instrument_in_flights(found)}", engine=engine)


def report_trend(messages: Messages, engine: str, story: SeriesDiagnosis, series: Series) -> None:
    """What happened during a series, in words."""
    name = f"engine {engine}: " if engine else ""
    if not story.converged:
        messages.warning(f"{name}the search for onsets did not converge", engine=engine)
    if story.events:
        messages.note(
            f"{name}reduced χ², by the scatter of the series: {story.fit.chi2_before:.3g} without, "
            f"{story.fit.chi2_after:.3g} with the change below",
            engine=engine,
        )
    if story.differs_from_start:
        messages.warning(
            f"{name}differs from nominal from the first flight on ({len(story.departures)} of {story.flights} flights):"
            " another engine, a wrong column or unit, or a change before that; run check and isolate",
            engine=engine,
        )
    elif story.departures and not story.events:
        first = series.stretches[engine][story.departures[0] - 1].window
        since = f"flight {first.flight}" if first.flight else f"line {first.first_line} of {first.source}"
        messages.warning(
            f"{name}no conclusion: {len(story.departures)} of {story.flights} flights differ from nominal for certain,"
            f" the first of them {since}, and no listed change explains the series; run isolate",
            engine=engine,
        )
    if story.unlisted >= HALF:
        messages.warning(
            f"{name}no conclusion: probably none of the suspects (probability {probability(story.unlisted)}); "
            f"the reduced χ² with the best listed change is {story.fit.chi2_after:.3g}",
            engine=engine,
        )
    if story.undecided:
        suspects = listed([m.component for m in story.undecided.named])
        messages.note(
            f"{name}no conclusion: if the readings scatter from each flight to the next alone, {suspects} changed; if "
            "they wander by themselves, as instruments and unrecorded operation do, nothing did",
            engine=engine,
        )
    for event in story.events:
        since = _onset_words(event, series.stretches[engine])
        members = event.named
        parts = []
        for member in members:
            shown = [
                change(series.parameters[p], member.change[q], NORMAL_95 * member.deviation[q])
                for q, p in enumerate(member.parameters)
                if member.inclusion[q] >= 0.5
            ]
            if shown or not member.parameters:
                shown = shown or [f"{member.component} changed"]
                parts.append((listed(shown), event.probability * member.probability))
        if len(members) == 1:
            text, chance = parts[0]
            messages.note(f"{name}{since}: {text} (probability {probability(chance)})", engine=engine)
        else:
            each = "; or ".join(f"{text} ({probability(chance)})" for text, chance in parts)
            messages.note(f"{name}{since}: not separated: {each}", engine=engine)


def _onset_words(event: SeriesEvent, stretches: Sequence[FlightWindow]) -> str:
    """When it began: flights by their labels, else seconds, else lines, with the interval."""
    at, low, high = (stretches[k - 1].window for k in (event.onset, event.low, event.high))
    word = "at once, from" if event.kind == "step" else "growing, from"
    if at.flight:
        text, interval = f"flight {at.flight}", f"{low.flight} to {high.flight}"
    elif has_times(at):
        text, interval = f"{at.start_s:.10g} s", f"{low.start_s:.10g} to {high.start_s:.10g}"
    else:
        text, interval = f"line {at.first_line} of {at.source}", f"{low.first_line} to {high.first_line}"
    return f"{word} {text} on ({interval})" if low is not high else f"{word} {text} on"


def report_too_few_flights(messages: Messages, engine: str, count: int) -> None:
    """Why an engine has no trend."""
    name = f"engine {engine}: " if engine else ""
    told = f"{name}{count} flights are too few for a trend, which needs three; --window cuts long flights"
    messages.warning(told, engine=engine, flights=count)
