"""Charts: what a chart is, whoever draws it: axes with units, layers of data, marks, and the table of all it shows.

Nothing here knows of pixels, SVG or a library. Places along an axis with `categories` are 0, 1, 2 …, from the left or
from the top. `svg` draws a chart as SVG, `interactive` as a plot that moves; a new chart is one function of a topic.

Colours are distinct to the colour-blind, on white and on black: light ones are those of P. Tol's "bright" scheme
(SRON/EPS/TN/09-002, 2021), darkened to a contrast of 3 to 1 at least; a page in the dark shows `DARK[k]` where a
picture says `LIGHT[k]`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from typing import TypeAlias

from enginediag_cli.report.sentences import rounded
from enginediag_cli.units import DAY_S

INK, FAINT, PAPER = "#1f2933", "#d5dbe1", "#ffffff"
BLUE, ORANGE = "#2166ac", "#d95f02"

Value: TypeAlias = str | float | int | None
"""A cell of a table: words, a number, or nothing."""

DIGITS = 4
"""Significant digits of a number in a table where nothing says how sure it is."""


@dataclass(frozen=True)
class RowOrigin:
    """Where a row comes from: a file as the report calls it, and its line (a number) or place ("engines[3]")."""

    file: str
    row: str


NOWHERE = RowOrigin("", "")


@dataclass(frozen=True)
class ChartColumn:
    """A column of a table, and the unit of its numbers."""

    name: str
    unit: str = ""

    @property
    def words(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


def chart_columns(*names: str | tuple[str, str]) -> tuple[ChartColumn, ...]:
    """Columns by their names, or by (name, unit)."""
    return tuple(ChartColumn(name) if isinstance(name, str) else ChartColumn(*name) for name in names)


@dataclass(frozen=True)
class ChartTable:
    """Rows below columns; `origins`: one for each row, or none at all where rows come from no file."""

    columns: Sequence[ChartColumn]
    rows: Sequence[Sequence[Value]]
    origins: Sequence[RowOrigin] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError("a row of the table has not as many cells as there are columns")
        if self.origins and len(self.origins) != len(self.rows):
            raise ValueError("the table has not as many origins as rows")


def format_value(value: Value, digits: int = DIGITS) -> str:
    """A cell as it is read: numbers rounded, a true minus, nothing for what is not known."""
    if value is None or (isinstance(value, float) and value != value):
        return ""
    if isinstance(value, bool) or isinstance(value, str):
        return str(value)
    if isinstance(value, int):
        return f"{value}".replace("-", "−")
    return rounded(value, digits=digits).replace("-", "−")


@dataclass(frozen=True)
class Axis:
    """`label` with its `unit`; `categories`: names instead of numbers; `limits`: where data alone should not decide;
    `dates`: numbers are seconds since 1970, UTC."""

    label: str
    unit: str = ""
    categories: Sequence[str] = ()
    limits: tuple[float, float] | None = None
    dates: bool = False

    @property
    def words(self) -> str:
        return f"{self.label} ({self.unit})" if self.unit else self.label


DAYS, MONTHS = (1, 2, 7, 14), (1, 2, 3, 6, 12, 24, 60, 120)
"""Steps of an axis of dates, in days and in months: weeks and parts of a year."""


def date_words(time_s: float) -> str:
    """A date, "2026-03-14"."""
    return f"{datetime.fromtimestamp(time_s, timezone.utc):%Y-%m-%d}"


def date_ticks(low: float, high: float, wanted: int = 6) -> list[float]:
    """Midnights, or first days of months, within a range of seconds since 1970, about as many as wanted."""
    least = (high - low) / wanted
    days = next((d for d in DAYS if d * DAY_S >= least), 0)
    if days:
        first, step = math.ceil(low / (days * DAY_S)), days * DAY_S
        return [k * step for k in range(first, math.floor(high / step) + 1)]
    months = next((m for m in MONTHS if m * 30 * DAY_S >= least), MONTHS[-1])
    begin, end = (datetime.fromtimestamp(t, timezone.utc) for t in (low, high))
    counted = range(-(-(12 * begin.year + begin.month - 1) // months) * months, 12 * end.year + end.month, months)
    found = [datetime(m // 12, m % 12 + 1, 1, tzinfo=timezone.utc).timestamp() for m in counted]
    return [t for t in found if low <= t <= high]


@dataclass(frozen=True)
class Points:
    """Dots; `colour` counts through the palette, series of one colour belong together; `small`: many of them."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: int = 0
    small: bool = False
    origins: Sequence[RowOrigin] = ()


@dataclass(frozen=True)
class Line:
    """A line through points; a NaN interrupts it. `quiet`: in the colour of lesser words."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: int = 0
    dashed: bool = False
    quiet: bool = False


@dataclass(frozen=True)
class Intervals:
    """Dots with the interval from `low` to `high`, along y, or along x where `lying`."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    colour: int = 0
    lying: bool = False
    origins: Sequence[RowOrigin] = ()


@dataclass(frozen=True)
class Band:
    """What lies between two lines."""

    name: str
    x: Sequence[float]
    low: Sequence[float]
    high: Sequence[float]
    colour: int = 0


@dataclass(frozen=True)
class Bars:
    """Bars from zero along x, one in each place `y`; `shift` in places moves those of several series apart."""

    name: str
    y: Sequence[float]
    x: Sequence[float]
    colour: int = 0
    shift: float = 0.0
    thick: float = 0.6
    origins: Sequence[RowOrigin] = ()


@dataclass(frozen=True)
class HeatCells:
    """A heat map: `value[k]` at column `x[k]` and row `y[k]`, NaN where there is none; 0 is grey, `largest` darkest.
    `words`: text of the cell; `both`: values have a sign that matters; `rooted`: shaded by the root of
    the share, where the largest is far above what matters."""

    name: str
    x: Sequence[int]
    y: Sequence[int]
    value: Sequence[float]
    largest: float
    words: Sequence[str] = ()
    signed: bool = False
    rooted: bool = False
    origins: Sequence[RowOrigin] = ()


Layer: TypeAlias = Points | Line | Intervals | Band | Bars | HeatCells


@dataclass(frozen=True)
class EventMark:
    """Something that happened at `x`: maintenance, an onset; `until`: the end of the stretch it may lie in."""

    x: float
    words: str
    end: float | None = None


@dataclass(frozen=True)
class ReferenceLine:
    """A value of y that means something: a threshold, a limit, nominal."""

    y: float
    words: str


@dataclass(frozen=True)
class Chart:
    """`key` names it within a page; `caption` says in a sentence or two what is seen, also to who cannot see it."""

    key: str
    title: str
    x: Axis
    y: Axis
    layers: Sequence[Layer]
    table: ChartTable
    caption: str = ""
    marks: Sequence[EventMark] = ()
    levels: Sequence[ReferenceLine] = ()
    thinned: str = field(default="")

    @property
    def lying(self) -> bool:
        """Whether rows stand below each other, one for each category of y."""
        return bool(self.y.categories)


def every(count: int, most: int) -> int:
    """The step by which so many are thinned to at most `most`."""
    return max(1, -(-count // most))


LIGHT = (BLUE, ORANGE, "#117733", "#aa3377", "#8a7a00", "#00808f", "#6a51a3", "#8c564b")
DARK = ("#7db4ee", "#f5a35c", "#5cc27f", "#e58bc0", "#d9c94a", "#5cc9d6", "#b6a2e8", "#cfa397")

SURFACES_LIGHT = (INK, FAINT, PAPER, "#eeeeee", "#52606d", "#f5f7fa")
SURFACES_DARK = ("#e4e7eb", "#3e4c59", "#1b222b", "#2b3540", "#a6b1bd", "#232c37")
"""Ink, grid, paper, what is empty, lesser words, and the ground of a card."""

EMPTY, QUIET, SURFACE = SURFACES_LIGHT[3:]

SHADES_UP = ("#fff3e8", "#fdd9bb", "#fdae6b", "#e6731c", "#8f3a00")
SHADES_DOWN = ("#eef5fc", "#cfe1f2", "#94c0e2", "#3d85c6", "#08407d")
"""Steps of a heat map, from faint to full, above zero and below: after ColorBrewer's oranges and blues."""

STEPS = len(SHADES_UP)

ON_LIGHT, ON_DARK = "#000000", "#fefefe"
"""Ink on the shades, which are the same in the dark: of these two one has a contrast of 4.5 at least on any colour."""


def colour(number: int) -> str:
    """A colour of the palette, round and round."""
    return LIGHT[number % len(LIGHT)]


def contrast(one: str, other: str) -> float:
    """Contrast of two colours "#rrggbb", from 1 to 21: W3C, Web Content Accessibility Guidelines 2.1, 2018."""
    dark, light = sorted((_luminance(one), _luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def _luminance(text: str) -> float:
    shares = [int(text[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def ink_on(fill: str) -> str:
    """The ink that is read best on a colour."""
    return max((ON_LIGHT, ON_DARK), key=lambda ink: contrast(fill, ink))


def shade(value: float, largest: float, rooted: bool = False) -> tuple[str, str]:
    """The fill of a cell and the ink on it; 0 is grey. Five steps: the eye does not separate more."""
    if value == 0.0:
        return EMPTY, INK
    share = min(abs(value) / largest, 1.0) if largest > 0 else 0.0
    share = share**0.5 if rooted else share
    step = min(int(share * STEPS), STEPS - 1)
    fill = (SHADES_UP if value >= 0 else SHADES_DOWN)[step]
    return fill, ink_on(fill)


def shade_scale(layer: HeatCells) -> list[tuple[float, float, str]]:
    """(from, to, fill) of each shade that a heat map may show, from below to above."""
    ends = [(k / STEPS) ** (2 if layer.rooted else 1) * layer.largest for k in range(STEPS + 1)]
    up = [(a, b, fill) for a, b, fill in zip(ends, ends[1:], SHADES_UP, strict=False)]
    down = [(-b, -a, fill) for a, b, fill in zip(ends, ends[1:], SHADES_DOWN, strict=False)]
    return [*reversed(down), *up] if layer.signed else up


def pairs() -> list[tuple[str, str]]:
    """(light, dark) of every colour that changes in the dark; shades of heat maps stay, and so does ink on them."""
    return [*zip(LIGHT, DARK, strict=True), *zip(SURFACES_LIGHT, SURFACES_DARK, strict=True)]


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
        if not isinstance(layer, Band | HeatCells):
            yield from layer.y
    for level in chart.levels:
        yield level.y


def padded(values: Sequence[float], share: float = 0.05) -> tuple[float, float]:
    """Range of values with a margin on both sides; never empty."""
    low, high = min(values), max(values)
    margin = share * (high - low) or max(abs(high), 1.0) * share
    return low - margin, high + margin
