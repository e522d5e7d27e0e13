"""Where model and recordings differ: location × driver, by how surprising a correction there is."""

from __future__ import annotations

import math
from collections.abc import Sequence

from enginediag_cli.presentation.charts.model import Axis, Cells, Chart, Column, Table
from enginediag_cli.presentation.charts.rows import Row

MOST_ROWS, MOST_COLUMNS = 24, 12
"""Places and drivers of a map that can be read."""
SMALLEST = 1e-300
"""A p-value that a float no longer tells from nothing."""


def mismatch_places(key: str, rows: Sequence[Row], gate: float = math.nan) -> Chart:
    """Rows of `locate`, or `places` of `explain`; gate: what chance alone reaches, NaN where not known."""
    surprise = [_surprise(row) for row in rows]
    order = sorted(range(len(rows)), key=lambda k: -surprise[k])
    locations = list(dict.fromkeys(rows[k].text("location") for k in order))[:MOST_ROWS]
    drivers = list(dict.fromkeys(rows[k].text("driver") for k in order))[:MOST_COLUMNS]
    kept = [k for k in order if rows[k].text("location") in locations and rows[k].text("driver") in drivers]
    values = [surprise[k] for k in kept]
    cells = Cells(
        "−ln p",
        [drivers.index(rows[k].text("driver")) for k in kept],
        [locations.index(rows[k].text("location")) for k in kept],
        values,
        max(values, default=1.0),
        [f"{v:.0f}" if v >= 10 else f"{v:.1f}" for v in values],
        rooted=True,
        origins=[rows[k].origin for k in kept],
    )
    columns = (Column("place"), Column("varies with"), Column("−ln p"), Column("fall of χ²"), Column("stability"))
    chance = f" Chance alone reaches {gate:.1f}." if math.isfinite(gate) else ""
    left = len(rows) - len(kept)
    return Chart(
        key,
        "Where model and recordings differ",
        Axis("varies with", categories=[_short(driver) for driver in drivers]),
        Axis("", categories=locations),
        [cells],
        Table(
            columns,
            [
                (
                    rows[k].text("location"),
                    rows[k].text("driver"),
                    surprise[k],
                    rows[k].number("statistic"),
                    rows[k].number("stability"),
                )
                for k in order
            ],
            [rows[k].origin for k in order],
        ),
        f"−ln p of a correction at a place that varies with a driver: the darker, the less it is chance.{chance} "
        "Empty cells were not written or cannot be seen." + (f" Less surprising, not drawn: {left}." if left else ""),
    )


def _short(driver: str) -> str:
    """Of a group of drivers that the flights cannot tell apart, the first two."""
    parts = driver.split(" = ")
    return driver if len(parts) < 3 else f"{' = '.join(parts[:2])} + {len(parts) - 2}"


def _surprise(row: Row) -> float:
    if "surprise" in row:
        return row.number("surprise")
    p = row.number("p_value")
    return max(0.0, -math.log(max(p, SMALLEST))) if math.isfinite(p) else 0.0
