"""Residuals over time: those of the readings that are farthest off."""

from __future__ import annotations

import numpy as np

from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Layer, Level, Points, Table, every
from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.units import split_column

MOST_POINTS, SENSORS = 5000, 3
"""Points of a chart: more only make it slow; and readings, of which more cover each other."""
HOUR = 3600.0
"""Seconds."""


def residual_course(key: str, records: Records) -> Chart:
    """Every record, or every so manieth where there are too many."""
    names = records.farthest(SENSORS)
    step = every(len(records) * len(names), MOST_POINTS)
    kept = list(range(0, len(records), step))
    timed = bool(len(records)) and bool(np.all(np.isfinite(records.time_s)) and np.all(np.diff(records.time_s) >= 0))
    x = records.time_s / HOUR if timed else np.arange(1.0, len(records) + 1)
    layers: list[Layer] = []
    columns = [Column("time", "h") if timed else Column("record")]
    for colour, name in enumerate(names):
        quantity, unit = split_column(name)
        values = records.sigmas[name]
        shown = [k for k in kept if np.isfinite(values[k])]
        places = [records.origin(k) for k in shown]
        layers.append(
            Points(quantity, [float(x[k]) for k in shown], [float(values[k]) for k in shown], colour, True, places)
        )
        columns += [Column(f"{quantity}, standard deviations"), Column(quantity, unit)]
    cells = [
        [float(x[k]), *(float(v[name][k]) for name in names for v in (records.sigmas, records.residual))] for k in kept
    ]
    origins = [records.origin(k) for k in kept]
    axis = Axis("time", "h") if timed else Axis("record, counted")
    return Chart(
        key,
        "Residuals over time",
        axis,
        Axis("measured − nominal, standard deviations"),
        layers,
        Table(columns, cells, origins),
        f"Measured minus nominal, of the {len(names)} readings that are farthest off at the end.",
        levels=[Level(2.0, ""), Level(-2.0, "")],
        thinned=f"One record in {step} is drawn, of {len(records):,}." if step > 1 else "",
    )
