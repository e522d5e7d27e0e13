"""A panel with two axes, round ticks, and a scale from data to pixels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from enginediag_cli.presentation.pictures.svg import FAINT, INK, LABEL, Drawing, Edge


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
