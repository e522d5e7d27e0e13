"""Health over flights: those parameters that changed with their intervals, and all of them at a glance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.parameters import Parameter
from enginediag_cli.presentation.charts.model import Axis, Cells, Chart, Column, Intervals, Level, Mark, Origin, Table
from enginediag_cli.presentation.charts.order import Order, order_of
from enginediag_cli.presentation.charts.rows import Row
from enginediag_cli.presentation.charts.sizes import scale_of

MOST_CURVES = 5
"""Parameters in one chart: more are not told apart."""
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


def health_trend(
    key: str, rows: Sequence[Row], names: Sequence[str], known: Known, marks: Sequence[Mark] = ()
) -> Chart:
    """Changes of `names`, all shown in one unit, over the flights of one engine, with 95 % intervals."""
    series = of_parameters(rows)
    order = flight_order(rows)
    _, unit = scale_of(known[names[0]])
    layers, cells, origins = [], [], []
    for colour, name in enumerate(names[:MOST_CURVES]):
        factor, _ = scale_of(known[name])
        mine = series[name]
        change, low, high = ([factor * row.number(c) for row in mine] for c in ("change", "low", "high"))
        places = [row.origin for row in mine]
        layers.append(Intervals(known[name].words, order.x, change, low, high, colour, origins=places))
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
        "Change from the nominal engine, flight by flight, with 95 % intervals.",
        marks,
        [Level(0.0, "nominal")],
    )


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
