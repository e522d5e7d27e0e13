"""Health over flights: those parameters that changed with their intervals, and all of them at a glance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.parameters import Parameter
from enginediag_cli.presentation.charts.model import (
    Axis,
    Band,
    Cells,
    Chart,
    Column,
    Intervals,
    Layer,
    Line,
    Mark,
    Origin,
    Table,
)
from enginediag_cli.presentation.charts.order import Order, order_of
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.charts.sizes import scale_of

MOST_CURVES = 5
"""Parameters in one chart: more are not told apart."""
APART = 0.06
"""Share of the distance of two flights by which series are moved apart, so that intervals do not cover each other."""
MOST_FLIGHTS = 60
"""Columns of a heat map that still have a width."""
FULL = 6.0
"""Standard errors at which a cell is darkest; beyond, everything is plain."""

Known = Mapping[str, Parameter]


def of_parameters(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Rows of `trend --what flights` by parameter, in order."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.text("parameter"), []).append(row)
    return found


def flight_order(rows: Sequence[Row]) -> Order:
    """The flights of one engine, from the rows of any one parameter of it."""
    return order_of(next(iter(of_parameters(rows).values()), []))


@dataclass(frozen=True)
class Course:
    """What `trend` says of one parameter: from flight `onset`, counted from 1, on; `step` or growing, with the change
    up to the last flight and its 95 % interval."""

    onset: int
    step: bool
    change: float
    low: float
    high: float


def health_trend(
    key: str,
    rows: Sequence[Row],
    names: Sequence[str],
    known: Known,
    marks: Sequence[Mark] = (),
    *,
    caption: str = "",
    courses: Mapping[str, Course] | None = None,
) -> Chart:
    """Changes of `names`, all shown in one unit, over the flights of one engine, with 95 % intervals, and with the
    course that the whole series says."""
    series = of_parameters(rows)
    order = flight_order(rows)
    _, unit = scale_of(known[names[0]])
    layers: list[Layer] = []
    cells, origins = [], []
    names = names[:MOST_CURVES]
    apart = 0.0 if len(order.x) < 2 else APART * min(b - a for a, b in pairwise(order.x))
    for colour, name in enumerate(names):
        factor, _ = scale_of(known[name])
        mine = series[name]
        change, low, high = ([factor * row.number(c) for row in mine] for c in ("change", "low", "high"))
        places = [row.origin for row in mine]
        if courses and name in courses:
            layers += _course(courses[name], order, factor, colour)
        x = [x + apart * (colour - (len(names) - 1) / 2) for x in order.x]
        layers.append(Intervals(known[name].words, x, change, low, high, colour, origins=places))
        rows_of_it = zip(mine, change, low, high, strict=True)
        cells += [(r.text("flight") or r.count("number"), known[name].words, c, a, b) for r, c, a, b in rows_of_it]
        origins += places
    columns = (
        Column("flight"),
        Column("parameter"),
        Column("change from nominal", unit),
        Column("95 % from", unit),
        Column("to", unit),
    )
    return Chart(
        key,
        "Health over flights",
        order.axis,
        Axis("change from nominal", unit),
        layers,
        Table(columns, cells, origins),
        caption or "Change from the nominal engine, flight by flight, with 95 % intervals, all other parameters free.",
        marks,
    )


def _course(course: Course, order: Order, factor: float, colour: int) -> list[Layer]:
    """Zero before the onset; then at once, or evenly up to the last flight, which is what a mean rate means."""
    last = len(order.x)
    share = [0.0 if k < course.onset else 1.0 for k in range(1, last + 1)]
    if not course.step:
        span = max(last - course.onset, 1)
        share = [max(k - course.onset, 0) / span for k in range(1, last + 1)]
    line, low, high = ([factor * s * size for s in share] for size in (course.change, course.low, course.high))
    return [
        Band("", order.x, low, high, colour),
        Line("", order.x, line, colour, dashed=True),
    ]


def health_map(key: str, rows: Sequence[Row], known: Known) -> Chart:
    """All parameters × flights in standard errors of each flight's own estimate."""
    series = of_parameters(rows)
    order = flight_order(rows)
    shown = max(0, len(order.x) - MOST_FLIGHTS)
    labels = [name or f"{x:g}" for name, x in zip(order.names, order.x, strict=True)][shown:]
    x, y, value, cells = [], [], [], []
    origins: list[Origin] = []
    for line, (name, mine) in enumerate(series.items()):
        factor, unit = scale_of(known[name])
        for column, row in enumerate(mine[shown:]):
            half = (row.number("high") - row.number("low")) / 2
            score = row.number("change") * NORMAL_95 / half if half > 0 else math.nan
            x.append(column)
            y.append(line)
            value.append(score)
            cells.append((labels[column], known[name].words, score, factor * row.number("change"), unit))
            origins.append(row.origin)
    words = [f"{v:.0f}".replace("-", "−") if abs(v) >= 2 else "" for v in value]
    columns = (
        Column("flight"),
        Column("parameter"),
        Column("change in standard errors"),
        Column("change"),
        Column("unit"),
    )
    before = f" Of {len(order.x)} flights, the last {len(labels)}." if shown else ""
    return Chart(
        key,
        "All parameters, flight by flight",
        Axis(order.axis.label, categories=labels),
        Axis("", categories=[known[name].words for name in series]),
        [Cells("change", x, y, value, FULL, words, both=True, origins=origins)],
        Table(columns, cells, origins),
        "Change of each parameter in standard errors of that flight taken alone, all others free: below 2 is nothing "
        f"unusual; orange is above nominal, blue below.{before}",
    )
