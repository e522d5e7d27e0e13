"""Rows of `trend --what margin` as an engine whose margin is drawn, and its maintenance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.fleet_judgement.finding import Estimate
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.fleet_found import NAN, EventFound, FlightFound, MarginFound
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.margin_rows import FLIGHT, MAINTENANCE, WHOLE
from enginediag_cli.presentation.outputs.trend import with_ends


@dataclass(frozen=True)
class Brought:
    """One event of maintenance, and what it brought: `gains` in words, and how much temperature and fuel fell."""

    event: EventFound
    flight: str
    gains: Sequence[str]
    temperature_K: Estimate
    fuel_percent: Estimate
    held: str


@dataclass(frozen=True)
class OwnMargin:
    """An engine's margin, flight by flight and as a whole, with its maintenance."""

    margin: MarginFound
    by_flight: Sequence[FlightFound]
    events: Sequence[EventFound]


def margin_found(rows: Sequence[Row]) -> OwnMargin | None:
    """The margin of the engine of these rows; None where none of them tells of its margin as a whole."""
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
    return OwnMargin(m, flights, [found.event for found in maintenance_found(rows)])


def maintenance_found(rows: Sequence[Row]) -> list[Brought]:
    """The events of maintenance, in the order of their flights."""
    found = [_brought(row) for row in rows if row.text("row") == MAINTENANCE]
    return sorted(found, key=lambda x: x.event.number or math.inf)


def estimate(row: Row, name: str) -> Estimate:
    """A value with the cells of its interval."""
    value, low, high = map(row.number, with_ends(name))
    return Estimate(value, low, high)


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
