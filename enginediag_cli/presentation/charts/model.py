"""What a chart is, whoever draws it: axes with units, layers of data, marks, and the table of all it shows.

Nothing here knows of pixels, SVG or a library. Places along an axis with `categories` are 0, 1, 2 …, from the left or
from the top.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

from enginediag_cli.presentation.numbers import rounded

Value: TypeAlias = str | float | int | None
"""A cell of a table: words, a number, or nothing."""

DIGITS = 4
"""Significant digits of a number in a table where nothing says how sure it is."""


@dataclass(frozen=True)
class Origin:
    """Where a row comes from: a file as the report calls it, and its line (a number) or place ("engines[3]")."""

    file: str
    row: str


NOWHERE = Origin("", "")


@dataclass(frozen=True)
class Column:
    """A column of a table, and the unit of its numbers."""

    name: str
    unit: str = ""

    @property
    def words(self) -> str:
        return f"{self.name} ({self.unit})" if self.unit else self.name


@dataclass(frozen=True)
class Table:
    """Rows below columns; `origins`: one for each row, or none at all where rows come from no file."""

    columns: Sequence[Column]
    rows: Sequence[Sequence[Value]]
    origins: Sequence[Origin] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.columns) for row in self.rows):
            raise ValueError("a row of the table has not as many cells as there are columns")
        if self.origins and len(self.origins) != len(self.rows):
            raise ValueError("the table has not as many origins as rows")


def shown(value: Value, digits: int = DIGITS) -> str:
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
    """`label` with its `unit`; `categories`: names instead of numbers; `limits`: where data alone should not decide."""

    label: str
    unit: str = ""
    categories: Sequence[str] = ()
    limits: tuple[float, float] | None = None

    @property
    def words(self) -> str:
        return f"{self.label} ({self.unit})" if self.unit else self.label


@dataclass(frozen=True)
class Points:
    """Dots; `colour` counts through the palette, series of one colour belong together; `small`: many of them."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: int = 0
    small: bool = False
    origins: Sequence[Origin] = ()


@dataclass(frozen=True)
class Line:
    """A line through points; a NaN interrupts it."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    colour: int = 0
    dashed: bool = False


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
    origins: Sequence[Origin] = ()


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
    origins: Sequence[Origin] = ()


@dataclass(frozen=True)
class Cells:
    """A heat map: `value[k]` at column `x[k]` and row `y[k]`, NaN where there is none; 0 is neutral, `largest` darkest.
    `words`: what stands in the cell; `both`: values have a sign that matters; `rooted`: shaded by the root of
    the share, where the largest is far above what matters."""

    name: str
    x: Sequence[int]
    y: Sequence[int]
    value: Sequence[float]
    largest: float
    words: Sequence[str] = ()
    both: bool = False
    rooted: bool = False
    origins: Sequence[Origin] = ()


Layer: TypeAlias = Points | Line | Intervals | Band | Bars | Cells


@dataclass(frozen=True)
class Mark:
    """Something that happened at `x`: maintenance, an onset; `until`: the end of the stretch it may lie in."""

    x: float
    words: str
    until: float | None = None


@dataclass(frozen=True)
class Level:
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
    table: Table
    caption: str = ""
    marks: Sequence[Mark] = ()
    levels: Sequence[Level] = ()
    thinned: str = field(default="")

    @property
    def lying(self) -> bool:
        """Whether rows stand below each other, one for each category of y."""
        return bool(self.y.categories)


def every(count: int, most: int) -> int:
    """The step by which so many are thinned to at most `most`."""
    return max(1, -(-count // most))
