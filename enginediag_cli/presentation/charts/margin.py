"""The margin of the hottest temperature over flights, and its forecast to the limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.presentation.charts.fleet_found import EventFound, FlightFound, MarginFound
from enginediag_cli.presentation.charts.model import (
    Axis,
    Band,
    Chart,
    Column,
    Intervals,
    Layer,
    Level,
    Line,
    Mark,
    Table,
)
from enginediag_cli.units import split_column

AHEAD = 2.0
"""A forecast is drawn up to so many times the flights that are there, or to its limit if that comes first."""


class WithMargin(Protocol):
    """An engine whose margin can be drawn."""

    @property
    def margin(self) -> MarginFound: ...
    @property
    def by_flight(self) -> Sequence[FlightFound]: ...
    @property
    def events(self) -> Sequence[EventFound]: ...


def margin(key: str, engine: WithMargin, marks: Sequence[Mark] = ()) -> Chart | None:
    """None where no flight tells of the margin."""
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
    layers: list[Layer] = [Intervals("each flight by itself", x, y, low, high, 0, origins=origins)]
    caption = m.reason and f"No forecast: {m.reason}."
    left = m.remaining_flights
    if of_limit and m.now_K.value <= 0:
        caption = "The limit is passed."
    elif of_limit and math.isfinite(left.value):
        layers += _forecast(x[-1], m.now_K.value, left.value, (left.low, left.high), len(x))
        caption = (
            f"Flights until the limit: {_told(left.value)}, 90 % interval {_told(left.low)} to {_told(left.high)}."
        )
    quantity = split_column(m.column)[0] or "temperature"
    words = f"{quantity} margin" if of_limit else f"{quantity} margin used"
    columns = (Column("flight"), Column(words, "K"), Column("95 % from", "K"), Column("to", "K"))
    names = [f.flight or str(f.number) for f in told]
    return Chart(
        key,
        f"{words} and its forecast" if of_limit else words,
        Axis("flight, counted"),
        Axis(words, "K"),
        layers,
        Table(columns, list(zip(names, y, low, high, strict=True)), origins),
        caption + (f" At {m.condition}." if m.condition else ""),
        marks,
        [Level(0.0, f"limit {m.limit_K:g} K" if math.isfinite(m.limit_K) else "limit")] if of_limit else [],
    )


def maintenance_marks(engine: WithMargin) -> list[Mark]:
    """Maintenance at the first flight after it, by its count."""
    return [Mark(float(x.number), x.words) for x in engine.events if x.number]


def _forecast(now: float, left_K: float, median: float, ends: tuple[float, float], flights: int) -> list[Layer]:
    """Straight from what is left now to nothing after so many flights; of each end of the interval as well."""
    last = max(1.0, min(median, AHEAD * flights))
    steps = [last * k / 20 for k in range(21)]

    def after(flights_left: float) -> list[float]:
        if not math.isfinite(flights_left):
            return [left_K for _ in steps]
        return [left_K * (1.0 - s / max(flights_left, 1.0)) for s in steps]

    x = [now + s for s in steps]
    return [
        Band("90 % of the forecast", x, after(ends[0]), after(ends[1]), 1),
        Line("forecast", x, after(median), 1, dashed=True),
    ]


def _told(flights: float) -> str:
    return f"{flights:,.0f}" if math.isfinite(flights) else "no end in sight"
