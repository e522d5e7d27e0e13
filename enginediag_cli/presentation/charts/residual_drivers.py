"""Residuals over what they may depend on: a fault stays where it is, missing physics bends with its driver."""

from __future__ import annotations

import numpy as np

from enginediag_cli.presentation.charts.model import Axis, Chart, Column, Intervals, Layer, Table
from enginediag_cli.presentation.charts.records import Records
from enginediag_cli.presentation.charts.residual_course import SENSORS
from enginediag_cli.units import split_column

BINS, FEWEST = 10, 5
"""Groups of records along a driver, equally many in each; and records of one that still has a middle half."""
VARIES = 1e-9
"""Relative range below which a driver stands still."""
APART = 0.12
"""Share of the distance of two groups by which series are moved apart."""


def residual_drivers(key: str, records: Records, which: str) -> list[Chart]:
    """One chart for each input that varies; which: the records that these are, in words."""
    return [
        _chart(f"{key}-{number}", records, driver, which)
        for number, driver in enumerate(d for d, values in records.inputs.items() if _varies(values))
    ]


def _varies(values: np.ndarray) -> bool:
    known = values[np.isfinite(values)]
    return known.size > BINS * FEWEST and float(np.ptp(known)) > VARIES * (1.0 + float(np.abs(known).max()))


def _chart(key: str, records: Records, driver: str, which: str) -> Chart:
    quantity, unit = split_column(driver)
    values = records.inputs[driver]
    edges = np.unique(np.nanquantile(values, np.linspace(0.0, 1.0, BINS + 1)))
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    apart = APART * float(np.median(np.diff(edges)))
    layers: list[Layer] = []
    cells = []
    for colour, name in enumerate(records.farthest(SENSORS)):
        words, _ = split_column(name)
        x, y, low, high = [], [], [], []
        for number in range(len(edges) - 1):
            mine = (place == number) & np.isfinite(values) & np.isfinite(records.sigmas[name])
            if mine.sum() < FEWEST:
                continue
            quarter, median, three = np.quantile(records.sigmas[name][mine], [0.25, 0.5, 0.75]).tolist()
            middle = float(np.median(values[mine]))
            x.append(middle + apart * (colour - 1))
            y.append(median)
            low.append(quarter)
            high.append(three)
            cells.append((words, middle, int(mine.sum()), median, quarter, three))
        layers.append(Intervals(words, x, y, low, high, colour))
    columns = (
        Column("reading"),
        Column(f"{quantity}, middle", unit),
        Column("records"),
        Column("median"),
        Column("a quarter lies below"),
        Column("a quarter lies above"),
    )
    return Chart(
        key,
        f"Residuals over {quantity.replace('_', ' ')}",
        Axis(quantity, unit),
        Axis("residual, standard deviations"),
        layers,
        Table(columns, cells),
        f"Medians of equally many records each; the bars hold the middle half. Counted is every record {which}.",
    )
