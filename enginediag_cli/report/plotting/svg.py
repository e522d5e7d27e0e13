"""Drawings as SVG text, or as PNG for what takes no SVG; and any chart as a drawing of its own.

A `Drawing` has rectangles, lines, dots and words at coordinates in pixels, y downwards; a `Panel` of it has two axes
with round ticks and the scale from data to pixels. `picture` draws a `Chart`. The same numbers give the same bytes.
PNG is made by resvg (extra `enginediag[report]`).
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from enginediag_cli.errors import DataError
from enginediag_cli.report.plotting import (
    FAINT,
    INK,
    PAPER,
    QUIET,
    Band,
    Bars,
    Chart,
    HeatCells,
    Intervals,
    Layer,
    Line,
    Points,
    colour,
    date_ticks,
    date_words,
    format_value,
    shade_scale,
    x_range,
    y_range,
)
from enginediag_cli.report.plotting import shade as model_shade

FONT = "Helvetica, Arial, sans-serif"


DASHES = {"stroke-dasharray": "5 4"}


@dataclass(frozen=True)
class Edge:
    """The line around a shape; its width in pixels."""

    stroke: str
    width: float = 1.0


@dataclass(frozen=True)
class Letters:
    """How words are drawn; the size in pixels."""

    size: float = 12.0
    bold: bool = False
    fill: str = INK


PLAIN = Letters()
TITLE, HEADING, LABEL, SMALL = Letters(17.0, bold=True), Letters(13.0, bold=True), Letters(13.0), Letters(11.0)
"""Sizes that are distinct and legible beside text of 12 pixels."""


class Drawing:
    """Elements are drawn in the order in which they are added; `title` is what a screen reader says."""

    def __init__(self, width: float, height: float, title: str):
        self.width, self.height, self.title = width, height, title
        self._elements: list[str] = []

    def rectangle(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        fill: str,
        *,
        edge: Edge | None = None,
        hint: str = "",
    ) -> None:
        attributes: dict[str, object] = {"x": x, "y": y, "width": width, "height": height, "fill": fill}
        if edge:
            attributes["stroke"] = edge.stroke
            if edge.width != 1.0:  # what SVG assumes
                attributes["stroke-width"] = edge.width
        self._add("rect", attributes, hint)

    def line(
        self, x1: float, y1: float, x2: float, y2: float, stroke: str = INK, *, width: float = 1.0, dashed: bool = False
    ) -> None:
        attributes = {"x1": x1, "y1": y1, "x2": x2, "y2": y2, "stroke": stroke, "stroke-width": width}
        self._add("line", {**attributes, **(DASHES if dashed else {})})

    def path(
        self, points: Iterable[tuple[float, float]], stroke: str, *, width: float = 2.0, dashed: bool = False
    ) -> None:
        """A line through points."""
        attributes = {"points": _listed(points), "fill": "none", "stroke": stroke, "stroke-width": width}
        self._add("polyline", {**attributes, **(DASHES if dashed else {})})

    def area(self, points: Iterable[tuple[float, float]], fill: str, *, opacity: float = 0.2) -> None:
        """What a line through points encloses."""
        self._add("polygon", {"points": _listed(points), "fill": fill, "fill-opacity": opacity})

    def specks(self, points: Iterable[tuple[float, float]], colour: str, *, size: float = 3.0) -> None:
        """Very many dots as one element."""
        text = "".join(f"M{_number(x)} {_number(y)}h0" for x, y in points)
        attributes = {"d": text, "stroke": colour, "stroke-width": size, "stroke-linecap": "round"}
        self._add("path", {**attributes, "stroke-opacity": 0.55})

    def dots(
        self, points: Iterable[tuple[float, float]], fill: str, *, radius: float = 2.0, opacity: float = 1.0
    ) -> None:
        self._elements.append(f'<g fill="{fill}" fill-opacity="{_number(opacity)}">')
        for x, y in points:
            self._add("circle", {"cx": x, "cy": y, "r": radius})
        self._elements.append("</g>")

    def words(
        self,
        x: float,
        y: float,
        text: str,
        *,
        letters: Letters = PLAIN,
        anchor: str = "start",
        turned: float = 0.0,
    ) -> None:
        """Text whose base line starts ("start"), is centred ("middle") or ends ("end") at a point, turned clockwise by
        degrees."""
        attributes: dict[str, object] = {"x": x, "y": y, "font-size": letters.size}
        if anchor != "start":
            attributes["text-anchor"] = anchor
        if letters.fill != INK:  # the colour of the whole drawing
            attributes["fill"] = letters.fill
        if letters.bold:
            attributes["font-weight"] = "bold"
        if turned:
            attributes["transform"] = f"rotate({_number(turned)} {_number(x)} {_number(y)})"
        self._elements.append(f"<text{_attributes(attributes)}>{escape(text)}</text>")

    def add_drawing(self, other: Drawing, y: float) -> None:
        """Another drawing as a part of this one, below its first y pixels."""
        self._elements += [f'<g transform="translate(0 {_number(y)})">', *other._elements, "</g>"]

    def text(self) -> str:
        """The file."""
        w, h = _number(self.width), _number(self.height)
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{w}" height="{h}" viewBox="0 0 {w} {h}" '
            f'font-family="{FONT}" fill="{INK}" role="img">'
        )
        paper = f'<rect width="{w}" height="{h}" fill="{PAPER}"/>'
        return "\n".join([head, f"<title>{escape(self.title)}</title>", paper, *self._elements, "</svg>", ""])

    def _add(self, name: str, attributes: dict[str, object], hint: str = "") -> None:
        inside = f"><title>{escape(hint)}</title></{name}>" if hint else "/>"
        self._elements.append(f"<{name}{_attributes(attributes)}{inside}")


def shade(share: float, low: Sequence[int] = (247, 251, 255), high: Sequence[int] = (8, 48, 107)) -> str:
    """Colour between two, 0 to 1."""
    s = min(1.0, max(0.0, share))
    return "#" + "".join(f"{round(a + s * (b - a)):02x}" for a, b in zip(low, high, strict=True))


def _listed(points: Iterable[tuple[float, float]]) -> str:
    return " ".join(f"{_number(x)},{_number(y)}" for x, y in points)


def _attributes(values: dict[str, object]) -> str:
    return "".join(
        f" {name}={quoteattr(_number(v) if isinstance(v, float | int) else str(v))}" for name, v in values.items()
    )


def _number(value: float) -> str:
    """Two decimals at most, one from 10 on: a picture has no more, and files stay small."""
    text = f"{float(value):.{1 if abs(value) >= 10 else 2}f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


@dataclass(frozen=True)
class Panel:
    """A rectangle of a drawing (pixels) that stands for ranges of x and y (data)."""

    left: float
    top: float
    width: float
    height: float
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    dates: bool = False

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        """Pixels of a point of the data; what lies outside is put on the edge."""
        u = (min(max(x, self.x_range[0]), self.x_range[1]) - self.x_range[0]) / _span(self.x_range)
        v = (min(max(y, self.y_range[0]), self.y_range[1]) - self.y_range[0]) / _span(self.y_range)
        return self.left + u * self.width, self.top + (1.0 - v) * self.height

    def draw(self, on: Drawing, x_label: str, y_label: str) -> None:
        """Frame, grid, ticks and names of the axes."""
        bottom = self.top + self.height
        for x in date_ticks(*self.x_range) if self.dates else ticks(*self.x_range):
            u, _ = self.to_pixels(x, self.y_range[0])
            on.line(u, self.top, u, bottom, FAINT)
            on.words(u, bottom + 17, date_words(x) if self.dates else _signed(x), anchor="middle")
        for y in ticks(*self.y_range):
            _, v = self.to_pixels(self.x_range[0], y)
            on.line(self.left, v, self.left + self.width, v, INK if y == 0 else FAINT)
            on.words(self.left - 6, v + 4, _signed(y), anchor="end")
        on.rectangle(self.left, self.top, self.width, self.height, "none", edge=Edge(INK))
        on.words(self.left + self.width / 2, bottom + 38, x_label, letters=LABEL, anchor="middle")
        on.words(self.left - 48, self.top + self.height / 2, y_label, letters=LABEL, anchor="middle", turned=-90.0)


def ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Round numbers within a range, about as many as wanted."""
    if not (math.isfinite(low) and math.isfinite(high)) or high <= low:
        return []
    raw = (high - low) / wanted
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= raw)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [round(k * step, 12) for k in range(first, last + 1)]


def _signed(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _span(limits: tuple[float, float]) -> float:
    return (limits[1] - limits[0]) or 1.0


ZOOM = 2.0
"""Pixels of a PNG per pixel of the drawing: sharp on paper and on dense screens."""
FAMILIES = ("Helvetica", "Arial", "DejaVu Sans", "Liberation Sans", "Noto Sans")
"""Fonts of which a machine usually has one."""
PROBE = '<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9">{}</svg>'
"""A drawing that is empty unless its letter has a font."""


def png_library(path: str) -> Any:
    """The package that turns SVG into PNG. Raises DataError, about this file, without it."""
    try:
        import resvg_py
    except ImportError:
        raise DataError(
            f"{path}: PNG needs the package resvg-py: pip install 'enginediag[report]'; or name a .svg"
        ) from None
    return resvg_py


def png(drawing: str, path: str) -> bytes:
    """A drawing as PNG. Raises DataError, about this file, without the package or any font."""
    draw = png_library(path).svg_to_bytes
    blank = draw(svg_string=PROBE.format(""))
    letter = PROBE.format('<text y="9" font-family="sans-serif">M</text>')
    for family in FAMILIES:
        if draw(svg_string=letter, sans_serif_family=family) != blank:
            return bytes(draw(svg_string=drawing, zoom=ZOOM, sans_serif_family=family))
    raise DataError(f"{path}: no font for a PNG ({', '.join(FAMILIES)}): install one, or name a .svg")


def write_drawing(drawing: str, path: str) -> None:
    """Write the text of an SVG drawing, as PNG for a path that ends in .png; "-" is standard output. Raises DataError
    without what PNG needs, OSError."""
    from enginediag_cli.progress import wipe
    from enginediag_cli.recordings.write import open_binary_output
    from enginediag_cli.report.output import table_suffix

    data = png(drawing, path) if table_suffix(path) == ".png" else drawing.encode()
    with open_binary_output(path) as stream:
        wipe()
        stream.write(data)


WIDTH, MARGIN, LEFT, HEIGHT = 720.0, 14.0, 74.0, 250.0
"""Pixels of the whole, around it, of the y axis with its numbers, and of the panel: two fit on a page."""
LETTER, LINE, ROW, CELL = 6.7, 17.0, 21.0, 20.0
"""Pixels of a letter, generously, of a line of words, of a row of a lying chart, of a row of a heat map."""
MOST_LABEL, FEW_COLUMNS = 38, 26
"""Letters of a row's name; columns whose names stand side by side, turned, below a heat map."""
FOOT = 46.0
"""Pixels of numbers and label of the x axis."""


class _RowPanel(Panel):
    """A panel whose rows are counted from the top."""

    def to_pixels(self, x: float, y: float) -> tuple[float, float]:
        return super().to_pixels(x, self.y_range[0] + self.y_range[1] - y)


def picture(chart: Chart, *, titled: bool = True) -> Drawing:
    """The drawing; `titled`: with title and caption, which a page says itself."""
    head = _head(chart) if titled else []
    legend = [layer for layer in chart.layers if layer.name and not isinstance(layer, HeatCells)]
    rows = _legend_rows(legend)
    top = MARGIN + (26 if titled else 0) + LINE * len(head) + 18 * len(rows) + (16 if chart.marks else 6)
    left = _left_margin(chart)
    height = _height(chart)
    turned = _label_height(chart)
    heat = next((layer for layer in chart.layers if isinstance(layer, HeatCells)), None)
    foot = (turned or FOOT) + 6
    below = BAR if heat else 0.0
    on = Drawing(WIDTH, top + height + foot + below, f"{chart.title}. {chart.caption}".strip())
    y = MARGIN
    if titled:
        on.words(MARGIN, y + 14, chart.title, letters=TITLE)
        y += 26
        for number, line in enumerate(head):
            on.words(MARGIN, y + 12 + LINE * number, line)
        y += LINE * len(head)
    for number, row in enumerate(rows):
        _legend(on, row, y + 12 + 18 * number)
    kind = _RowPanel if chart.lying else Panel
    panel = kind(left, top, WIDTH - left - MARGIN, height, x_range(chart), y_range(chart), chart.x.dates)
    _frame(on, chart, panel, turned)
    for layer in chart.layers:
        _draw(on, layer, panel)
    _marks(on, chart, panel)
    if heat is not None:
        _colour_bar(on, heat, panel, top + height + foot)
    return on


BAR, SHADE_WIDTH, SHADE_HEIGHT = 56.0, 40.0, 12.0
"""Pixels of a colour bar with its numbers, and of one shade of it."""


def _colour_bar(on: Drawing, layer: HeatCells, panel: Panel, top: float) -> None:
    """The shades with the values between which they are, and what they are values of."""
    scale = shade_scale(layer)
    left = panel.left
    on.words(left, top + 10, layer.name, letters=SMALL)
    for k, (low, _, fill) in enumerate(scale):
        on.rectangle(left + k * SHADE_WIDTH, top + 16, SHADE_WIDTH, SHADE_HEIGHT, fill)
        on.words(left + k * SHADE_WIDTH, top + 43, format_value(low, 2), letters=SMALL, anchor="middle")
    on.words(left + len(scale) * SHADE_WIDTH, top + 43, format_value(scale[-1][1], 2), letters=SMALL, anchor="middle")


def _head(chart: Chart) -> list[str]:
    return textwrap.wrap(chart.caption, int((WIDTH - 2 * MARGIN) / LETTER))


def _left_margin(chart: Chart) -> float:
    if not chart.lying:
        return LEFT
    longest = max((len(name) for name in chart.y.categories), default=0)
    return min(longest, MOST_LABEL) * LETTER + 2 * MARGIN


def _height(chart: Chart) -> float:
    if not chart.lying:
        return HEIGHT
    heat = any(isinstance(layer, HeatCells) for layer in chart.layers)
    return max(len(chart.y.categories), 2) * (CELL if heat else ROW) + (0 if heat else 6)


def _label_height(chart: Chart) -> float:
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
        _, v = panel.to_pixels(panel.x_range[0], number)
        words = textwrap.shorten(name, MOST_LABEL, placeholder=" …")
        on.words(panel.left - 8, v + 4, words, anchor="end")
    if chart.x.categories:
        for number, name in enumerate(chart.x.categories):
            u, _ = panel.to_pixels(number, panel.y_range[0])
            words = textwrap.shorten(name, MOST_LABEL, placeholder=" …")
            on.words(u + 4, bottom + 14, words, letters=SMALL, anchor="end", turned=-45.0)
    else:
        for x in ticks(*panel.x_range):
            u, _ = panel.to_pixels(x, panel.y_range[0])
            on.line(u, panel.top, u, bottom, INK if x == 0 else FAINT)
            on.words(u, bottom + 17, f"{x:g}".replace("-", "−"), anchor="middle")
    if not chart.lying:
        for y in ticks(*panel.y_range):
            _, v = panel.to_pixels(panel.x_range[0], y)
            on.line(panel.left, v, panel.left + panel.width, v, INK if y == 0 else FAINT)
            on.words(panel.left - 6, v + 4, f"{y:g}".replace("-", "−"), anchor="end")
        _y_label(on, chart, panel)
    on.rectangle(panel.left, panel.top, panel.width, panel.height, "none", edge=Edge(INK))
    on.words(panel.left + panel.width / 2, bottom + (turned or FOOT) - 6, chart.x.words, letters=LABEL, anchor="middle")


def _y_label(on: Drawing, chart: Chart, panel: Panel) -> None:
    on.words(MARGIN + 6, panel.top + panel.height / 2, chart.y.words, letters=LABEL, anchor="middle", turned=-90.0)


def _draw(on: Drawing, layer: Layer, panel: Panel) -> None:
    ink = colour(getattr(layer, "colour", 0))
    if isinstance(layer, HeatCells):
        _cells(on, layer, panel)
    elif isinstance(layer, Band):
        upper = [panel.to_pixels(x, y) for x, y in zip(layer.x, layer.high, strict=True) if math.isfinite(y)]
        lower = [panel.to_pixels(x, y) for x, y in zip(layer.x, layer.low, strict=True) if math.isfinite(y)]
        on.area([*upper, *reversed(lower)], ink)
    elif isinstance(layer, Bars):
        for y, x in zip(layer.y, layer.x, strict=True):
            if math.isfinite(x):
                (u, v), (zero, _) = panel.to_pixels(x, y + layer.shift), panel.to_pixels(0.0, y)
                thick = layer.thick * ROW
                on.rectangle(min(u, zero), v - thick / 2, max(abs(u - zero), 1.0), thick, ink)
    elif isinstance(layer, Line):
        for run in _runs(layer):
            stroke, width = (QUIET, 1.0) if layer.quiet else (ink, 2.0)
            on.path([panel.to_pixels(x, y) for x, y in run], stroke, width=width, dashed=layer.dashed)
    elif isinstance(layer, Intervals):
        _intervals(on, layer, panel, ink)
    else:
        points = [panel.to_pixels(x, y) for x, y in _finite(layer)]
        if layer.small:
            on.specks(points, ink)
        else:
            on.dots(points, ink, radius=3.5)


def _intervals(on: Drawing, layer: Intervals, panel: Panel, ink: str) -> None:
    for x, y, low, high in zip(layer.x, layer.y, layer.low, layer.high, strict=True):
        if not (math.isfinite(x) and math.isfinite(y)):
            continue
        if math.isfinite(low) and math.isfinite(high):
            one = panel.to_pixels(low, y) if layer.lying else panel.to_pixels(x, low)
            other = panel.to_pixels(high, y) if layer.lying else panel.to_pixels(x, high)
            on.line(*one, *other, ink, width=1.6)
    on.dots([panel.to_pixels(x, y) for x, y in _finite(layer)], ink, radius=3.5)


def _cells(on: Drawing, layer: HeatCells, panel: Panel) -> None:
    width = panel.width / (panel.x_range[1] - panel.x_range[0])
    words = layer.words or [""] * len(layer.x)
    for x, y, value, text in zip(layer.x, layer.y, layer.value, words, strict=True):
        u, v = panel.to_pixels(x, y)
        if not math.isfinite(value):
            continue
        fill, ink = model_shade(value, layer.largest, layer.rooted)
        on.rectangle(u - width / 2 + 1, v - CELL / 2 + 1, width - 2, CELL - 2, fill)
        if text and len(text) * 6.0 < width:
            on.words(u, v + 4, text, letters=Letters(SMALL.size, fill=ink), anchor="middle")


def _marks(on: Drawing, chart: Chart, panel: Panel) -> None:
    right = panel.left + panel.width
    for level in chart.levels:
        _, v = panel.to_pixels(panel.x_range[0], level.y)
        on.line(panel.left, v, right, v, QUIET, width=1.4, dashed=True)
        on.words(right - 4, v - 4, level.words, letters=Letters(SMALL.size, fill=QUIET), anchor="end")
    taken = -math.inf
    for mark in sorted(chart.marks, key=lambda m: m.x):
        u, _ = panel.to_pixels(mark.x, panel.y_range[0])
        if mark.end is not None and mark.end > mark.x:
            end, _ = panel.to_pixels(mark.end, panel.y_range[0])
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
