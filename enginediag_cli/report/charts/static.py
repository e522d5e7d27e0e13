"""A chart as an SVG drawing that stands for itself: in a page without scripts, on paper, in a file of its own."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence

from enginediag_cli.report.charts.model import (
    QUIET,
    Band,
    Bars,
    Cells,
    Chart,
    Intervals,
    Layer,
    Line,
    Points,
    colour,
    shade,
    x_range,
    y_range,
)
from enginediag_cli.report.pictures.svg import (
    FAINT,
    INK,
    LABEL,
    SMALL,
    TITLE,
    Drawing,
    Edge,
    Letters,
    Panel,
    ticks,
)

WIDTH, MARGIN, LEFT, HEIGHT = 720.0, 14.0, 74.0, 250.0
"""Pixels of the whole, around it, of the y axis with its numbers, and of the panel: two fit on a page."""
LETTER, LINE, ROW, CELL = 6.7, 17.0, 21.0, 20.0
"""Pixels of a letter, generously, of a line of words, of a row of a lying chart, of a row of a heat map."""
MOST_LABEL, FEW_COLUMNS = 38, 26
"""Letters of a row's name; columns whose names stand side by side, turned, below a heat map."""
FOOT = 46.0
"""Pixels of numbers and label of the x axis."""


class _Rows(Panel):
    """A panel whose rows are counted from the top."""

    def at(self, x: float, y: float) -> tuple[float, float]:
        return super().at(x, self.y_range[0] + self.y_range[1] - y)


def picture(chart: Chart, *, titled: bool = True) -> Drawing:
    """The drawing; `titled`: with title and caption, which a page says itself."""
    head = _head(chart) if titled else []
    legend = [layer for layer in chart.layers if layer.name and not isinstance(layer, Cells)]
    rows = _legend_rows(legend)
    top = MARGIN + (26 if titled else 0) + LINE * len(head) + 18 * len(rows) + (16 if chart.marks else 6)
    left = _left(chart)
    height = _height(chart)
    turned = _turned(chart)
    on = Drawing(WIDTH, top + height + (turned or FOOT) + 6, f"{chart.title}. {chart.caption}".strip())
    y = MARGIN
    if titled:
        on.words(MARGIN, y + 14, chart.title, letters=TITLE)
        y += 26
        for number, line in enumerate(head):
            on.words(MARGIN, y + 12 + LINE * number, line)
        y += LINE * len(head)
    for number, row in enumerate(rows):
        _legend(on, row, y + 12 + 18 * number)
    kind = _Rows if chart.lying else Panel
    panel = kind(left, top, WIDTH - left - MARGIN, height, x_range(chart), y_range(chart))
    _frame(on, chart, panel, turned)
    for layer in chart.layers:
        _draw(on, layer, panel)
    _marks(on, chart, panel)
    return on


def _head(chart: Chart) -> list[str]:
    return textwrap.wrap(chart.caption, int((WIDTH - 2 * MARGIN) / LETTER))


def _left(chart: Chart) -> float:
    if not chart.lying:
        return LEFT
    longest = max((len(name) for name in chart.y.categories), default=0)
    return min(longest, MOST_LABEL) * LETTER + 2 * MARGIN


def _height(chart: Chart) -> float:
    if not chart.lying:
        return HEIGHT
    heat = any(isinstance(layer, Cells) for layer in chart.layers)
    return max(len(chart.y.categories), 2) * (CELL if heat else ROW) + (0 if heat else 6)


def _turned(chart: Chart) -> float:
    """Pixels of names of columns that stand turned below the panel; 0 where there are none."""
    if not chart.x.categories:
        return 0.0
    longest = max(len(name) for name in chart.x.categories)
    return min(longest, MOST_LABEL) * LETTER * 0.72 + 34.0


def _frame(on: Drawing, chart: Chart, panel: Panel, turned: float) -> None:
    if not chart.lying and not chart.x.categories:
        panel.draw(on, chart.x.words, "")
        _y_label(on, chart, panel)
        return
    bottom = panel.top + panel.height
    for number, name in enumerate(chart.y.categories):
        _, v = panel.at(panel.x_range[0], number)
        words = textwrap.shorten(name, MOST_LABEL, placeholder=" …")
        on.words(panel.left - 8, v + 4, words, anchor="end")
    if chart.x.categories:
        for number, name in enumerate(chart.x.categories):
            u, _ = panel.at(number, panel.y_range[0])
            words = textwrap.shorten(name, MOST_LABEL, placeholder=" …")
            on.words(u + 4, bottom + 14, words, letters=SMALL, anchor="end", turned=-45.0)
    else:
        for x in ticks(*panel.x_range):
            u, _ = panel.at(x, panel.y_range[0])
            on.line(u, panel.top, u, bottom, INK if x == 0 else FAINT)
            on.words(u, bottom + 17, f"{x:g}".replace("-", "−"), anchor="middle")
    if not chart.lying:
        for y in ticks(*panel.y_range):
            _, v = panel.at(panel.x_range[0], y)
            on.line(panel.left, v, panel.left + panel.width, v, INK if y == 0 else FAINT)
            on.words(panel.left - 6, v + 4, f"{y:g}".replace("-", "−"), anchor="end")
        _y_label(on, chart, panel)
    on.rectangle(panel.left, panel.top, panel.width, panel.height, "none", edge=Edge(INK))
    on.words(panel.left + panel.width / 2, bottom + (turned or FOOT) - 6, chart.x.words, letters=LABEL, anchor="middle")


def _y_label(on: Drawing, chart: Chart, panel: Panel) -> None:
    on.words(MARGIN + 6, panel.top + panel.height / 2, chart.y.words, letters=LABEL, anchor="middle", turned=-90.0)


def _draw(on: Drawing, layer: Layer, panel: Panel) -> None:
    ink = colour(getattr(layer, "colour", 0))
    if isinstance(layer, Cells):
        _cells(on, layer, panel)
    elif isinstance(layer, Band):
        upper = [panel.at(x, y) for x, y in zip(layer.x, layer.high, strict=True) if math.isfinite(y)]
        lower = [panel.at(x, y) for x, y in zip(layer.x, layer.low, strict=True) if math.isfinite(y)]
        on.area([*upper, *reversed(lower)], ink)
    elif isinstance(layer, Bars):
        for y, x in zip(layer.y, layer.x, strict=True):
            if math.isfinite(x):
                (u, v), (zero, _) = panel.at(x, y + layer.shift), panel.at(0.0, y)
                thick = layer.thick * ROW
                on.rectangle(min(u, zero), v - thick / 2, max(abs(u - zero), 1.0), thick, ink)
    elif isinstance(layer, Line):
        for run in _runs(layer):
            on.path([panel.at(x, y) for x, y in run], ink, dashed=layer.dashed)
    elif isinstance(layer, Intervals):
        _intervals(on, layer, panel, ink)
    else:
        points = [panel.at(x, y) for x, y in _finite(layer)]
        if layer.small:
            on.specks(points, ink)
        else:
            on.dots(points, ink, radius=3.5)


def _intervals(on: Drawing, layer: Intervals, panel: Panel, ink: str) -> None:
    for x, y, low, high in zip(layer.x, layer.y, layer.low, layer.high, strict=True):
        if not (math.isfinite(x) and math.isfinite(y)):
            continue
        if math.isfinite(low) and math.isfinite(high):
            one = panel.at(low, y) if layer.lying else panel.at(x, low)
            other = panel.at(high, y) if layer.lying else panel.at(x, high)
            on.line(*one, *other, ink, width=1.6)
    on.dots([panel.at(x, y) for x, y in _finite(layer)], ink, radius=3.5)


def _cells(on: Drawing, layer: Cells, panel: Panel) -> None:
    width = panel.width / (panel.x_range[1] - panel.x_range[0])
    words = layer.words or [""] * len(layer.x)
    for x, y, value, text in zip(layer.x, layer.y, layer.value, words, strict=True):
        u, v = panel.at(x, y)
        if not math.isfinite(value):
            on.rectangle(u - width / 2 + 1, v - CELL / 2 + 1, width - 2, CELL - 2, "#eeeeee", hint="not known")
            continue
        fill, ink = shade(value, layer.largest, layer.rooted)
        on.rectangle(u - width / 2 + 1, v - CELL / 2 + 1, width - 2, CELL - 2, fill)
        if text and len(text) * 6.0 < width:
            on.words(u, v + 4, text, letters=Letters(SMALL.size, fill=ink), anchor="middle")


def _marks(on: Drawing, chart: Chart, panel: Panel) -> None:
    right = panel.left + panel.width
    for level in chart.levels:
        _, v = panel.at(panel.x_range[0], level.y)
        on.line(panel.left, v, right, v, QUIET, width=1.4, dashed=True)
        on.words(right - 4, v - 4, level.words, letters=Letters(SMALL.size, fill=QUIET), anchor="end")
    taken = -math.inf
    for mark in sorted(chart.marks, key=lambda m: m.x):
        u, _ = panel.at(mark.x, panel.y_range[0])
        if mark.until is not None and mark.until > mark.x:
            end, _ = panel.at(mark.until, panel.y_range[0])
            corners = ((u, panel.top), (end, panel.top), (end, panel.top + panel.height), (u, panel.top + panel.height))
            on.area(corners, QUIET, opacity=0.15)
        on.line(u, panel.top, u, panel.top + panel.height, QUIET, width=1.4, dashed=True)
        width = len(mark.words) * SMALL.size * 0.55
        if u - 2 > taken:  # else the words would cover those before; the table has them
            end = u + width > right
            on.words(
                u, panel.top - 5, mark.words, letters=Letters(SMALL.size, fill=QUIET), anchor="end" if end else "start"
            )
            taken = u if end else u + width


def _legend_rows(layers: Sequence[Layer]) -> list[list[tuple[float, Layer]]]:
    """Layers in lines that fit, each with where it stands."""
    rows: list[list[tuple[float, Layer]]] = []
    x = WIDTH
    for layer in layers:
        width = 26 + len(layer.name) * LETTER
        if x + width > WIDTH - MARGIN:
            rows.append([])
            x = LEFT
        rows[-1].append((x, layer))
        x += width
    return rows


def _legend(on: Drawing, row: Sequence[tuple[float, Layer]], y: float) -> None:
    for x, layer in row:
        ink = colour(getattr(layer, "colour", 0))
        if isinstance(layer, Band):
            on.area(((x, y - 9), (x + 14, y - 9), (x + 14, y + 1), (x, y + 1)), ink, opacity=0.3)
        elif isinstance(layer, Bars):
            on.rectangle(x, y - 9, 14, 10, ink)
        elif isinstance(layer, Line):
            on.line(x, y - 4, x + 14, y - 4, ink, width=2.0, dashed=layer.dashed)
        else:
            on.dots([(x + 7, y - 4)], ink, radius=3.5)
        on.words(x + 19, y, layer.name)


def _finite(layer: Points | Intervals) -> Iterator[tuple[float, float]]:
    for x, y in zip(layer.x, layer.y, strict=True):
        if math.isfinite(x) and math.isfinite(y):
            yield x, y


def _runs(layer: Line) -> Iterator[list[tuple[float, float]]]:
    """Its points between gaps."""
    run: list[tuple[float, float]] = []
    for x, y in zip(layer.x, layer.y, strict=True):
        if math.isfinite(x) and math.isfinite(y):
            run.append((x, y))
        elif run:
            yield run
            run = []
    if run:
        yield run
