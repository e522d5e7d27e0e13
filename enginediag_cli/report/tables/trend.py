"""`trend`: its tables and its words, what changed over flights and since when, and how much margin is left.

One row per parameter, per event, per flight and parameter, or per flight and event of maintenance.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf, isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from enginediag_cli.detection.series import estimate_flight_change, has_times
from enginediag_cli.history.engines import (
    DETERIORATION,
    STEADY,
    UNLIKELY,
    EngineTrend,
)
from enginediag_cli.history.hypotheses import FROM_START, INTERMITTENT, RESTORED, WASHED
from enginediag_cli.history.posterior import EVENT
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.messages import Messages
from enginediag_cli.report.plotting import date_words
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
    from enginediag_cli.history.deltas import FlightDeltas
    from enginediag_cli.history.posterior import ChangeEvent, HistoryChange


COURSE_WORDS = {"step": "at once", DETERIORATION: "growing", FROM_START: "off nominal"}
"""How a change came, in a sentence."""


class Onset(NamedTuple):
    """Since when something has changed: flights of the series, counted from 1, and where that flight is recorded; end:
    first flight without the change again, None where it lasts."""

    onset: int
    onset_low: int
    onset_high: int
    onset_flight: str
    onset_source: str
    onset_line: int
    onset_s: float | None
    end: int | None


class ChangeSize(NamedTuple):
    """Change up to the last flight, its largest, and, where it grows, its mean rate since the onset, with 95 %
    intervals."""

    change: float
    change_low: float
    change_high: float
    largest: float
    largest_low: float
    largest_high: float
    rate_per_flight: float | None = None
    rate_low: float | None = None
    rate_high: float | None = None


class TrendRow(NamedTuple):
    """What a row is about: the history of an engine, an event in it, and the parameter of its likeliest suspect."""

    engine: str
    found: EngineTrend
    series: Series
    event: ChangeEvent | None = None
    part: HistoryChange | None = None
    parameter: str = ""
    work_scope: Any = None

    @property
    def onset(self) -> Onset | None:
        if self.event is None or self.kind == STEADY:
            return None
        e, found = self.event, self.found
        number, low, high = found.onset_numbers(e)
        window = self.series.stretches[self.engine][number - 1].window
        time_s = window.start_s if has_times(window) else None
        end = found.flight_number(e.end) if 0 <= e.end < len(found.first) else None
        return Onset(number, low, high, window.flight, window.source, window.first_line, time_s, end)

    @property
    def size(self) -> ChangeSize | None:
        if self.event is None or self.part is None:
            return None
        x = self.part
        sizes = (x.now, x.now_low, x.now_high, x.largest, x.largest_low, x.largest_high)
        if self.kind != DETERIORATION or self.event.end >= 0:
            return ChangeSize(*sizes)
        span = max(self.found.flights - self.found.flight_number(self.event.onset) + 1, 1)
        return ChangeSize(*sizes, *(size / span for size in sizes[:3]))

    @property
    def probability(self) -> float:
        return self.found.parameter_probability(self.parameter, self.series.parameters[self.parameter].component)

    @property
    def detectable(self) -> float | None:
        seen = self.found.visible
        size = seen.smallest.get(self.parameter, inf) if seen is not None else inf
        return size if isfinite(size) else None

    @property
    def kind(self) -> str:
        if self.event is not None:
            steady = self.part is not None and self.part.probability < EVENT
            return STEADY if steady else self.found.family(self.event)
        return self.found.calm_kind(self.parameter)

    @property
    def rivals(self) -> list[str]:
        """The other suspects."""
        if self.event is None:
            return []
        own = self.series.parameters[self.parameter].component if self.part else self.event.group[0]
        return _format_suspects(self.event, own)


def _format_suspects(event: ChangeEvent, but: str = "") -> list[str]:
    shown = {name: p for name, p in event.suspects.items() if p >= UNLIKELY and name != but}
    return [f"{name} ({event.probability * p:.2g})" for name, p in shown.items()]


row_column: Columns[TrendRow] = Columns()
found_column: Columns[EngineTrend] = Columns()
onset_column: Columns[Onset] = Columns()
size_column: Columns[ChangeSize] = Columns()
part_column: Columns[Any] = Columns()

_SERIES = (
    row_column("engine", "text", "engine, as its recording calls it"),
    row_column("flights", "integer", "flights, or windows, of the series", lambda row: row.found.flights),
)
_FIT = (
    *row_column.part(
        lambda row: row.found,
        (
            found_column(
                "verdict",
                "text",
                "of the engine: changed, steady, differs from nominal from the first flight on, or cannot tell",
            ),
            found_column(
                "reason",
                "text?",
                "why it is not known what changed, or whether anything did",
                lambda found: found.reason or None,
            ),
            found_column(
                "fit_before",
                "number?",
                "reduced χ² without any change",
                lambda found: found.posterior.quiet.ratio,
            ),
            found_column("fit", "number?", "reduced χ² with all changes", lambda found: found.posterior.check.ratio),
            found_column(
                "unlisted",
                "number?",
                "probability that it is something that is not among the suspects",
                lambda found: found.posterior.unlisted,
            ),
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
        onset_column("end", "integer?", "first flight after it was taken back, at least in part; none where it lasts"),
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
            lambda row: row.series.parameters[row.parameter].component,
        ),
        row_column(
            "kind",
            "text",
            "steady, step, deterioration, comes and goes (once), intermittent, from the start, irregular, or cannot "
            "tell where no change is named and these flights would not have shown one",
        ),
        row_column(
            "shapes",
            "texts?",
            "courses over flights, with their probabilities",
            lambda row: _format_shapes(row.event) if row.event else None,
        ),
        row_column("probability", "number", "probability that it changed at all"),
        *_ONSET,
        *row_column.part(
            lambda row: row.size,
            (
                size_column("change", "number?", "change from before the onset to the last flight", unit=_PARAMETER),
                size_column("change_low", "number?", "lower end of its 95 % interval", unit=_PARAMETER),
                size_column("change_high", "number?", "upper end of its 95 % interval", unit=_PARAMETER),
                size_column("largest", "number?", "its largest change", unit=_PARAMETER),
                size_column("largest_low", "number?", "lower end of its 95 % interval", unit=_PARAMETER),
                size_column("largest_high", "number?", "upper end of its 95 % interval", unit=_PARAMETER),
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
        row_column(
            "detectable",
            "number?",
            "smallest step after the baseline, of it alone, that these flights would have shown",
            lambda row: row.detectable,
            unit=_PARAMETER,
        ),
        row_column("rivals", "texts", "other suspects of the same change, with their probabilities"),
        _SCOPE,
    ),
    ("engine", "verdict", "parameter", "kind", "probability", "onset", "rate_per_flight", "change", "unit", *_COURSE),
)


def _format_shapes(event: ChangeEvent) -> list[str]:
    return [f"{name} ({p:.2g})" for name, p in event.shapes.items() if p >= UNLIKELY]


def _likelihood(row: TrendRow) -> float:
    """Of the change; without an event, that nothing changed. Flights that differ for certain leave nothing to that."""
    if row.event is not None:
        return row.event.probability * sum(row.event.suspects[name] for name in row.event.group)
    return (1 - row.found.posterior.probability) * (not row.found.departures)


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
            lambda row: list(row.event.group) if row.event else [],
        ),
        row_column(
            "probability", "number", "probability of the change; without an event, that nothing changed", _likelihood
        ),
        row_column(
            "kind",
            "text?",
            "step, deterioration, comes and goes, intermittent, from the start or irregular",
            lambda row: row.found.family(row.event) if row.event else None,
        ),
        *_ONSET,
        row_column(
            "rivals",
            "texts",
            "all suspects, with their probabilities",
            lambda row: _format_suspects(row.event) if row.event else [],
        ),
        _SCOPE,
    ),
    ("engine", "verdict", "components", "probability", "kind", "onset", *_COURSE),
)


def trend_rows(
    engine: str, found: EngineTrend, series: Series, scope: WorkScope | None = None, form: str = ""
) -> Iterator[dict[str, Any]]:
    """One row per parameter: those of the suspects of each event, then the steady ones. form: of what
    restoring would bring, "" without, "cell" as text, "nested" in full."""
    restored, optional = work_scope_cells(scope, form)
    changed = set()
    for event in found.events:
        for part in (*event.changes, *event.rivals):
            if part.name in changed:
                continue
            changed.add(part.name)
            yield TREND.row(TrendRow(engine, found, series, event, part, part.name, restored), optional)
    wrong = {series.parameters[name].component for name in changed if series.parameters[name].belongs_to_instrument}
    for name, parameter in series.parameters.items():
        if name not in changed and parameter.component not in wrong:  # the other form of an instrument's error
            yield TREND.row(TrendRow(engine, found, series, parameter=name, work_scope=restored), optional)


def component_rows(
    engine: str, found: EngineTrend, series: Series, scope: WorkScope | None = None, form: str = ""
) -> Iterator[dict[str, Any]]:
    """One row per event, with the component or the class of components; one alone where nothing changed or it is not
    known whether anything did. form: as of `trend_rows`."""
    restored, optional = work_scope_cells(scope, form)
    for event in found.events or (None,):
        yield EVENTS.row(TrendRow(engine, found, series, event, work_scope=restored), optional)


class FlightParameter(NamedTuple):
    """The change of a parameter in one flight of a series; level, deviation: as all flights together have it, where a
    history was judged."""

    engine: str
    number: int
    stretch: FlightWindow
    records: int
    parameter: str
    change: float
    error: float
    unit: str
    level: float | None = None
    deviation: float = 0.0

    @property
    def time_s(self) -> float | None:
        return self.stretch.window.start_s if has_times(self.stretch.window) else None

    def level_end(self, side: int) -> float | None:
        return None if self.level is None else self.level + side * NORMAL_95 * self.deviation


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
        flight_column("level", "number?", "its change as all flights together have it", unit=_PARAMETER),
        flight_column(
            "level_low", "number?", "lower end of its 95 % interval", lambda r: r.level_end(-1), unit=_PARAMETER
        ),
        flight_column(
            "level_high", "number?", "upper end of its 95 % interval", lambda r: r.level_end(1), unit=_PARAMETER
        ),
        flight_column("time_s", "number?", "when the flight begins, where the recording has a time", unit="s"),
    ),
    (
        *("engine", "number", "flight", "parameter", "change", "low", "high", "unit"),
        *("level", "level_low", "level_high", "records", "source"),
    ),
)


def flight_rows(series: Series, histories: Mapping[str, EngineTrend] | None = None) -> Iterator[dict[str, Any]]:
    """Changes from nominal, in the parameter's unit, with 95 % intervals; histories: by engine, what all its flights
    together say."""
    counts: Counter[str] = Counter()
    for engine, stretches in series.stretches.items():
        history = (histories or {}).get(engine)
        for stretch in stretches:
            counts[engine] += 1
            found = estimate_flight_change(stretch.statistics)
            levels = {} if history is None else history.flight_levels(counts[engine])
            for name, size, error in zip(found.parameters, found.change, found.standard_error, strict=True):
                unit, level = series.parameters[name].unit, levels.get(name, (None, 0.0))
                yield FLIGHTS.row(
                    FlightParameter(engine, counts[engine], stretch, found.records, name, size, error, unit, *level)
                )


class DeltaRow(NamedTuple):
    """Number t and column j, from 0, of the deltas of an engine."""

    found: FlightDeltas
    t: int
    j: int

    @property
    def stretch(self) -> FlightWindow:
        return self.found.stretches[self.t]

    def pick(self, values: Any) -> float | None:
        """The value of this flight and column; None where it is not known."""
        value = float(values[self.t, self.j])
        return value if isfinite(value) else None

    @property
    def after_maintenance(self) -> bool:
        """Whether smoothing begins anew with this flight."""
        return self.t + 1 in self.found.events

    def bound(self, values: Any, errors: Any, side: float) -> float | None:
        """One end of the 95 % interval."""
        value, error = self.pick(values), self.pick(errors)
        return None if value is None or error is None else value + side * NORMAL_95 * error


def _stated_level(key: str) -> Callable[[DeltaRow], float | None]:
    """Cell of a level of the delta's column."""
    return lambda r: r.found.levels.get(r.found.columns[r.j], {}).get(key)


ALERT_LEVELS = ("caution_low", "caution_high", "warning_low", "warning_high")
"""Columns of the alert levels, which are keys of an alerts file."""

delta_column: Columns[DeltaRow] = Columns()
_SHOWN = "as shown"

DELTAS: Table[DeltaRow] = Table(
    "trend/deltas",
    1,
    "trend --what deltas: one row per flight and reading: minus what the nominal engine reads at equal power setting",
    (
        delta_column("engine", "text", "engine, as its recording calls it", lambda r: r.found.engine),
        delta_column("source", "text", "file that holds the flight", lambda r: r.stretch.window.source),
        delta_column("flight", "text", "flight, as its recording calls it", lambda r: r.stretch.window.flight),
        delta_column("number", "integer", "its number in the series, from 1", lambda r: r.t + 1),
        delta_column(
            "date",
            "text?",
            "when it began, UTC, where recordings count time from 1970",
            lambda r: None if r.found.dates is None else date_words(r.found.dates[r.t]),
        ),
        delta_column("records", "integer", "records judged", lambda r: r.stretch.statistics.n),
        delta_column("column", "text", "the reading, or the input that sets the power", lambda r: r.found.columns[r.j]),
        delta_column("name", "text", "what it is called, by the alerts file", lambda r: r.found.names[r.j]),
        delta_column(
            "delta",
            "number?",
            "mean over the flight of reading minus prediction",
            lambda r: r.pick(r.found.delta),
            _SHOWN,
        ),
        delta_column(
            "low",
            "number?",
            "lower end of its 95 % interval, by the noise of the readings alone",
            lambda r: r.bound(r.found.delta, r.found.error, -1.0),
            _SHOWN,
        ),
        delta_column(
            "high",
            "number?",
            "upper end of its 95 % interval",
            lambda r: r.bound(r.found.delta, r.found.error, 1.0),
            _SHOWN,
        ),
        delta_column(
            "smoothed",
            "number?",
            "exponentially weighted mean of this flight and those before it, since the last maintenance",
            lambda r: r.pick(r.found.smoothed),
            _SHOWN,
        ),
        delta_column(
            "smoothed_low",
            "number?",
            "lower end of its 95 % interval, by how flights scatter",
            lambda r: r.bound(r.found.smoothed, r.found.smoothed_error, -1.0),
            _SHOWN,
        ),
        delta_column(
            "smoothed_high",
            "number?",
            "upper end of its 95 % interval",
            lambda r: r.bound(r.found.smoothed, r.found.smoothed_error, 1.0),
            _SHOWN,
        ),
        delta_column(
            "unit", "text", "unit of the deltas: °C, or % of what nominal reads", lambda r: r.found.units[r.j]
        ),
        delta_column("level", "text?", "caution or warning, else empty", lambda r: r.found.level[r.t, r.j] or None),
        delta_column(
            "since",
            "integer?",
            "number of the flight from which on the smoothed delta has been beyond that level",
            lambda r: int(r.found.since[r.t, r.j]) or None,
        ),
        *(
            delta_column(
                key,
                "number?",
                f"{key.replace('_', ', ')} side, as the alerts file states it",
                _stated_level(key),
                _SHOWN,
            )
            for key in ALERT_LEVELS
        ),
        delta_column("setting", "text", "power setting at which deltas are compared", lambda r: r.found.setting),
        delta_column(
            "maintenance", "boolean", "whether it is the first flight after maintenance", lambda r: r.after_maintenance
        ),
        delta_column(
            "smoothing_flights", "number", "flights of the smoothing", lambda r: float(r.found.smoothing_flights)
        ),
        delta_column(
            "time_s",
            "number?",
            "when the flight began, seconds since 1970, where recordings count from there",
            lambda r: None if r.found.dates is None else float(r.found.dates[r.t]),
            "s",
        ),
    ),
    ("engine", "number", "date", "name", "delta", "smoothed", "unit", "level", "since", "flight", "records", "source"),
)


def delta_rows(found: FlightDeltas) -> Iterator[dict[str, Any]]:
    """One row per flight and column, flights in order."""
    for t in range(len(found)):
        for j in range(len(found.columns)):
            yield DELTAS.row(DeltaRow(found, t, j))


def report_deltas(messages: Messages, found: Mapping[str, FlightDeltas]) -> None:
    """What the deltas of each engine are now, and since when they are beyond a level."""
    for engine, deltas in found.items():
        name = f"engine {engine}: " if engine else ""
        own = f"{name}at equal {deltas.setting}: " if deltas.setting else name
        now = deltas.smoothed[-1]
        shown = [
            f"Δ{deltas.names[j]} {now[j]:+.3g} {deltas.units[j]} ± {NORMAL_95 * deltas.smoothed_error[-1, j]:.2g}"
            for j in range(len(deltas.columns))
            if isfinite(now[j])
        ]
        messages.note(f"{own}{', '.join(shown)}".replace("-", "−"), engine=engine)
        for j, level in enumerate(deltas.level[-1]):
            if level:
                since = deltas.stretches[deltas.since[-1, j] - 1].window.flight or deltas.since[-1, j]
                messages.warning(f"{name}Δ{deltas.names[j]}: {level} since flight {since}", engine=engine)


def report_instruments_over_flights(messages: Messages, series: Series) -> None:
    """Instruments that are stuck or scatter in some flights of the engines of a series, in words."""
    for engine, wrong in series.instruments.items():
        for found in wrong:
            name = f"engine {engine}: " if engine else ""
            messages.note(f"{name}{instrument_in_flights(found)}", engine=engine)


def report_trend(messages: Messages, engine: str, found: EngineTrend, series: Series) -> None:
    """What happened during a history, in words."""
    name = f"engine {engine}: " if engine else ""
    posterior, flights = found.posterior, series.stretches[engine]
    if found.events:
        messages.note(
            f"{name}reduced χ² {posterior.quiet.ratio:.3g} without, {posterior.check.ratio:.3g} with the changes below",
            engine=engine,
        )
    if found.differs_from_start:
        messages.warning(
            f"{name}differs from nominal from the first flight on: another engine, a wrong column or unit, or a change "
            "before that; run check and isolate",
            engine=engine,
        )
    elif found.departures and not found.events:
        first = flights[found.departures[0] - 1].window
        since = f"flight {first.flight}" if first.flight else f"line {first.first_line} of {first.source}"
        messages.warning(
            f"{name}no conclusion: {len(found.departures)} of {found.flights} flights differ from nominal for certain,"
            f" the first of them {since}, and no listed change explains the series; run isolate",
            engine=engine,
        )
    elif found.impossible or (found.undecided and not found.departures):
        messages.warning(f"{name}no conclusion: {found.reason}", engine=engine)
    if posterior.unlisted >= EVENT and not found.impossible:
        messages.warning(
            f"{name}no conclusion: something changed that is probably none of the suspects (probability "
            f"{probability(posterior.unlisted)})",
            engine=engine,
        )
    for sensor, ratio in posterior.check.scatter.items():
        messages.note(
            f"{name}{sensor} scatters from flight to flight by {ratio**0.5:.2g} times what was learnt", engine=engine
        )
    for event in found.events:
        messages.note(f"{name}{_event_words(event, found, series, flights)}", engine=engine)


def _event_words(event: ChangeEvent, found: EngineTrend, series: Series, flights: Sequence[FlightWindow]) -> str:
    """One event in words, with its suspect or ambiguity group."""
    parts = []
    for x in event.changes:
        if x.probability >= EVENT:
            low, high, size = x.now_low, x.now_high, x.now
            if event.kind in (*RESTORED, INTERMITTENT):
                low, high, size = x.largest_low, x.largest_high, x.largest
            parts.append(change(series.parameters[x.name], size, (high - low) / 2))
    shown = listed(parts) or f"{event.group[0]} changed"
    since = _onset_words(event, found, flights)
    if len(event.group) == 1:
        return f"{since}: {shown} (probability {probability(event.probability * event.suspects[event.group[0]])})"
    each = [f"{n} ({probability(event.probability * event.suspects[n])})" for n in event.group]
    return f"{since}: not separated: {listed(each, 'or')}; if {event.group[0]}, {shown}"


def _onset_words(event: ChangeEvent, found: EngineTrend, flights: Sequence[FlightWindow]) -> str:
    """When it began: flights by their labels, else seconds, else lines, with the interval."""
    at, low, high = (flights[k - 1].window for k in found.onset_numbers(event))
    family = found.family(event)
    word = COURSE_WORDS.get(family, family)
    if at.flight:
        text, interval = f"flight {at.flight}", f"{low.flight} to {high.flight}"
    elif has_times(at):
        text, interval = f"{at.start_s:.10g} s", f"{low.start_s:.10g} to {high.start_s:.10g}"
    else:
        text, interval = f"line {at.first_line} of {at.source}", f"{low.first_line} to {high.first_line}"
    words = f"{word}, from {text} on ({interval})" if low is not high else f"{word}, from {text} on"
    if 0 <= event.end < len(found.first):
        last = flights[found.flight_number(event.end) - 1].window
        how = "restored at" if event.kind == WASHED else "until"
        words += f", {how} {f'flight {last.flight}' if last.flight else f'line {last.first_line}'}"
    return words


def report_too_few_flights(messages: Messages, engine: str, count: int) -> None:
    """Why an engine has no trend."""
    name = f"engine {engine}: " if engine else ""
    reason = f"{name}{count} flights are too few for a trend, which needs three; --window cuts long flights"
    messages.warning(reason, engine=engine, flights=count)
