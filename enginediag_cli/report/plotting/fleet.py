"""Charts of a fleet: evidence, map of engines and parameters, ranking.

How evidence against an engine gathers over its life.

The document of `fleet` as objects, each with its place; what is not known is NaN.

Engines by severity, worst first, with intervals.

Heat map engines × parameters: what is one engine's own, and what all have.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeVar

from enginediag_cli.errors import DataError
from enginediag_cli.fleets.findings import IntervalEstimate
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.parameters import Parameter, spelled, unspecified
from enginediag_cli.report.plotting import (
    Axis,
    Chart,
    ChartTable,
    EventMark,
    HeatCells,
    Intervals,
    Layer,
    Line,
    RowOrigin,
    chart_columns,
    display_scale,
)
from enginediag_cli.report.sentences import maintained

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
    """One flight of an engine, as far as its evidence and its margin go."""

    number: int
    flight: str
    log10_e: float
    p_value: float
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
class FleetEngine:
    """What a fleet document says of one engine; `since`: flight of the first change, with its interval."""

    serial: str
    build: str
    flights: int
    records: int
    verdict: str
    reason: str
    log10_e: float
    discovery: bool
    since: tuple[int, int, int]
    since_flight: str
    severity: IntervalEstimate
    severity_unit: str
    health: Sequence[ParameterHealth]
    by_flight: Sequence[FlightEvidence]
    events: Sequence[MaintenanceRecord]
    margin: MarginRecord
    origin: RowOrigin
    instruments: Sequence[str] = ()


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
        origin=RowOrigin(file, place),
        instruments=[str(x["words"]) for x in e.get("instruments") or ()],
    )


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
        part=spelled(component),
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


def evidence_course(key: str, engine: FleetEngine, marks: Sequence[EventMark] = ()) -> Chart | None:
    """None where no flight has evidence."""
    told = [f for f in engine.by_flight if math.isfinite(f.log10_e)]
    if not told:
        return None
    x, y = [float(f.number) for f in told], [f.log10_e for f in told]
    columns = chart_columns("flight", "log10 of evidence", "p value", "verdict")
    rows = [(f.flight or str(f.number), f.log10_e, f.p_value, f.verdict) for f in told]
    return Chart(
        key,
        "Evidence that it has changed",
        Axis("flight, counted"),
        Axis("evidence, powers of ten"),
        [Line("", x, y, 0)],
        ChartTable(columns, rows, [f.origin for f in told]),
        "At 2 the flights so far are a hundred times likelier if something has changed; it may be read at any flight.",
        marks,
    )


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
        "on the fleet's list",
        "log10 of evidence",
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
            e.log10_e,
            e.flights,
        )
        for rank, e in enumerate(engines, start=1)
    ]
    left = len(engines) - len(shown)
    words = "K of margin used" if unit == "K" else "severity, prior standard deviations"
    return Chart(
        key,
        "Engines by severity",
        Axis(words),
        Axis("", categories=[e.serial for e in shown]),
        layers,
        ChartTable(columns, rows, [e.origin for e in engines]),
        "How far each engine has gone towards its limit, with 95 % intervals."
        + (f" {left} more engines, less severe or not judged, are in the table." if left else ""),
    )


FULL = 8.0
"""Standard errors at which a cell is darkest."""


def fleet_map(key: str, engines: Sequence[FleetEngine]) -> Chart | None:
    """Change of each parameter in its standard errors; empty where it is not known, None where no engine tells."""
    shown = [e for e in engines if any(math.isfinite(_score(h)) for h in e.health)][:MOST]
    names = list(dict.fromkeys(h.words for e in shown for h in e.health if math.isfinite(_score(h))))
    if not shown:
        return None
    x, y, value, words, rows = [], [], [], [], []
    origins: list[RowOrigin] = []
    for line, engine in enumerate(shown):
        for health in engine.health:
            score = _score(health)
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
        "change in standard errors",
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
        [HeatCells("change", x, y, value, FULL, words, signed=True, rooted=True, origins=origins)],
        ChartTable(columns, rows, origins),
        "Change of each parameter in its standard errors; orange above, blue below the engine's baseline. A column of "
        "one colour is what most engines have in common: physics that the model lacks, or the recorder."
        + (f" {left} engines are not drawn." if left else ""),
    )


def _score(health: ParameterHealth) -> float:
    half = (health.change.high - health.change.low) / 2
    return health.change.value * NORMAL_95 / half if half > 0 else math.nan
