"""The ranges that a chart's axes need, for both renderers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

from enginediag_cli.presentation.charts.model import Axis, Band, Bars, Cells, Chart, Intervals
from enginediag_cli.presentation.pictures.axes import padded


def x_range(chart: Chart) -> tuple[float, float]:
    """From the leftmost to the rightmost thing drawn, with a margin."""
    return _range(chart.x, _xs(chart))


def y_range(chart: Chart) -> tuple[float, float]:
    """As `x_range`; of a lying chart, from the top to the bottom of its rows."""
    return _range(chart.y, _ys(chart))


def _range(axis: Axis, values: Iterable[float]) -> tuple[float, float]:
    if axis.categories:
        return -0.5, len(axis.categories) - 0.5
    if axis.limits is not None:
        return axis.limits
    known = [float(v) for v in values if v is not None and math.isfinite(v)]
    return padded(known) if known else (0.0, 1.0)


def _xs(chart: Chart) -> Iterator[float]:
    for layer in chart.layers:
        yield from layer.x
        if isinstance(layer, Intervals) and layer.lying:
            yield from (*layer.low, *layer.high)
        if isinstance(layer, Bars):
            yield 0.0
    for mark in chart.marks:
        yield mark.x


def _ys(chart: Chart) -> Iterator[float]:
    for layer in chart.layers:
        if isinstance(layer, Band) or (isinstance(layer, Intervals) and not layer.lying):
            yield from (*layer.low, *layer.high)
        if not isinstance(layer, Band | Cells):
            yield from layer.y
    for level in chart.levels:
        yield level.y
