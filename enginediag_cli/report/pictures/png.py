"""A drawing of this program as PNG, for what takes no SVG: slides, mail, old reports.

By Pillow, which comes with the extra `enginediag[report]`. Only the elements that `Drawing` writes are known. Letters
are those of the first font of `FONTS` that the machine has, else Pillow's own, in which letters that it lacks are
spelled.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any
from xml.etree import ElementTree

from enginediag_cli.errors import DataError

SCALE, FINER = 2.0, 2
"""Pixels of the file for one of the drawing, for dense screens; and finer still before edges are smoothed."""
FONTS = ("DejaVuSans.ttf", "LiberationSans-Regular.ttf", "Arial.ttf")
SPELLED = {"χ²": "chi2", "−": "-", "–": "-", "·": ".", "…": "...", "→": "->", "×": "x", "σ": "sigma", "²": "2"}
"""What Pillow's own font has no letters for."""
EDGE = 8.0
"""Pixels of the drawing that a line keeps from its right edge: letters differ in width, and one too long is smaller."""
BOLDER = 0.6
"""Width of the outline that makes letters bold, in pixels of the drawing."""


def check_pillow(path: str) -> None:
    """Raises DataError, about this file, where there is no Pillow."""
    try:
        import PIL  # noqa: F401
    except ImportError:
        raise DataError(f"{path}: PNG needs Pillow: pip install 'enginediag[report]'; or name a .svg") from None


def png(svg: str, path: str) -> bytes:
    """The file's bytes, from the text of a `Drawing`. path: for the message. Raises DataError without Pillow."""
    check_pillow(path)
    from PIL import Image, ImageDraw

    root = ElementTree.fromstring(svg)
    scale = SCALE * FINER
    size = (round(float(root.get("width", "1")) * scale), round(float(root.get("height", "1")) * scale))
    image = Image.new("RGB", size, "#ffffff")
    painter = _Painter(image, ImageDraw.Draw(image, "RGBA"), scale)
    painter.elements(root, {"fill": root.get("fill", "#000000")})
    small = image.resize((size[0] // FINER, size[1] // FINER), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    small.save(out, "PNG", optimize=True)
    return out.getvalue()


class _Painter:
    def __init__(self, image: Any, on: Any, scale: float):
        self.image, self.on, self.scale = image, on, scale
        self._fonts: dict[float, Any] = {}
        self._own = False

    def elements(self, parent: ElementTree.Element, inherited: Mapping[str, str]) -> None:
        for element in parent:
            values = {**inherited, **element.attrib}
            name = element.tag.rpartition("}")[2]
            if name == "g":
                self.elements(element, values)
            elif draw := getattr(self, f"_{name}", None):
                draw(values, element.text or "")

    def _rect(self, v: Mapping[str, str], text: str) -> None:
        x, y = self._n(v, "x"), self._n(v, "y")
        box = (x, y, x + self._n(v, "width"), y + self._n(v, "height"))
        if v.get("fill") != "none":
            self.on.rectangle(box, fill=_colour(v, "fill"))
        if "stroke" in v:
            self.on.rectangle(box, outline=v["stroke"], width=self._width(v))

    def _line(self, v: Mapping[str, str], text: str) -> None:
        ends = [(self._n(v, "x1"), self._n(v, "y1")), (self._n(v, "x2"), self._n(v, "y2"))]
        self._stroke(ends, v)

    def _polyline(self, v: Mapping[str, str], text: str) -> None:
        self._stroke(self._points(v), v)

    def _polygon(self, v: Mapping[str, str], text: str) -> None:
        points = self._points(v)
        if len(points) > 2:
            self.on.polygon(points, fill=_colour(v, "fill"))

    def _circle(self, v: Mapping[str, str], text: str) -> None:
        x, y, r = self._n(v, "cx"), self._n(v, "cy"), self._n(v, "r")
        self.on.ellipse((x - r, y - r, x + r, y + r), fill=_colour(v, "fill"))

    def _path(self, v: Mapping[str, str], text: str) -> None:
        """Dots alone: "M10 20h0M…"."""
        r = self._n(v, "stroke-width") / 2
        for part in v.get("d", "").split("M")[1:]:
            x, y = (float(word) * self.scale for word in part.removesuffix("h0").split())
            self.on.ellipse((x - r, y - r, x + r, y + r), fill=_colour(v, "stroke"))

    def _text(self, v: Mapping[str, str], text: str) -> None:
        size = float(v.get("font-size", "12"))
        font = self._font(size)
        told = _spelled(text) if self._own else text
        room = self.image.width - EDGE * self.scale - self._n(v, "x")
        if v.get("text-anchor", "start") == "start" and "transform" not in v and font.getlength(told) > room > 0:
            font = self._font(size * room / font.getlength(told))
        anchor = {"start": "ls", "middle": "ms", "end": "rs"}[v.get("text-anchor", "start")]
        bold = round(BOLDER * self.scale / 2) if v.get("font-weight") == "bold" else 0
        x, y, ink = self._n(v, "x"), self._n(v, "y"), v.get("fill", "#000000")
        if "transform" not in v:
            self.on.text((x, y), told, fill=ink, font=font, anchor=anchor, stroke_width=bold, stroke_fill=ink)
            return
        from PIL import Image, ImageDraw

        degrees = float(v["transform"].removeprefix("rotate(").split()[0])
        half = math.ceil(font.getlength(told)) + round(20 * self.scale)
        layer = Image.new("L", (2 * half, 2 * half), 0)
        ImageDraw.Draw(layer).text((half, half), told, fill=255, font=font, anchor=anchor)
        turned = layer.rotate(-degrees, resample=Image.Resampling.BICUBIC)
        self.image.paste(Image.new("RGB", turned.size, ink), (round(x) - half, round(y) - half), turned)

    def _stroke(self, points: list[tuple[float, float]], v: Mapping[str, str]) -> None:
        dashes = [float(d) * self.scale for d in v.get("stroke-dasharray", "").split()]
        width, ink = self._width(v), v.get("stroke", "#000000")
        if not dashes:
            self.on.line(points, fill=ink, width=width, joint="curve")
            return
        for a, b in pairwise(points):
            length = math.dist(a, b)
            for k in range(math.ceil(length / sum(dashes))):
                begin, end = k * sum(dashes), min(k * sum(dashes) + dashes[0], length)
                ends = [tuple(p + (q - p) * s / length for p, q in zip(a, b, strict=True)) for s in (begin, end)]
                self.on.line(ends, fill=ink, width=width)

    def _font(self, size: float) -> Any:
        if size not in self._fonts:
            self._fonts[size] = self._found(round(size * self.scale))
        return self._fonts[size]

    def _found(self, size: int) -> Any:
        from PIL import ImageFont

        for name in FONTS:
            try:
                return ImageFont.truetype(name, size)
            except OSError:
                continue
        self._own = True
        return ImageFont.load_default(size)

    def _points(self, v: Mapping[str, str]) -> list[tuple[float, float]]:
        pairs = (pair.split(",") for pair in v.get("points", "").split())
        return [(float(x) * self.scale, float(y) * self.scale) for x, y in pairs]

    def _n(self, v: Mapping[str, str], name: str) -> float:
        return float(v.get(name, "0")) * self.scale

    def _width(self, v: Mapping[str, str]) -> int:
        return max(1, round(float(v.get("stroke-width", "1")) * self.scale))


def _colour(v: Mapping[str, str], what: str) -> tuple[int, int, int, int]:
    text = v.get(what, "#000000").removeprefix("#")
    red, green, blue = (int(text[k : k + 2], 16) for k in (0, 2, 4))
    return red, green, blue, round(255 * float(v.get(f"{what}-opacity", "1")))


def _spelled(text: str) -> str:
    for letter, words in SPELLED.items():
        text = text.replace(letter, words)
    return text
