"""The document of `fleet` as objects, each with its place; what is not known is NaN."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from enginediag_cli.errors import DataError
from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.parameters import Parameter, spelled, unspecified
from enginediag_cli.presentation.charts.model import Origin
from enginediag_cli.presentation.charts.sizes import scale_of
from enginediag_cli.presentation.names import maintained

NAN = float("nan")


@dataclass(frozen=True)
class HealthFound:
    """One parameter of an engine."""

    parameter: Parameter
    component: str
    change: Estimate
    kind: str
    probability: float
    onset: int
    onset_flight: str
    origin: Origin

    @property
    def words(self) -> str:
        return self.parameter.words

    @property
    def scale(self) -> float:
        return scale_of(self.parameter)[0]

    @property
    def shown_unit(self) -> str:
        return scale_of(self.parameter)[1]


@dataclass(frozen=True)
class FlightFound:
    number: int
    flight: str
    log10_e: float
    p_value: float
    verdict: str
    consumed_K: float
    consumed_error_K: float
    origin: Origin


@dataclass(frozen=True)
class MarginFound:
    column: str
    condition: str
    limit_K: float
    consumed_K: Estimate
    now_K: Estimate
    remaining_flights: Estimate
    reason: str


@dataclass(frozen=True)
class EventFound:
    """Maintenance; `number`: of the first flight after it, 0 where there is none."""

    kind: str
    component: str
    number: int
    recovered_K: Estimate
    reason: str
    origin: Origin

    @property
    def words(self) -> str:
        return maintained(self.kind, self.component)


@dataclass(frozen=True)
class EngineFound:
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
    severity: Estimate
    severity_unit: str
    health: Sequence[HealthFound]
    by_flight: Sequence[FlightFound]
    events: Sequence[EventFound]
    margin: MarginFound
    origin: Origin
    instruments: Sequence[str] = ()


def engines_of(document: Mapping[str, Any], file: str) -> list[EngineFound]:
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


def _engine(e: Mapping[str, Any], file: str, place: str) -> EngineFound:
    m = e.get("margin") or {}
    return EngineFound(
        str(e["serial"]),
        str(e.get("build") or ""),
        int(e["flights"]),
        int(e.get("records") or 0),
        str(e["verdict"]),
        str(e.get("reason") or ""),
        _number(e.get("log10_e")),
        bool(e.get("discovery")),
        (int(e.get("since") or 0), int(e.get("since_low") or 0), int(e.get("since_high") or 0)),
        str(e.get("since_flight") or ""),
        _estimate(e.get("severity")),
        str(e.get("severity_unit") or ""),
        [_health(h, Origin(file, f"{place}.health[{k}]")) for k, h in enumerate(e.get("health") or ())],
        [_flight(f, Origin(file, f"{place}.by_flight[{k}]")) for k, f in enumerate(e.get("by_flight") or ())],
        [_event(x, Origin(file, f"{place}.events[{k}]")) for k, x in enumerate(e.get("events") or ())],
        MarginFound(
            str(m.get("column") or ""),
            str(m.get("condition") or ""),
            _number(m.get("limit_K")),
            _estimate(m.get("consumed_K")),
            _estimate(m.get("now_K")),
            _estimate(m.get("remaining_flights")),
            str(m.get("reason") or ""),
        ),
        Origin(file, place),
        [str(x["words"]) for x in e.get("instruments") or ()],
    )


def _health(h: Mapping[str, Any], origin: Origin) -> HealthFound:
    from dataclasses import replace

    known = replace(
        unspecified(str(h["parameter"]), str(h.get("unit") or "1")),
        words=str(h.get("words") or h["parameter"]),
        component=str(h.get("component") or h["parameter"]),
        part=spelled(str(h.get("component") or h["parameter"])),
    )
    return HealthFound(
        known,
        str(h.get("component") or ""),
        _estimate(h.get("change")),
        str(h.get("kind") or ""),
        _number(h.get("probability")),
        int(h.get("onset") or 0),
        str(h.get("onset_flight") or ""),
        origin,
    )


def _flight(f: Mapping[str, Any], origin: Origin) -> FlightFound:
    return FlightFound(
        int(f["number"]),
        str(f.get("flight") or ""),
        _number(f.get("log10_e")),
        _number(f.get("p_value")),
        str(f.get("verdict") or ""),
        _number(f.get("consumed_K")),
        _number(f.get("consumed_error_K")),
        origin,
    )


def _event(x: Mapping[str, Any], origin: Origin) -> EventFound:
    event = x.get("event") or {}
    return EventFound(
        str(event.get("kind") or "event"),
        str(event.get("component") or ""),
        int(x.get("number") or 0),
        _estimate(x.get("recovered_K")),
        str(x.get("reason") or ""),
        origin,
    )


def _estimate(value: Any) -> Estimate:
    if not isinstance(value, Mapping):
        return Estimate(_number(value))
    return Estimate(*(_number(value.get(name)) for name in ("value", "low", "high")))


def _number(value: Any) -> float:
    """NaN where there is none; JSON has no infinity either, which then is not known."""
    if value is None:
        return NAN
    number = float(value)
    return number if math.isfinite(number) else NAN
