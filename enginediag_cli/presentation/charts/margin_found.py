"""Rows of `trend --what margin` as an engine whose margin is drawn, and its maintenance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.fleet_found import NAN, EngineFound, EventFound, FlightFound, MarginFound
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.margin_rows import FLIGHT, MAINTENANCE, WHOLE


@dataclass(frozen=True)
class Brought:
    """One event of maintenance, and what it brought: `gains` in words, and how much temperature and fuel fell."""

    event: EventFound
    flight: str
    gains: Sequence[str]
    temperature_K: Estimate
    fuel_percent: Estimate
    held: str


def margin_found(rows: Sequence[Row]) -> EngineFound | None:
    """The engine of these rows; None where none of them tells of its margin as a whole."""
    whole = next((row for row in rows if row.text("row") == WHOLE), None)
    if whole is None:
        return None
    m = MarginFound(
        whole.text("column"),
        whole.text("condition"),
        whole.number("limit_K"),
        estimate(whole, "used_K"),
        estimate(whole, "margin_K"),
        estimate(whole, "remaining_flights"),
        whole.text("reason"),
    )
    flights = [_flight(row) for row in rows if row.text("row") == FLIGHT]
    events = [found.event for found in maintenance_found(rows)]
    nothing = Estimate()
    number = whole.count("number")
    return EngineFound(
        whole.text("engine"), "", number, 0, "", "", NAN, False, (0, 0, 0), "", nothing, "", (), flights, events, m,
        whole.origin,
    )  # fmt: skip


def maintenance_found(rows: Sequence[Row]) -> list[Brought]:
    """The events of maintenance, in the order of their flights."""
    found = [_brought(row) for row in rows if row.text("row") == MAINTENANCE]
    return sorted(found, key=lambda x: x.event.number or math.inf)


def estimate(row: Row, name: str) -> Estimate:
    """A value with the cells of its interval."""
    stem = name.removesuffix("_K")
    return Estimate(row.number(name), row.number(f"{stem}_low"), row.number(f"{stem}_high"))


def _flight(row: Row) -> FlightFound:
    used = estimate(row, "used_K")
    error = (used.high - used.low) / 2 / NORMAL_95
    return FlightFound(row.count("number"), row.text("flight"), NAN, NAN, "", used.value, error, row.origin)


def _brought(row: Row) -> Brought:
    kind, component = row.text("event"), row.text("component")
    recovered, reason = estimate(row, "recovered_K"), row.text("reason")
    event = EventFound(kind, component, row.count("number"), recovered, reason, row.origin)
    gains, fuel = row.list("brought"), estimate(row, "fuel_gain_percent")
    return Brought(event, row.text("flight"), gains, estimate(row, "temperature_gain_K"), fuel, row.text("held"))
