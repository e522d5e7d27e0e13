"""Rows for people: a table of the columns that fit, and of all of them where that is asked for. No cell is ever cut."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple, TextIO

from enginediag_cli.report.output import cell, plain
from enginediag_cli.safe_text import visible

DIGITS = 4
"""Significant digits of a number in a table; csv and json have all."""

WHOLE = 1e6
"""Below it, the whole part of a number is shown to the last digit: 10668 m, not 1.067e+04 m."""


class Written(NamedTuple):
    """How many rows a table has, and how many of the columns had no room."""

    rows: int
    left_out: int


def write_table(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    stream: TextIO,
    *,
    color: bool = False,
    width: int | None = None,
    summary: Sequence[str] = (),
) -> Written:
    """Write all rows (held in memory to find the widths).

    On a terminal narrower than the table (`width`, default the terminal's own), the columns of `summary` that have
    room are shown, the first of them above all; without a summary, each row becomes a block of `name  value` lines.
    In a pipe or file the table is as wide as it needs to be.
    """
    numeric = [True] * len(columns)
    cells: list[list[str]] = []
    for row in rows:
        values = [plain(row.get(column)) for column in columns]
        are_numbers = [isinstance(value, (int, float, type(None))) for value in values]
        numeric = [so_far and this for so_far, this in zip(numeric, are_numbers, strict=True)]
        cells.append([short_cell(value) for value in values])
    if not cells:
        return Written(0, 0)
    columns = [visible(column, breaks=True) for column in columns]
    widths = [max(len(text) for text in column) for column in zip(columns, *cells, strict=True)]
    left_out = 0
    if stream.isatty():
        room = width or terminal_width()
        if summary and _width(widths) > room:
            told = {name for k, name in enumerate(columns) if any(texts[k] for texts in cells)}
            wanted = [columns.index(name) for name in dict.fromkeys(summary) if name in told]
            kept = _fitting(wanted, widths, room)
            left_out = len(columns) - len(kept)
            cells = [[texts[k] for k in kept] for texts in cells]
            columns, widths, numeric = [columns[k] for k in kept], [widths[k] for k in kept], [numeric[k] for k in kept]
            _write_rich(cells, columns, widths, numeric, stream, color)
        elif _width(widths) > room:
            _write_blocks(cells, columns, stream)
        else:
            _write_rich(cells, columns, widths, numeric, stream, color)
    else:
        _write_plain(cells, columns, widths, numeric, stream)
    return Written(len(cells), left_out)


def short_cell(value: Any) -> str:
    """Like a CSV cell, with numbers to four digits, and control characters as escapes."""
    return visible(cell(_short(plain(value))), breaks=True)


def _short(value: Any) -> Any:
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:.0f}" if 10 ** (DIGITS - 1) <= abs(value) < WHOLE else f"{value:.{DIGITS}g}"
    if isinstance(value, list):
        return [_short(item) for item in value]
    return value


def _width(widths: Sequence[int]) -> int:
    """Of a table: two spaces stand between columns."""
    return sum(widths) + 2 * (len(widths) - 1)


def _fitting(wanted: Sequence[int], widths: Sequence[int], room: int) -> list[int]:
    """Which columns have room, the first wanted before all others; at least that one."""
    kept: list[int] = []
    for k in wanted or range(len(widths)):
        if not kept or _width([widths[j] for j in (*kept, k)]) <= room:
            kept.append(k)
    return kept


def terminal_width() -> int:
    import shutil

    return shutil.get_terminal_size().columns


def _write_plain(
    cells: Sequence[Sequence[str]],
    columns: Sequence[str],
    widths: Sequence[int],
    numeric: Sequence[bool],
    stream: TextIO,
) -> None:
    for texts in [columns, *cells]:
        padded = [
            text.rjust(width) if right else text.ljust(width)
            for text, width, right in zip(texts, widths, numeric, strict=True)
        ]
        stream.write("  ".join(padded).rstrip() + "\n")


def _write_blocks(cells: Sequence[Sequence[str]], columns: Sequence[str], stream: TextIO) -> None:
    label = max(len(column) for column in columns)
    for number, texts in enumerate(cells, start=1):
        stream.write(f"-- {number} of {len(cells)} --\n")
        for column, text in zip(columns, texts, strict=True):
            stream.write(f"{column.ljust(label)}  {text}".rstrip() + "\n")


def _write_rich(
    cells: Sequence[Sequence[str]],
    columns: Sequence[str],
    widths: Sequence[int],
    numeric: Sequence[bool],
    stream: TextIO,
    color: bool,
) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    # Text, not str: rich would take a unit such as [kg/s] for markup and drop it
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold" if color else "")
    for column, right in zip(columns, numeric, strict=True):
        table.add_column(Text(column), justify="right" if right else "left", no_wrap=True)
    for texts in cells:
        table.add_row(*(Text(text) for text in texts))
    console = Console(
        file=stream,
        width=sum(widths) + 2 * len(widths),
        markup=False,
        highlight=False,
        emoji=False,
        no_color=not color,
        force_terminal=color,
    )
    console.print(table)
