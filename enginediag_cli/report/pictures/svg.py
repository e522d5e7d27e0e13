"""A drawing as SVG 1.1 text: rectangles, lines, dots and words at coordinates in pixels, y downwards.

A panel with two axes, round ticks, and a scale from data to pixels.

A drawing as a file: SVG, or PNG for a name that says so.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import escape, quoteattr

INK, FAINT, PAPER = "#1f2933", "#d5dbe1", "#ffffff"
BLUE, ORANGE = "#2166ac", "#d95f02"
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
"""Sizes that can be told apart and read beside text of 12 pixels."""


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

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Pixels of a point of the data; what lies outside is put on the edge."""
        u = (min(max(x, self.x_range[0]), self.x_range[1]) - self.x_range[0]) / _span(self.x_range)
        v = (min(max(y, self.y_range[0]), self.y_range[1]) - self.y_range[0]) / _span(self.y_range)
        return self.left + u * self.width, self.top + (1.0 - v) * self.height

    def draw(self, on: Drawing, x_label: str, y_label: str) -> None:
        """Frame, grid, ticks and names of the axes."""
        bottom = self.top + self.height
        for x in ticks(*self.x_range):
            u, _ = self.at(x, self.y_range[0])
            on.line(u, self.top, u, bottom, FAINT)
            on.words(u, bottom + 17, _signed(x), anchor="middle")
        for y in ticks(*self.y_range):
            _, v = self.at(self.x_range[0], y)
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


def padded(values: Sequence[float], share: float = 0.05) -> tuple[float, float]:
    """Range of values with a margin on both sides; never empty."""
    low, high = min(values), max(values)
    margin = share * (high - low) or max(abs(high), 1.0) * share
    return low - margin, high + margin


def _signed(value: float) -> str:
    return f"{value:g}".replace("-", "−")


def _span(limits: tuple[float, float]) -> float:
    return (limits[1] - limits[0]) or 1.0


def write_drawing(drawing: str, path: str) -> None:
    """drawing: the SVG text of it; path: ending in .png for PNG, "-" is standard output. Raises DataError without what
    PNG needs, OSError."""
    from enginediag_cli.progress import wipe
    from enginediag_cli.recordings.write import binary_output, output

    if os.path.splitext(path.lower())[1] == ".png":
        from enginediag_cli.report.pictures.png import png

        data = png(drawing, path)
        with binary_output(path) as raw:
            wipe()
            raw.write(data)
        return
    with output(path) as stream:
        wipe()
        stream.write(drawing)
