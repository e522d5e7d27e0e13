"""The statistic of `detect` window by window, as a multiple of its threshold."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.presentation.charts.model import Chart, Column, Level, Mark, Points, Table
from enginediag_cli.presentation.charts.order import order_of
from enginediag_cli.presentation.charts.rows import Row

COLUMNS = (
    Column("flight"),
    Column("verdict"),
    Column("statistic"),
    Column("threshold"),
    Column("p value"),
    Column("fit"),
    Column("records judged"),
)

SMALLEST = 1e-3
"""Multiple of the threshold at which smaller ones are drawn: far below, nothing is to be told apart."""


def detection_course(key: str, rows: Sequence[Row], marks: Sequence[Mark] = ()) -> Chart:
    """Rows of `detect`, in order."""
    from enginediag_cli.presentation.charts.model import Axis

    order = order_of(rows)
    height = [math.log10(max(r.number("statistic") / r.number("threshold"), SMALLEST)) for r in rows]
    layers = []
    for colour, (word, name) in enumerate((("healthy", "below the threshold"), ("fault", "alarm"))):
        mine = [k for k, row in enumerate(rows) if row.text("verdict") == word]
        if mine:
            layers.append(
                Points(
                    name,
                    [order.x[k] for k in mine],
                    [height[k] for k in mine],
                    colour,
                    origins=[rows[k].origin for k in mine],
                )
            )
    alarms = sum(row.text("verdict") == "fault" for row in rows)
    silent = sum(row.text("verdict") == "no verdict" for row in rows)
    caption = f"{alarms} of {len(rows)} windows depart from nominal." + (
        f" {silent} have no verdict and are not drawn." if silent else ""
    )
    return Chart(
        key,
        "Does it depart from nominal?",
        order.axis,
        Axis("statistic over threshold, powers of ten"),
        layers,
        Table(COLUMNS, [_cells(row) for row in rows], [row.origin for row in rows]),
        caption,
        marks,
        [Level(0.0, "threshold")],
    )


def _cells(row: Row) -> tuple[str | float | int, ...]:
    return (
        row.text("flight") or row.window,
        row.text("verdict") + (f": {row.text('reason')}" if row.text("reason") else ""),
        row.number("statistic"),
        row.number("threshold"),
        row.number("p_value"),
        row.number("fit"),
        row.count("judged"),
    )
