"""The picture of `locate`: a heat map location × driver, and below it what shows the first place best: residuals of
a sensor against the driver with the free-form curve, or an amplitude record by record."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.report.pictures.svg import (
    BLUE,
    INK,
    ORANGE,
    PAPER,
    SMALL,
    TITLE,
    Drawing,
    Edge,
    Letters,
    Panel,
    padded,
    shade,
)
from enginediag_cli.report.sentences import count

ROW, COLUMN = 21.0, 76.0
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
    `within`: (row, column) of the places that are told."""

    rows: Sequence[str]
    columns: Sequence[str]
    surprise: Sequence[Sequence[float]]
    gate: float
    within: frozenset[tuple[int, int]]


@dataclass(frozen=True)
class Scatter:
    """Dots (n,), means of some of them with their standard errors (x, mean, error), and a line through points;
    `caption` says what they are."""

    x_label: str
    y_label: str
    caption: str
    x: Sequence[float]
    y: Sequence[float]
    means: Sequence[tuple[float, float, float]]
    line: Sequence[tuple[float, float]]


def mismatch_picture(title: str, notes: Sequence[str], heat: HeatMap, below: Scatter | None) -> str:
    """The SVG text; `notes` stand below the title. Narrow enough to be read on a page at full size."""
    rows, columns = min(len(heat.rows), MOST_ROWS), min(len(heat.columns), MOST_COLUMNS)
    width = max(LEAST_WIDTH, 2 * MARGIN + LABELS + COLUMN * columns)
    lines = _wrapped(notes, width)
    heads = max((len(_lines(name)) for name in heat.columns[:columns]), default=1)
    top = 78.0 + 17 * len(lines) + 13 * heads
    end = top + ROW * rows + 48
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
        y = top + ROW * i
        name = textwrap.shorten(heat.rows[i], LABEL_LETTERS, placeholder=" …")
        on.words(left - 8, y + 15, name, anchor="end")
        for j in range(columns):
            value, x = heat.surprise[i][j], left + COLUMN * j
            if not math.isfinite(value):
                on.rectangle(x, y, COLUMN - 2, ROW - 2, "#eeeeee", hint="absorbed by what is identified")
                continue
            # square root: what matters begins a little above the gate, while the largest may be a hundred times that
            dark = math.sqrt(value / largest) if value > heat.gate else 0.25 * value / max(heat.gate, 1e-9)
            on.rectangle(x, y, COLUMN - 2, ROW - 2, shade(dark))
            on.words(
                x + COLUMN / 2 - 1,
                y + 14,
                f"{value:.1f}" if value < 100 else f"{value:.0f}",
                letters=Letters(SMALL.size, fill=PAPER if dark > 0.5 else INK),
                anchor="middle",
            )
    for i, j in sorted(heat.within):  # last, so that no neighbour covers the frame
        if i < rows and j < columns:
            on.rectangle(left + COLUMN * j, top + ROW * i, COLUMN - 2, ROW - 2, "none", edge=Edge(ORANGE, 2.5))
    y = top + ROW * rows + 18
    told = "; framed: within reach of the first place" if heat.within else ""
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


def _draw_scatter(on: Drawing, given: Scatter, top: float, width: float) -> None:
    ys = sorted(given.y)
    # a few far readings must not flatten the rest
    inner = ys[int(0.005 * len(ys)) : math.ceil(0.995 * len(ys))] or ys
    y_range = padded([*inner, *(y for _, y in given.line)])
    panel = Panel(PANEL_LEFT, top, width, PANEL_HEIGHT, padded(given.x), y_range)
    panel.draw(on, given.x_label, given.y_label)
    every = max(1, -(-len(given.x) // MOST_DOTS))
    points = list(zip(given.x, given.y, strict=True))[::every]
    on.dots([panel.at(x, y) for x, y in points], BLUE, radius=1.6, opacity=0.35)
    for x, mean, error in given.means:
        (u, low), (_, high) = panel.at(x, mean - NORMAL_95 * error), panel.at(x, mean + NORMAL_95 * error)
        on.line(u, low, u, high, INK, width=1.5)
    on.dots([panel.at(x, mean) for x, mean, _ in given.means], INK, radius=3.2)
    on.path([panel.at(x, y) for x, y in given.line], ORANGE, width=2.0)


def _lines(name: str) -> list[str]:
    """A group of drivers in lines that fit above a column."""
    parts = [p.strip().replace("_", " ") for p in name.split("=")]
    shown = [p if k == 0 else f"= {p}" for k, p in enumerate(parts[:MOST_NAMES])]
    lines = [line for p in shown for line in textwrap.wrap(p, COLUMN_LETTERS)]
    return [*lines, *([f"+ {len(parts) - MOST_NAMES} more"] if len(parts) > MOST_NAMES else [])]


def rows_of(places: Sequence[tuple[str, str, float, bool]], columns: Sequence[str], gate: float) -> HeatMap:
    """The map from (location, driver group, −ln p, told) of every place, the most surprising location first."""
    best: dict[str, float] = {}
    values: Mapping[tuple[str, str], float] = {(a, g): v for a, g, v, _ in places}
    for location, _, value, _ in places:
        best[location] = max(best.get(location, 0.0), value)
    rows = sorted(best, key=lambda r: -best[r])
    at_row, at_column = {r: i for i, r in enumerate(rows)}, {c: j for j, c in enumerate(columns)}
    told = frozenset((at_row[a], at_column[g]) for a, g, _, t in places if t and g in at_column)
    return HeatMap(rows, columns, [[values.get((r, c), math.nan) for c in columns] for r in rows], gate, told)
