"""Rows for people: a table, or one block per row where a table would not fit. Nothing is ever cut off."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TextIO

from enginediag_cli.presentation.rows import cell, plain


def write_table(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    stream: TextIO,
    *,
    color: bool = False,
    width: int | None = None,
) -> int:
    """Write all rows (held in memory to find the widths); returns their number.

    On a terminal narrower than the table (`width`, default the terminal's own) each row becomes a block of
    `name  value` lines. In a pipe or file the table is as wide as it needs to be.
    """
    numeric = [True] * len(columns)
    cells: list[list[str]] = []
    for row in rows:
        values = [plain(row.get(column)) for column in columns]
        are_numbers = [isinstance(value, (int, float, type(None))) for value in values]
        numeric = [so_far and this for so_far, this in zip(numeric, are_numbers, strict=True)]
        cells.append([short_cell(value) for value in values])
    if not cells:
        return 0
    widths = [max(len(text) for text in column) for column in zip(columns, *cells, strict=True)]
    if stream.isatty():
        if sum(widths) + 2 * len(widths) > (width or terminal_width()):
            _write_blocks(cells, columns, stream)
        else:
            _write_rich(cells, columns, widths, numeric, stream, color)
    else:
        _write_plain(cells, columns, widths, numeric, stream)
    return len(cells)


def short_cell(value: Any) -> str:
    """Like a CSV cell, with numbers to six digits."""
    if isinstance(value, float):
        value = f"{value:.6g}" if value == value else None
    return cell(value)


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
