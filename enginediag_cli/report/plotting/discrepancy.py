"""Pictures of `locate`, `explain` and `refine`.

Of `locate` a heat map, location × driver, and below it what shows the first place best: residuals of a sensor against
the driver with the free-form curve, or an amplitude record by record. Of `explain` what no listed effect explains, as a
curve with its band. Of `refine` the misfit of every sensor on unseen flights before and after, and the gain of each
flight.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.identification.nominal import EVERYTHING
from enginediag_cli.probability import NORMAL_95
from enginediag_cli.report.plotting import BLUE, FAINT, INK, ORANGE, ink_on, padded
from enginediag_cli.report.plotting.svg import HEADING, SMALL, TITLE, Drawing, Edge, Letters, Panel, shade, ticks
from enginediag_cli.report.sentences import count
from enginediag_cli.report.tables.explanation_text import control_headline
from enginediag_cli.report.tables.formulas import equation
from enginediag_cli.report.tables.identification import (
    alarms_in_words,
    fall_in_words,
    named_effect,
    validation_flights_words,
)

if TYPE_CHECKING:
    from enginediag_cli.identification.nominal import SensorQuality
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.refine.controlled import ControlRefinement
    from enginediag_cli.mismatch.refine.refine import Refinement


CELL_HEIGHT, COLUMN = 21.0, 76.0
"""Pixels of a cell: a line of text high, a number and a short driver wide."""
LABELS, MARGIN = 236.0, 16.0
"""Pixels of the names of places, and around everything."""
LETTER = 6.6  # width of a letter of the notes, generously
PANEL_LEFT, PANEL_HEIGHT, LEAST_WIDTH = 86.0, 250.0, 720.0
"""Pixels of the curve below the map: its axis, its height; and of the whole at least, for a title."""
MOST_ROWS, MOST_COLUMNS, MOST_NAMES, COLUMN_LETTERS = 14, 8, 2, 12
"""What fits on a page: places, drivers, names a driver goes by, letters of one."""
LABEL_LETTERS = 37
"""Letters of a place's name that LABELS has room for."""
MOST_DOTS = 3000
"""More cannot be seen, and the file stays small."""


@dataclass(frozen=True)
class HeatMap:
    """`surprise[row][column]` is −ln p, NaN where it cannot be seen; `gate`: what chance alone reaches;
    `within`: (row, column) of the places that are named."""

    rows: Sequence[str]
    columns: Sequence[str]
    surprise: Sequence[Sequence[float]]
    gate: float
    near_best: frozenset[tuple[int, int]]


@dataclass(frozen=True)
class ScatterData:
    """Dots (n,), means of some of them with their standard errors (x, mean, error), and a line through points;
    `caption` says what they are."""

    x_label: str
    y_label: str
    caption: str
    x: Sequence[float]
    y: Sequence[float]
    means: Sequence[tuple[float, float, float]]
    line: Sequence[tuple[float, float]]


def mismatch_picture(title: str, notes: Sequence[str], heat: HeatMap, below: ScatterData | None) -> str:
    """The SVG text; `notes` stand below the title. Narrow enough to be read on a page at full size."""
    rows, columns = min(len(heat.rows), MOST_ROWS), min(len(heat.columns), MOST_COLUMNS)
    width = max(LEAST_WIDTH, 2 * MARGIN + LABELS + COLUMN * columns)
    lines = _wrapped(notes, width)
    heads = max((len(_lines(name)) for name in heat.columns[:columns]), default=1)
    top = 78.0 + 17 * len(lines) + 13 * heads
    end = top + CELL_HEIGHT * rows + 48
    caption = _wrapped([below.caption] if below else [], width)
    on = Drawing(width, end + (18 * len(caption) + PANEL_HEIGHT + 64 if below else 0), title)
    on.words(MARGIN, 28, title, letters=TITLE)
    for number, line in enumerate(lines):
        on.words(MARGIN, 52 + 17 * number, line)
    _draw_map(on, heat, rows, columns, top)
    if below:
        for number, line in enumerate(caption):
            on.words(MARGIN, end + 18 + 17 * number, line)
        on_top = end + 12 + 18 * len(caption)
        _draw_scatter(on, below, on_top, width - PANEL_LEFT - MARGIN - 8)
    return on.text()


def _wrapped(texts: Sequence[str], width: float) -> list[str]:
    return [line for text in texts for line in textwrap.wrap(text, int((width - 2 * MARGIN) / LETTER))]


def _draw_map(on: Drawing, heat: HeatMap, rows: int, columns: int, top: float) -> None:
    largest = max((v for line in heat.surprise[:rows] for v in line if math.isfinite(v)), default=1.0)
    left = MARGIN + LABELS
    for j, name in enumerate(heat.columns[:columns]):
        for k, part in enumerate(reversed(_lines(name))):
            on.words(left + COLUMN * (j + 0.5), top - 9 - 13 * k, part, letters=SMALL, anchor="middle")
    for i in range(rows):
        y = top + CELL_HEIGHT * i
        name = textwrap.shorten(heat.rows[i], LABEL_LETTERS, placeholder=" …")
        on.words(left - 8, y + 15, name, anchor="end")
        for j in range(columns):
            value, x = heat.surprise[i][j], left + COLUMN * j
            if not math.isfinite(value):
                on.rectangle(x, y, COLUMN - 2, CELL_HEIGHT - 2, "#eeeeee", hint="absorbed by what is identified")
                continue
            # square root: what matters begins a little above the gate, while the largest may be a hundred times that
            dark = math.sqrt(value / largest) if value > heat.gate else 0.25 * value / max(heat.gate, 1e-9)
            fill = shade(dark)
            on.rectangle(x, y, COLUMN - 2, CELL_HEIGHT - 2, fill)
            on.words(
                x + COLUMN / 2 - 1,
                y + 14,
                f"{value:.1f}" if value < 100 else f"{value:.0f}",
                letters=Letters(SMALL.size, fill=ink_on(fill)),
                anchor="middle",
            )
    for i, j in sorted(heat.near_best):  # last, so that no neighbour covers the frame
        if i < rows and j < columns:
            on.rectangle(
                left + COLUMN * j, top + CELL_HEIGHT * i, COLUMN - 2, CELL_HEIGHT - 2, "none", edge=Edge(ORANGE, 2.5)
            )
    y = top + CELL_HEIGHT * rows + 18
    told = "; framed: within reach of the first place" if heat.near_best else ""
    if any(not math.isfinite(value) for line in heat.surprise[:rows] for value in line[:columns]):
        told += "; grey: taken by identification"
    on.words(MARGIN, y, f"Numbers: −ln p of a correction there; chance alone reaches {heat.gate:.1f}{told}")
    left_out = [
        count(have - shown, what)
        for have, shown, what in ((len(heat.rows), rows, "place"), (len(heat.columns), columns, "driver"))
        if have > shown
    ]
    if left_out:
        on.words(MARGIN, y + 17, f"Less surprising, not drawn: {' and '.join(left_out)}")


def _draw_scatter(on: Drawing, given: ScatterData, top: float, width: float) -> None:
    ys = sorted(given.y)
    # a few far readings must not flatten the rest
    inner = ys[int(0.005 * len(ys)) : math.ceil(0.995 * len(ys))] or ys
    y_range = padded([*inner, *(y for _, y in given.line)])
    panel = Panel(PANEL_LEFT, top, width, PANEL_HEIGHT, padded(given.x), y_range)
    panel.draw(on, given.x_label, given.y_label)
    every = max(1, -(-len(given.x) // MOST_DOTS))
    points = list(zip(given.x, given.y, strict=True))[::every]
    on.dots([panel.to_pixels(x, y) for x, y in points], BLUE, radius=1.6, opacity=0.35)
    for x, mean, error in given.means:
        (u, low), (_, high) = panel.to_pixels(x, mean - NORMAL_95 * error), panel.to_pixels(x, mean + NORMAL_95 * error)
        on.line(u, low, u, high, INK, width=1.5)
    on.dots([panel.to_pixels(x, mean) for x, mean, _ in given.means], INK, radius=3.2)
    on.path([panel.to_pixels(x, y) for x, y in given.line], ORANGE, width=2.0)


def _lines(name: str) -> list[str]:
    """A group of drivers in lines that fit above a column."""
    parts = [p.strip().replace("_", " ") for p in name.split("=")]
    shown = [p if k == 0 else f"= {p}" for k, p in enumerate(parts[:MOST_NAMES])]
    lines = [line for p in shown for line in textwrap.wrap(p, COLUMN_LETTERS)]
    return [*lines, *([f"+ {len(parts) - MOST_NAMES} more"] if len(parts) > MOST_NAMES else [])]


def build_heat_map(places: Sequence[tuple[str, str, float, bool]], columns: Sequence[str], gate: float) -> HeatMap:
    """The map from (location, driver group, −ln p, told) of every place, the most surprising location first."""
    best: dict[str, float] = {}
    values: Mapping[tuple[str, str], float] = {(a, g): v for a, g, v, _ in places}
    for location, _, value, _ in places:
        best[location] = max(best.get(location, 0.0), value)
    rows = sorted(best, key=lambda r: -best[r])
    at_row, at_column = {r: i for i, r in enumerate(rows)}, {c: j for j, c in enumerate(columns)}
    told = frozenset((at_row[a], at_column[g]) for a, g, _, t in places if t and g in at_column)
    return HeatMap(rows, columns, [[values.get((r, c), math.nan) for c in columns] for r in rows], gate, told)


WIDTH, LEFT, RIGHT = 844.0, 180.0, 220.0
"""Pixels of the whole, and of the names and numbers on either side of the bars."""
ROW, BAR = 22.0, 12.0
"""Pixels of a row, and of the bar in it."""
HEAD, LINE, BESIDE_ROWS = 60.0, 17.0, 92.0
"""Pixels of the title, of a line of the notes, and of what stands above and below the rows of the sensors."""
SPAN = WIDTH - LEFT - RIGHT
MOST_FLIGHTS, MOST_LETTERS = 15, 25
"""What fits on a page: flights, and letters of a flight's name."""


def picture(r: Refinement) -> str:
    """SVG text; ValueError when there is nothing to show."""
    u = r.unseen
    if u is None:
        raise ValueError("a refinement without unseen flights has no picture")
    title = f"{' and '.join(e.label for e in r.effects)}: before and after, on flights that were not fitted"
    told = [f"In the model now: {named_effect(e)}" for e in r.effects] + [
        validation_flights_words(r),
        alarms_in_words(r),
    ]
    lines = wrap_notes(told)
    gains = list(zip(u.labels, u.flight_gains.tolist(), strict=True))
    shown = gains if len(gains) <= MOST_FLIGHTS else gains[: MOST_FLIGHTS - 1]
    top = HEAD + LINE * len(lines)
    below = top + BESIDE_ROWS + ROW * len(u.quality_before)
    left_out = gains[len(shown) :]
    on = headed(title, lines, below + 24 + ROW * (len(shown) + bool(left_out)))
    draw_sensors(on, list(zip(u.quality_before, u.quality_after, strict=True)), top)
    _gains(on, shown, left_out, below)
    return on.text()


def wrap_notes(told: Sequence[str]) -> list[str]:
    """Notes as lines of the picture's width."""
    together = [re.sub(r" (?=%|= )|(?<=[=<]) ", "\u00a0", text) for text in told]  # number and unit stay together
    return [line for text in together for line in textwrap.wrap(text, int((WIDTH - 2 * MARGIN) / LETTER))]


def headed(title: str, lines: Sequence[str], height: float) -> Drawing:
    """A page with its title and notes."""
    on = Drawing(WIDTH, height, title)
    on.words(MARGIN, 28, title, letters=TITLE)
    for number, line in enumerate(lines):
        on.words(MARGIN, 52 + LINE * number, line)
    return on


def draw_sensors(on: Drawing, pairs: Sequence[tuple[SensorQuality, SensorQuality]], top: float) -> None:
    """RMS of every sensor's residual before and after, in its standard deviations and in its unit."""
    values = [q.chi2**0.5 for pair in pairs for q in pair if q.n]
    low, high = padded([*values, 1.0], 0.08)

    def pixel(value: float) -> float:
        return LEFT + SPAN * (value - low) / (high - low)

    on.words(MARGIN, top + 8, "RMS of the residual in standard deviations of the sensor's noise", letters=HEADING)
    for left, colour, what in ((WIDTH - 148, ORANGE, "before"), (WIDTH - 68, BLUE, "after")):
        on.dots([(left, top + 4)], colour, radius=5)
        on.words(left + 10, top + 8, what)
    on.words(pixel(1.0), top + 28, "noise alone", anchor="middle")
    on.words(WIDTH - MARGIN, top + 28, "RMS before → after", anchor="end")
    first, bottom = top + 36, top + 36 + ROW * len(pairs)
    for tick in ticks(low, high):
        on.line(pixel(tick), first, pixel(tick), bottom, FAINT)
        on.words(pixel(tick), bottom + 15, f"{tick:g}", anchor="middle")
    on.line(pixel(1.0), first, pixel(1.0), bottom, INK)
    for number, (one, other) in enumerate(pairs):
        y = first + ROW * (number + 0.5)
        on.words(LEFT - 10, y + 4, one.sensor, anchor="end")
        if not one.n:
            continue
        before, after = pixel(one.chi2**0.5), pixel(other.chi2**0.5)
        on.line(before, y, after, y, FAINT, width=4)
        on.dots([(before, y)], ORANGE, radius=5)
        on.dots([(after, y)], BLUE, radius=5)
        places = max(0, 2 - math.floor(math.log10(one.rms))) if one.rms > 0 else 0
        told = f"{one.rms:.{places}f} → {other.rms:.{places}f} {one.unit}".removesuffix(" 1")
        on.words(WIDTH - MARGIN, y + 4, told, anchor="end")


def _gains(on: Drawing, shown: list[tuple[str, float]], left_out: list[tuple[str, float]], top: float) -> None:
    """What each flight's log likelihood gains; losses in the colour of "before"."""
    on.words(MARGIN, top - 8, "Gain of log likelihood, flight by flight", letters=HEADING)
    most = max([1.0, *(abs(g) for _, g in shown)])
    for number, (name, gain) in enumerate(shown):
        y = top + ROW * (number + 0.5)
        on.words(LEFT - 10, y + 4, textwrap.shorten(name, MOST_LETTERS, placeholder=" …"), anchor="end")
        on.rectangle(LEFT, y - BAR / 2, SPAN * abs(gain) / most, BAR, BLUE if gain > 0 else ORANGE)
        on.words(LEFT + SPAN * abs(gain) / most + 6, y + 4, f"{gain:+.1f}".replace("-", "−"))
    if left_out:
        lost = sum(g <= 0 for _, g in left_out)
        total = f"{sum(g for _, g in left_out):+.1f}".replace("-", "−")
        on.words(
            LEFT,
            top + ROW * (len(shown) + 0.5) + 4,
            f"{len(left_out)} further flights: {total} in all, {lost or 'none'} of them without gain",
        )


CURVE_LEFT, HEIGHT, BELOW = 90.0, 300.0, 60.0
"""Room for the vertical axis, height of the panel, and room for the horizontal one, in pixels."""
PERCENT = 100.0
"""Of a share."""


@dataclass(frozen=True)
class _DrawnCurve:
    """A curve (G,) with its standard error, words for its axes, and lines about it."""

    x: np.ndarray
    change: np.ndarray
    error: np.ndarray
    x_label: str
    y_label: str
    lines: Sequence[str]


def explanation_picture(story: ExplanationResult) -> str:
    """SVG text; ValueError where nothing that was found is a curve of one variable."""
    drawn = _formula_curve(story) or _free_curve(story)
    if drawn is None:
        raise ValueError("nothing that was found is a curve of one variable")
    lines = wrap_notes(drawn.lines)
    top = HEAD + LINE * len(lines)
    on = headed(f"{drawn.y_label} along {drawn.x_label}", lines, top + HEIGHT + BELOW)
    low, high = drawn.change - NORMAL_95 * drawn.error, drawn.change + NORMAL_95 * drawn.error
    panel = Panel(
        CURVE_LEFT,
        top,
        WIDTH - CURVE_LEFT - MARGIN,
        HEIGHT,
        padded(drawn.x.tolist(), 0.02),
        padded([*low.tolist(), *high.tolist()]),
    )
    panel.draw(on, drawn.x_label, "change about the mean")
    for values, colour, width in ((low, ORANGE, 1.0), (high, ORANGE, 1.0), (drawn.change, BLUE, 2.0)):
        on.path([panel.to_pixels(x, y) for x, y in zip(drawn.x, values, strict=True)], colour, width=width)
    on.dots([panel.to_pixels(x, y) for x, y in zip(drawn.x, drawn.change, strict=True)], INK, radius=1.5)
    on.words(
        WIDTH - MARGIN,
        top - 6,
        "likeliest forms together (blue), 95 % (orange)",
        letters=SMALL,
        anchor="end",
    )
    return on.text()


def _formula_curve(story: ExplanationResult) -> _DrawnCurve | None:
    law = story.answer.law
    if law is None or law.band is None:
        return None
    band, first = law.band, law.laws[0]
    factor = PERCENT if band.unit in ("", "1") else 1.0
    words = first.location.words or first.location.name
    unit = "%" if factor == PERCENT else band.unit
    over = "" if band.of.variable.recorded else " (1: at the design point)"
    effect = first.option.hypothesis.effects[0]
    told = [
        effect.term.STATEMENT,
        equation(effect.term),
        f"Vertical: {words}, {unit}, over the records that were flown.",
    ]
    return _DrawnCurve(
        band.at,
        factor * band.change,
        factor * band.standard_error,
        f"{band.of.variable.words}{over}",
        f"{words}, {unit},",
        told,
    )


def _free_curve(story: ExplanationResult) -> _DrawnCurve | None:
    curve = next((c for c in story.curves if c.converged and c.driver.driver != CONSTANT), None)
    if curve is None:
        return None
    factor = PERCENT if curve.unit in ("", "1") else 1.0
    unit = "%" if factor == PERCENT else curve.unit
    told = ["No listed effect and no law explains it: a free curve of second degree."]
    words = curve.location.words
    return _DrawnCurve(
        curve.values,
        factor * curve.change,
        factor * curve.standard_error,
        f"{curve.driver.driver.words} ({curve.driver.unit})",
        f"{words}, {unit},",
        told,
    )


def control_picture(r: ControlRefinement) -> str:
    """SVG text; ValueError when nothing was judged."""
    after = {(q.sensor, q.regime): q for q in r.after}
    pairs = [
        (q, after[q.sensor, q.regime]) for q in r.before if q.regime == EVERYTHING and (q.sensor, q.regime) in after
    ]
    if not pairs:
        raise ValueError("a control that no unseen flight has judged has no picture")
    lines = wrap_notes([f"In the model now: {control_headline(r.law)}", *fall_in_words(r)])
    top = HEAD + LINE * len(lines)
    title = f"{r.law.label}: before and after, on flights that were not fitted"
    on = headed(title, lines, top + BESIDE_ROWS + ROW * len(pairs))
    draw_sensors(on, pairs, top)
    return on.text()
