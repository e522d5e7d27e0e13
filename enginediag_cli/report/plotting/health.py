"""Charts over flights: health of one engine, its EGT margin with forecast, and a fleet.

Of a fleet: the evidence over the life of an engine, engines by severity, and a heat map engines × parameters, which
shows what is one engine's own and what all have. The document of `fleet` is read as objects; unknown values are NaN.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Protocol, TypeVar

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import IntervalEstimate
from enginediag_cli.parameters import Parameter, spelled, unspecified
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.plotting import (
    STEPS,
    Axis,
    Band,
    Chart,
    ChartTable,
    EventMark,
    HeatCells,
    Intervals,
    Layer,
    Line,
    ReferenceLine,
    RowOrigin,
    Value,
    chart_columns,
    every,
)
from enginediag_cli.report.result_files import Order, Row, order_windows
from enginediag_cli.report.sentences import (
    capital,
    count,
    display_scale,
    format_quantity,
    listed,
    maintained,
    rounded,
)
from enginediag_cli.report.tables.fleet import (
    FLIGHT,
    MAINTENANCE,
    WHOLE,
    available_words,
    interval_columns,
    margin_words,
)
from enginediag_cli.units import split_column

NAN = float("nan")


@dataclass(frozen=True)
class ParameterHealth:
    """One parameter of an engine."""

    parameter: Parameter
    component: str
    change: IntervalEstimate
    kind: str
    probability: float
    onset: int
    onset_flight: str
    origin: RowOrigin

    @property
    def words(self) -> str:
        return self.parameter.words

    @property
    def scale(self) -> float:
        return display_scale(self.parameter)[0]

    @property
    def shown_unit(self) -> str:
        return display_scale(self.parameter)[1]


@dataclass(frozen=True)
class FlightEvidence:
    """One flight of an engine, as far as its verdict and its margin go."""

    number: int
    flight: str
    verdict: str
    consumed_K: float
    consumed_error_K: float
    origin: RowOrigin


@dataclass(frozen=True)
class MarginRecord:
    """The margin of the hottest temperature of an engine."""

    column: str
    condition: str
    limit_K: float
    consumed_K: IntervalEstimate
    now_K: IntervalEstimate
    remaining_flights: IntervalEstimate
    reason: str


@dataclass(frozen=True)
class PowerRecord:
    """Power or thrust available at the limit that binds, in the unit of its column, with that of the healthy engine."""

    column: str
    value: IntervalEstimate
    nominal: float
    limited_by: str
    condition: str
    reason: str


@dataclass(frozen=True)
class MaintenanceRecord:
    """Maintenance; `number`: of the first flight after it, 0 where there is none."""

    kind: str
    component: str
    number: int
    recovered_K: IntervalEstimate
    reason: str
    origin: RowOrigin

    @property
    def words(self) -> str:
        return maintained(self.kind, self.component)


@dataclass(frozen=True)
class AcknowledgedFinding:
    """That a finding is known: since when, after how many flights, by which note, and which parameters have grown."""

    date: str
    flights: int
    note: str
    grown: Sequence[str]

    @property
    def words(self) -> str:
        """For instance "acknowledged 2026-03-01 after 40 flights: wash planned; not raised again unless it grows"."""
        known = f"acknowledged {self.date} after {count(self.flights, 'flight')}"
        known += f": {self.note}" if self.note else ""
        return f"{known}; since then grown: {', '.join(self.grown)}" if self.grown else f"{known}; {UNLESS_IT_GROWS}"


UNLESS_IT_GROWS = "not raised again unless it grows"


@dataclass(frozen=True)
class FleetEngine:
    """What a fleet document says of one engine; `since`: flight of the first change, with its interval."""

    serial: str
    build: str
    flights: int
    records: int
    verdict: str
    reason: str
    probability: float
    discovery: bool
    since: tuple[int, int, int]
    since_flight: str
    severity: IntervalEstimate
    severity_unit: str
    health: Sequence[ParameterHealth]
    by_flight: Sequence[FlightEvidence]
    events: Sequence[MaintenanceRecord]
    margin: MarginRecord
    power: PowerRecord
    origin: RowOrigin
    instruments: Sequence[str] = ()
    acknowledged: AcknowledgedFinding | None = None

    @property
    def is_settled(self) -> bool:
        """Whether all that has changed is acknowledged, and none of it has grown."""
        return self.acknowledged is not None and not self.acknowledged.grown


def read_engines(document: Mapping[str, Any], file: str) -> list[FleetEngine]:
    """All engines, in their order. DataError names the place of what is missing or wrong."""
    found = []
    for k, engine in enumerate(document["engines"]):
        place = f"engines[{k}]"
        try:
            found.append(_engine(engine, file, place))
        except (KeyError, TypeError, ValueError) as error:
            what = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)
            raise DataError(f"{file}:{place}: not an engine as `fleet` writes it: {what}") from None
    return found


def _engine(e: Mapping[str, Any], file: str, place: str) -> FleetEngine:
    def parts(kind: type[Part], key: str, values: Callable[[Mapping[str, Any]], Mapping[str, Any]]) -> list[Part]:
        entries = enumerate(e.get(key) or ())
        return [_read(kind, x, **values(x), origin=RowOrigin(file, f"{place}.{key}[{k}]")) for k, x in entries]

    return _read(
        FleetEngine,
        {**e, "serial": e["serial"], "flights": e["flights"], "verdict": e["verdict"]},
        since=tuple(int(e.get(name) or 0) for name in ("since", "since_low", "since_high")),
        health=parts(ParameterHealth, "health", lambda x: {"parameter": _parameter(x)}),
        by_flight=parts(FlightEvidence, "by_flight", lambda x: {"number": int(x["number"])}),
        events=parts(MaintenanceRecord, "events", _event),
        margin=_read(MarginRecord, e.get("margin") or {}),
        power=_read(PowerRecord, e.get("power") or {}),
        origin=RowOrigin(file, place),
        instruments=[str(x["words"]) for x in e.get("instruments") or ()],
        acknowledged=_acknowledged(e),
    )


def _acknowledged(e: Mapping[str, Any]) -> AcknowledgedFinding | None:
    known = e.get("acknowledged")
    if not known:
        return None
    words = {str(h["parameter"]): str(h.get("words") or h["parameter"]) for h in e.get("health") or ()}
    grown = [words.get(str(name), str(name)) for name in known.get("grown") or ()]
    return AcknowledgedFinding(str(known["date"]), int(known["flights"]), str(known.get("note") or ""), grown)


Part = TypeVar("Part")


def _read(kind: type[Part], values: Mapping[str, Any], /, **known: Any) -> Part:
    """An object of this kind from the values of a document; what is not there is empty, 0 or not known."""
    cells = {f.name: READERS[str(f.type)](values.get(f.name)) for f in fields(kind) if f.name not in known}  # type: ignore[arg-type]
    return kind(**cells, **known)


def _event(x: Mapping[str, Any]) -> dict[str, str]:
    event = x.get("event") or {}
    return {"kind": str(event.get("kind") or "event"), "component": str(event.get("component") or "")}


def _parameter(h: Mapping[str, Any]) -> Parameter:
    component = str(h.get("component") or h["parameter"])
    return replace(
        unspecified(str(h["parameter"]), str(h.get("unit") or "1")),
        words=str(h.get("words") or h["parameter"]),
        component=component,
        part=str(h.get("part") or spelled(component)),
        family=str(h.get("family") or "health"),
        quantity=str(h.get("quantity") or ""),
    )


def _estimate(value: Any) -> IntervalEstimate:
    if not isinstance(value, Mapping):
        return IntervalEstimate(_number(value))
    return IntervalEstimate(*(_number(value.get(name)) for name in ("value", "low", "high")))


def _number(value: Any) -> float:
    """NaN where there is none; JSON has no infinity either, which then is not known."""
    if value is None:
        return NAN
    number = float(value)
    return number if math.isfinite(number) else NAN


READERS: Mapping[str, Callable[[Any], Any]] = {
    "str": lambda value: str(value or ""),
    "int": lambda value: int(value or 0),
    "bool": bool,
    "float": _number,
    IntervalEstimate.__name__: _estimate,
}
"""How a value of a document is read, by the type of the field."""


MOST = 40
"""Engines that are drawn; the table has all."""


def fleet_ranking(key: str, engines: Sequence[FleetEngine]) -> Chart:
    """Engines in the order of their rank."""
    known = [e for e in engines if math.isfinite(e.severity.value)]
    shown = known[:MOST]
    unit = next((e.severity_unit for e in known if e.severity_unit), "")
    layers: list[Layer] = []
    for colour, (verdict, words) in enumerate((("healthy", "no change shown"), ("changed", "changed"))):
        mine = [k for k, e in enumerate(shown) if (e.verdict == "changed") == (verdict == "changed")]
        if mine:
            values = [shown[k].severity for k in mine]
            low, high = [v.low for v in values], [v.high for v in values]
            origins = [shown[k].origin for k in mine]
            points = [v.value for v in values]
            layers.append(Intervals(words, points, [float(k) for k in mine], low, high, colour, True, origins))
    columns = chart_columns(
        "rank",
        "engine",
        "build",
        "verdict",
        ("severity", unit),
        ("95 % from", unit),
        ("to", unit),
        "flagged",
        "probability of a change",
        "flights",
    )
    rows = [
        (
            rank,
            e.serial,
            e.build,
            e.verdict + (f": {e.reason}" if e.reason else ""),
            e.severity.value,
            e.severity.low,
            e.severity.high,
            "yes" if e.discovery else "",
            e.probability,
            e.flights,
        )
        for rank, e in enumerate(engines, start=1)
    ]
    left = len(engines) - len(shown)
    of_margin = unit == "K"
    words = "K of margin used" if of_margin else "severity, prior standard deviations"
    caption = "Margin that each engine has used since its baseline"
    if not of_margin:
        caption = "How far the health of each engine is from its baseline, in standard deviations of what is usual"
    return Chart(
        key,
        "Engines by severity",
        Axis(words),
        Axis("", categories=[e.serial for e in shown]),
        layers,
        ChartTable(columns, rows, [e.origin for e in engines]),
        f"{caption}, with 95 % intervals."
        + (f" {left} more engines, less severe or not judged, are in the table." if left else ""),
    )


FLEET_DARKEST, SCORES = 8.0, "change in standard errors"
"""Standard errors at which a cell is darkest, and what they are of."""


def fleet_map(key: str, engines: Sequence[FleetEngine]) -> Chart | None:
    """Change of each parameter in its standard errors; empty where it is not known, None without such an engine."""
    shown = [e for e in engines if any(math.isfinite(standard_score(h)) for h in e.health)][:MOST]
    names = list(dict.fromkeys(h.words for e in shown for h in e.health if math.isfinite(standard_score(h))))
    if not shown:
        return None
    x, y, value, words, rows = [], [], [], [], []
    origins: list[RowOrigin] = []
    for line, engine in enumerate(shown):
        for health in engine.health:
            score = standard_score(health)
            if not math.isfinite(score):
                continue
            x.append(names.index(health.words))
            y.append(line)
            value.append(score)
            words.append(f"{score:.0f}".replace("-", "−") if abs(score) >= 2 else "")
            c, factor = health.change, health.scale
            cells = (factor * c.value, factor * c.low, factor * c.high, health.shown_unit)
            rows.append((engine.serial, health.words, score, *cells, health.probability))
            origins.append(health.origin)
    columns = chart_columns(
        "engine",
        "parameter",
        SCORES,
        "change",
        "95 % from",
        "to",
        "unit",
        "probability that it changed",
    )
    left = len(engines) - len(shown)
    return Chart(
        key,
        "Engines × parameters",
        Axis("", categories=names),
        Axis("", categories=[e.serial for e in shown]),
        [
            HeatCells(
                "change in standard errors",
                x,
                y,
                value,
                FLEET_DARKEST,
                words,
                signed=True,
                rooted=True,
                origins=origins,
            )
        ],
        ChartTable(columns, rows, origins),
        "Change of each parameter in its standard errors; orange above, blue below the engine's baseline. A column of "
        "one colour is what most engines have in common: physics that the model lacks, or the recorder."
        + (f" {left} engines are not drawn." if left else ""),
    )


def standard_score(health: ParameterHealth) -> float:
    """Its change in standard errors; NaN where it is not known."""
    half = (health.change.high - health.change.low) / 2
    return health.change.value * NORMAL_95 / half if half > 0 else math.nan


MOST_CURVES = 5
"""Parameters in one chart: the eye does not separate more."""
APART = 0.06
"""Share of the distance of two flights by which series are moved apart, so that intervals do not cover each other."""
MOST_FLIGHTS = 60
"""Columns of a heat map that still have a width."""

Known = Mapping[str, Parameter]


def group_by_parameter(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of `trend --what flights` by parameter, in order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.text("parameter"), []).append(row)
    return found


def flight_order(rows: Sequence[Row]) -> Order:
    """The flights of one engine, from the rows of any one parameter of it."""
    return order_windows(next(iter(group_by_parameter(rows).values()), []))


def health_trend(
    key: str,
    rows: Sequence[Row],
    names: Sequence[str],
    known: Known,
    marks: Sequence[EventMark] = (),
    *,
    caption: str = "",
    levels: Sequence[Row] = (),
) -> Chart:
    """Changes of `names`, all shown in one unit, over the flights of one engine, with 95 % intervals; levels: rows of
    `trend --what flights`, whose level is drawn as a line in its band."""
    series, smooth = group_by_parameter(rows), group_by_parameter(levels)
    order = flight_order(rows)
    _, unit = display_scale(known[names[0]])
    layers: list[Layer] = []
    cells, origins = [], []
    names = names[:MOST_CURVES]
    apart = 0.0 if len(order.x) < 2 else APART * min(b - a for a, b in pairwise(order.x))
    for colour, name in enumerate(names):
        factor, _ = display_scale(known[name])
        mine = series[name]
        change, low, high = ([factor * row.number(c) for row in mine] for c in ("change", "low", "high"))
        places = [row.origin for row in mine]
        level = _level(smooth.get(name, ()), factor, colour)
        layers += level
        x = [x + apart * (colour - (len(names) - 1) / 2) for x in order.x]
        layers.append(Intervals(known[name].words, x, change, low, high, colour, origins=places))
        together = {r.text("flight") or r.count("number"): factor * r.number("level") for r in smooth.get(name, ())}
        for row, c, a, b in zip(mine, change, low, high, strict=True):
            flight = row.text("flight") or row.count("number")
            cells.append((flight, known[name].words, c, a, b, together.get(flight, NAN)))
        origins += places
    columns = chart_columns(
        "flight",
        "parameter",
        ("change from nominal, by this flight alone", unit),
        ("95 % from", unit),
        ("to", unit),
        ("by all flights together", unit),
    )
    return Chart(
        key,
        "Health over flights",
        order.axis,
        Axis("change from nominal", unit),
        layers,
        ChartTable(columns, cells, origins),
        caption or "Change from the nominal engine, flight by flight, with 95 % intervals, all other parameters free.",
        marks,
    )


def _level(rows: Sequence[Row], factor: float, colour: int) -> list[Layer]:
    """What all flights together say, where the rows have it and it is not nothing throughout."""
    if not any(row.number("level") for row in rows if row.text("level")):
        return []
    x = order_windows(rows).x
    line, low, high = ([factor * row.number(c) for row in rows] for c in ("level", "level_low", "level_high"))
    return [Band("", x, low, high, colour), Line("", x, line, colour)]


def health_map(key: str, rows: Sequence[Row], known: Known) -> Chart | None:
    """Parameters in per cent × flights by all flights together; None where none of them has changed."""
    series = {
        name: mine
        for name, mine in group_by_parameter(rows).items()
        if display_scale(known[name])[1] == "%" and (not known[name].belongs_to_instrument or _has_level(mine))
    }
    if not any(map(_has_level, series.values())):
        return None
    order = flight_order(rows)
    step = every(len(order.x), MOST_FLIGHTS)
    shown = list(range(0, len(order.x), step))
    labels = [order.label(k) for k in shown]
    x, y, value, cells = [], [], [], []
    origins: list[RowOrigin] = []
    for line, (name, mine) in enumerate(series.items()):
        factor, _ = display_scale(known[name])
        for column, row in enumerate(mine[k] for k in shown):
            level, low, high = (factor * row.number(c) for c in ("level", "level_low", "level_high"))
            x.append(column)
            y.append(line)
            value.append(level)
            cells.append((labels[column], known[name].words, level, low, high))
            origins.append(row.origin)
    largest = max(map(abs, value))
    words = [rounded(v, digits=2).replace("-", "−") if abs(v) >= largest / STEPS else "" for v in value]
    thinned = f"One flight in {step} is drawn, of {len(order.x)}." if step > 1 else ""
    columns = chart_columns("flight", "parameter", ("change", "%"), ("95 % from", "%"), ("to", "%"))
    return Chart(
        key,
        "All components, flight by flight",
        Axis("date" if order.axis.dates else order.axis.label, categories=labels),
        Axis("", categories=[known[name].words for name in series]),
        [HeatCells("change from nominal (%)", x, y, value, largest, words, signed=True, origins=origins)],
        ChartTable(columns, cells, origins),
        "Change of each component as all flights together have it: the lines of the chart above, and what is at "
        "nominal beside them. Grey is no change.",
        thinned=thinned,
    )


def _has_level(rows: Sequence[Row]) -> bool:
    return any(row.text("level") and row.number("level") != 0.0 for row in rows)


AHEAD = 2.0
"""A forecast is drawn up to so many times the flights that are there, or to its limit if that comes first."""


class MarginSource(Protocol):
    """An engine whose margin can be drawn."""

    @property
    def margin(self) -> MarginRecord: ...
    @property
    def by_flight(self) -> Sequence[FlightEvidence]: ...
    @property
    def events(self) -> Sequence[MaintenanceRecord]: ...


def margin_forecast(key: str, engine: MarginSource, marks: Sequence[EventMark] = ()) -> Chart | None:
    """None where no flight shows the margin."""
    told = [f for f in engine.by_flight if math.isfinite(f.consumed_K)]
    if not told:
        return None
    m = engine.margin
    whole = m.now_K.value + m.consumed_K.value  # at the baseline
    of_limit = math.isfinite(whole)
    x = [float(f.number) for f in told]
    sign, start = (-1.0, whole) if of_limit else (1.0, 0.0)
    y = [start + sign * f.consumed_K for f in told]
    half = [NORMAL_95 * f.consumed_error_K for f in told]
    low, high = ([v + s * h for v, h in zip(y, half, strict=True)] for s in (-1.0, 1.0))
    origins = [f.origin for f in told]
    layers: list[Layer] = [Intervals("at each flight, by all flights together", x, y, low, high, 0, origins=origins)]
    followed = of_limit and m.now_K.value > 0 and math.isfinite(m.remaining_flights.low)
    if followed:
        layers += _forecast(x[-1], m.now_K.value, m.remaining_flights, len(x))
    passed = "The limit is passed. " if of_limit and m.now_K.value <= 0 else ""
    quantity = split_column(m.column)[0] or "temperature"
    words = f"{quantity} margin" if of_limit else f"{quantity} margin used"
    columns = chart_columns("flight", (words, "K"), ("95 % from", "K"), ("to", "K"))
    names = [f.flight or str(f.number) for f in told]
    return Chart(
        key,
        f"{words} and its forecast" if followed else words,
        Axis("flight, counted"),
        Axis(words, "K"),
        layers,
        ChartTable(columns, list(zip(names, y, low, high, strict=True)), origins),
        f"{passed}{f'At {m.condition}' if m.condition else capital(words)}, with 95 % intervals.",
        marks,
        [ReferenceLine(0.0, f"limit {m.limit_K:g} K" if math.isfinite(m.limit_K) else "limit")] if of_limit else [],
    )


def maintenance_marks(engine: MarginSource) -> list[EventMark]:
    """Maintenance at the first flight after it, by its count."""
    return [EventMark(float(x.number), x.words) for x in engine.events if x.number]


def _forecast(now: float, left_K: float, left: IntervalEstimate, flights: int) -> list[Layer]:
    """Straight from the present margin to zero after so many flights, where it is reached; of each end of the interval
    as well."""
    reached = math.isfinite(left.high)
    last = max(1.0, min(left.value if reached else left.low, AHEAD * flights))
    steps = [last * k / 20 for k in range(21)]

    def after(flights_left: float) -> list[float]:
        if not math.isfinite(flights_left):
            return [left_K for _ in steps]
        return [left_K * (1.0 - s / max(flights_left, 1.0)) for s in steps]

    x = [now + s for s in steps]
    band = Band("90 % of the forecast" if reached else "no sooner (95 %)", x, after(left.low), after(left.high), 1)
    return [band, *([Line("forecast", x, after(left.value), 1, dashed=True)] if reached else [])]


@dataclass(frozen=True)
class MaintenanceGain:
    """One event of maintenance, and what it brought: `gains` in words, and how much temperature and fuel fell."""

    event: MaintenanceRecord
    flight: str
    gains: Sequence[str]
    temperature_K: IntervalEstimate
    fuel_percent: IntervalEstimate
    at_equal: str


@dataclass(frozen=True)
class OwnMargin:
    """An engine's margin, flight by flight and as a whole, with its maintenance; available: power or thrust at the
    limit, in words."""

    margin: MarginRecord
    by_flight: Sequence[FlightEvidence]
    events: Sequence[MaintenanceRecord]
    available: str = ""

    @property
    def words(self) -> str:
        """How far the turbine temperature is from its limit, and what the engine delivers there."""
        sentences = filter(None, (margin_words(self.margin), self.available))
        return " ".join(f"{capital(words)}." for words in sentences)

    @property
    def next_step(self) -> str:
        """What is to be done where the limit is reached; "" where it is not."""
        if not self.margin.now_K.value <= 0.0:
            return ""
        quantity = split_column(self.margin.column)[0]
        return (
            f"{quantity} reaches its limit: make sure that the limit is that of this condition, then derate the engine "
            "or remove it from wing."
        )


def read_margin(rows: Sequence[Row]) -> OwnMargin | None:
    """The margin of the engine of these rows; None where none of them holds the margin as a whole."""
    whole = next((row for row in rows if row.text("row") == WHOLE), None)
    if whole is None:
        return None
    m = MarginRecord(
        whole.text("column"),
        whole.text("condition"),
        whole.number("limit_K"),
        estimate(whole, "used_K"),
        estimate(whole, "margin_K"),
        estimate(whole, "remaining_flights"),
        whole.text("reason"),
    )
    flights = [_flight(row) for row in rows if row.text("row") == FLIGHT]
    return OwnMargin(m, flights, [found.event for found in read_maintenance(rows)], _available(whole))


def _available(whole: Row) -> str:
    """Power or thrust at the limit that binds, in words; "" where it is not known."""
    for shaft, column in ((True, "power_available_kW"), (False, "thrust_available_N")):
        size = estimate(whole, column)
        if math.isfinite(size.value):
            return available_words(shaft, size, estimate(whole, "available_change_percent"), whole.text("limited_by"))
    return ""


def read_maintenance(rows: Sequence[Row]) -> list[MaintenanceGain]:
    """The events of maintenance, in the order of their flights."""
    found = [_maintenance_effect(row) for row in rows if row.text("row") == MAINTENANCE]
    return sorted(found, key=lambda x: x.event.number or math.inf)


def estimate(row: Row, name: str) -> IntervalEstimate:
    """A value with the cells of its interval."""
    value, low, high = map(row.number, interval_columns(name))
    return IntervalEstimate(value, low, high)


def _flight(row: Row) -> FlightEvidence:
    used = estimate(row, "used_K")
    error = (used.high - used.low) / 2 / NORMAL_95
    return FlightEvidence(row.count("number"), row.text("flight"), "", used.value, error, row.origin)


def _maintenance_effect(row: Row) -> MaintenanceGain:
    kind, component = row.text("event"), row.text("component")
    recovered, reason = estimate(row, "recovered_K"), row.text("reason")
    event = MaintenanceRecord(kind, component, row.count("number"), recovered, reason, row.origin)
    gains, fuel = row.list("brought"), estimate(row, "fuel_gain_percent")
    return MaintenanceGain(
        event, row.text("flight"), gains, estimate(row, "temperature_gain_K"), fuel, row.text("held")
    )


GAINS = chart_columns(
    "maintenance", "before flight", "what changed, 95 %", "turbine temperature", "fuel flow", "margin recovered", "note"
)


def maintenance_table(events: Sequence[MaintenanceGain]) -> tuple[str, ChartTable]:
    """Title and table of what maintenance brought."""
    rows: list[tuple[Value, ...]] = []
    for x in events:
        e = x.event
        rows.append(
            (
                e.words,
                x.flight or e.number or "none recorded",
                listed(list(x.gains)),
                _fall_words(x.temperature_K, "K"),
                _fall_words(x.fuel_percent, "%"),
                _size(e.recovered_K, "K"),
                e.reason,
            )
        )
    held = next((x.at_equal for x in events if x.at_equal), "")
    title = "What maintenance brought" + (f" ({held})" if held else "")
    return title, ChartTable(GAINS, rows, [x.event.origin for x in events])


def _fall_words(gain: IntervalEstimate, unit: str) -> str:
    """A gain is a fall of temperature or fuel."""
    if not math.isfinite(gain.value):
        return ""
    size = format_quantity(abs(gain.value), unit, (gain.high - gain.low) / 2)
    return f"{'fell' if gain.value >= 0 else 'rose'} by {size}"


def _size(x: IntervalEstimate, unit: str) -> str:
    if not math.isfinite(x.value):
        return ""
    return format_quantity(x.value, unit, (x.high - x.low) / 2).replace("-", "−")
