"""Raw deltas over flights: reading minus what the nominal engine reads at equal power setting.

Drawn from rows of `trend --what deltas`: dots for flights, the smoothed line with its band, alert levels, maintenance.
`alert_words` says which deltas are beyond a level, and which were.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from enginediag_cli.errors import NoVerdictError
from enginediag_cli.report.plotting import (
    Axis,
    Band,
    Chart,
    ChartTable,
    EventMark,
    Intervals,
    Layer,
    Line,
    ReferenceLine,
    RowOrigin,
    chart_columns,
)
from enginediag_cli.report.result_files import Row, order_windows
from enginediag_cli.report.sentences import format_quantity, listed
from enginediag_cli.report.tables.trend import ALERT_LEVELS
from enginediag_cli.units import split_column

SEVERITY = {"": 0, "caution": 1, "warning": 2}
"""Levels in rising order."""


@dataclass(frozen=True)
class DeltaCourse:
    """One delta of one engine, its rows in the order of flights."""

    rows: Sequence[Row]

    @property
    def name(self) -> str:
        return f"Δ{self.rows[0].text('name')}"

    @property
    def unit(self) -> str:
        return self.rows[0].text("unit")

    @property
    def has_levels(self) -> bool:
        """Whether alert levels of it are stated."""
        return any(self.rows[0].text(name) for name in ALERT_LEVELS)

    @property
    def level(self) -> str:
        """Level at the last flight: "", caution or warning."""
        return self.rows[-1].text("level")

    @property
    def size(self) -> str:
        """Smoothed delta at the last flight, for instance "+12 °C ± 2 °C"."""
        last = self.rows[-1]
        half = (last.number("smoothed_high") - last.number("smoothed_low")) / 2
        value = last.number("smoothed")
        return f"{'+' if value > 0 else ''}{format_quantity(value, self.unit, half)}".replace("-", "−")

    def flight_words(self, number: int) -> str:
        """A flight, counted from 1, with its date where there is one."""
        row = next((row for row in self.rows if row.count("number") == number), None)
        if row is None:
            return f"flight number {number}"
        name = f"flight {row.text('flight')}" if row.text("flight") else f"flight number {number}"
        return f"{name} ({row.text('date')})" if row.text("date") else name

    @property
    def alert(self) -> str:
        """That it is beyond a level, since when, and how large it is; "" where it is not."""
        if not self.level:
            return ""
        return f"{self.name} {self.level} since {self.flight_words(self.rows[-1].count('since'))}, now {self.size}"

    @property
    def past_alert(self) -> str:
        """That it was beyond a level and is not any more; "" where that is not so."""
        beyond = [row for row in self.rows if row.text("level")]
        if self.level or not beyond:
            return ""
        most = max((row.text("level") for row in beyond), key=SEVERITY.__getitem__)
        last = self.flight_words(beyond[-1].count("number"))
        return f"{self.name} was beyond its {most} level until {last}, and is not now ({self.size})"


def delta_courses(rows: Sequence[Row]) -> list[DeltaCourse]:
    """Deltas of one engine, those with levels first, temperatures before others."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.text("column"), []).append(row)
    courses = [DeltaCourse(mine) for mine in found.values() if any(math.isfinite(r.number("delta")) for r in mine)]
    return sorted(courses, key=lambda course: (not course.has_levels, course.unit != "°C"))


def alert_words(rows: Sequence[Row]) -> list[str]:
    """Deltas of one engine that are beyond a level at the last flight, the worst first."""
    courses = sorted(delta_courses(rows), key=lambda course: -SEVERITY[course.level])
    return [course.alert for course in courses if course.alert]


def level_words(rows: Sequence[Row]) -> str:
    """What the levels say of all deltas of one engine, in a sentence; "" where none is stated."""
    courses = [course for course in delta_courses(rows) if course.has_levels]
    if not courses:
        return ""
    told = [*alert_words(rows), *(course.past_alert for course in courses if course.past_alert)]
    names = listed([course.name for course in courses])
    return f"{'; '.join(told)}." if told else f"{names} {'are' if len(courses) > 1 else 'is'} within the alert levels."


def delta_chart(key: str, course: DeltaCourse, whose: str = "") -> Chart:
    """A delta over flights, with levels, maintenance and alerts; whose: engine, where several are drawn."""
    rows, first = course.rows, course.rows[0]
    order = order_windows(rows)
    delta, low, high, smoothed = ([row.number(name) for row in rows] for name in ("delta", "low", "high", "smoothed"))
    origins = [row.origin for row in rows]
    dots = Intervals("flight, with 95 % interval", order.x, delta, low, high, origins=origins)
    words = f"smoothed over {first.number('smoothing_flights'):g} flights, with 95 % band"
    columns = chart_columns(
        *("number", "flight", "date"),
        *((name, course.unit) for name in ("delta", "smoothed", "95 % from", "to")),
        "level",
    )
    cells = [
        (row.count("number"), row.text("flight"), row.text("date"), d, s, *_band(row), row.text("level"))
        for row, d, s in zip(rows, delta, smoothed, strict=True)
    ]
    lines = [ReferenceLine(first.number(name), name.split("_")[0]) for name in ALERT_LEVELS if first.text(name)]
    setting = f" at equal {split_column(first.text('setting'))[0]}" if first.text("setting") else ""
    return Chart(
        key,
        f"{course.name}{whose}{setting}",
        order.axis,
        Axis(course.name, course.unit),
        [dots, *_smoothed_layers(rows, order.x, words)],
        ChartTable(columns, cells, origins),
        "Dots: mean over a flight of reading minus prediction. Line: exponentially weighted mean, begun anew after "
        "maintenance.",
        list(_marks(rows, order.x)),
        [ReferenceLine(0.0, "nominal"), *lines],
    )


def _band(row: Row) -> tuple[float, float]:
    return row.number("smoothed_low"), row.number("smoothed_high")


def _smoothed_layers(rows: Sequence[Row], x: Sequence[float], words: str) -> Iterator[Layer]:
    """The line with its band, interrupted where smoothing begins anew."""
    begun = [0, *(k for k, row in enumerate(rows) if k and row.flag("maintenance")), len(rows)]
    for first, last in pairwise(begun):
        part = rows[first:last]
        low, high = zip(*map(_band, part), strict=True)
        yield Band("", x[first:last], low, high, colour=1)
        yield Line(words if not first else "", x[first:last], [row.number("smoothed") for row in part], colour=1)


def _marks(rows: Sequence[Row], x: Sequence[float]) -> Iterator[EventMark]:
    """Maintenance, and where a level is passed."""
    before = ""
    for row, place in zip(rows, x, strict=True):
        if row.flag("maintenance"):
            yield EventMark(place, "maintenance")
        level = row.text("level")
        if level and level != before:
            yield EventMark(place, level)
        before = level


def leading_delta(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Of all rows of `trend --what deltas` one delta of one engine: that of the worst level, else the first that has
    levels, else the last temperature. Raises NoVerdictError where no flight has one."""
    engines: dict[str, list[Row]] = {}
    for cells in rows:
        row = Row(cells, RowOrigin(str(cells.get("source") or ""), str(cells.get("flight") or "")))
        engines.setdefault(row.text("engine"), []).append(row)
    every = [(engine, course) for engine, mine in engines.items() for course in delta_courses(mine)]
    if not every:
        raise NoVerdictError("--picture: no flight has deltas that could be drawn")
    hot = [entry for entry in every if entry[1].unit == "°C"]
    ordered = [*(entry for entry in every if entry[1].has_levels), *reversed(hot), *every]
    engine, course = max(ordered, key=lambda entry: SEVERITY[entry[1].level])
    return delta_chart("deltas", course, f" of engine {engine}" if engine else "")
