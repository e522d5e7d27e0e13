"""Data of a command: where they go, and in which format.

Rows are written as CSV or JSON, one row in memory at a time. On a terminal they are a table of the columns that fit,
and of all of them with --wide. No cell is ever cut.
"""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO

from enginediag_cli.errors import DataError
from enginediag_cli.progress import wipe
from enginediag_cli.report.messages import wants_color
from enginediag_cli.safe_text import guarded, json_escaped, visible

if TYPE_CHECKING:
    from enginediag_cli.recordings.table import RecordingWriter


def plain(value: Any) -> Any:
    """`value` in Python's own types: numpy scalars and arrays become numbers and lists."""
    if hasattr(value, "tolist"):  # numpy, without importing it
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    return value


def cell(value: Any) -> str:
    """Text of one CSV cell: floats that read back to the same value, empty for None and NaN."""
    value = plain(value)
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, dict):
        return "; ".join(f"{key}={cell(item)}" for key, item in value.items())
    if isinstance(value, list):
        return "; ".join(cell(item) for item in value)
    return str(value)


def bare_cells(row: Mapping[str, Any], columns: Sequence[str]) -> list[Any]:
    """Cells of a row as numbers and texts; what is neither is the text that a CSV cell has of it."""
    values = [plain(row.get(column)) for column in columns]
    return [cell(value) if isinstance(value, (dict, list)) else value for value in values]


def write_csv(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    stream: TextIO,
    *,
    provenance: Sequence[str] = (),
    live: bool = False,
) -> int:
    """Write rows as CSV: provenance lines behind `# `, the header, then the rows.

    Parameters
    ----------
    rows : iterable of mapping
        Column → value; a column that a row lacks is empty.
    columns : sequence of str
        Columns, in their order.
    stream : TextIO
        Where they are written.
    provenance : sequence of str
        Lines of the head.
    live : bool
        Whether each row is flushed.

    Returns
    -------
    int
        Number of rows.
    """
    import csv

    for line in provenance:
        stream.write(line.rstrip("\n") + "\n" if line.startswith("#") else f"# {line}\n")
    writer = csv.writer(stream, lineterminator="\n")
    shown = stream.isatty()

    def safe(value: Any) -> str:
        """A cell that neither a spreadsheet nor a terminal obeys; numbers stay as they are."""
        text = cell(value)
        if isinstance(value, (float, int)):
            return text
        text = guarded(text) if _begins_with_text(value) else text
        return visible(text) if shown else text

    if columns:
        writer.writerow([safe(column) for column in columns])
    count = 0
    for count, row in enumerate(rows, start=1):  # noqa: B007
        writer.writerow([safe(row.get(column)) for column in columns])
        if live:
            stream.flush()
    return count


def write_json(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO, *, live: bool = False) -> int:
    """One JSON array of objects, written row by row; NaN and infinity, which JSON lacks, become null."""
    count = 0
    for count, row in enumerate(rows, start=1):
        record = {column: finite(plain(row.get(column))) for column in columns}
        stream.write("[\n" if count == 1 else ",\n")
        stream.write(json_text(record))
        if live:
            stream.flush()
    stream.write("\n]\n" if count else "[]\n")
    return count


def write_object(document: Mapping[str, Any], stream: TextIO) -> None:
    """One JSON object, indented, NaN and infinity as null; values that are iterators are written item by item."""
    between = "{"
    for key, value in document.items():
        stream.write(f"{between}\n {json_text(str(key))}: ")
        between = ","
        if not isinstance(value, Iterator):
            stream.write(_indented(value, 1))
            continue
        count = 0
        for count, item in enumerate(value, start=1):
            stream.write(("[" if count == 1 else ",") + "\n  " + _indented(item, 2))
        stream.write("\n ]" if count else "[]")
    stream.write("\n}\n" if document else "{}\n")


def _indented(value: Any, depth: int) -> str:
    """As part of an object, so many levels deep."""
    return json_text(finite(plain(value)), indent=1).replace("\n", "\n" + " " * depth)


def write_ndjson(rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO) -> int:
    """One JSON object a line, each handed on at once; NaN and infinity become null."""
    count = 0
    for row in rows:
        count += 1
        stream.write(json_text({column: finite(plain(row.get(column))) for column in columns}) + "\n")
        stream.flush()
    return count


def json_text(value: Any, indent: int | None = None) -> str:
    """JSON of plain, finite values; letters as they are, control characters as escapes, those beyond ASCII too."""
    import json

    text = json.dumps(value, ensure_ascii=False, allow_nan=False, indent=indent)
    return json_escaped(text)


def _begins_with_text(value: Any) -> bool:
    """Whether a cell begins with a text and not with a number: "=1" and ["-x", 2], but not -3.5 and [-1, 2]."""
    value = plain(value)
    while isinstance(value, list) and value:
        value = value[0]
    return isinstance(value, (str, dict))


def finite(value: Any) -> Any:
    """`value` with every NaN and infinity replaced by None."""
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [finite(item) for item in value]
    return value


PARQUET = "parquet"
"""A format of files alone, chosen by their name."""

SUFFIX_FORMATS = {".csv": "csv", ".json": "json", ".ndjson": "ndjson", ".jsonl": "ndjson", ".parquet": PARQUET}

RECORDING_FORMATS = ("csv", PARQUET)
"""Those in which a recording is written record by record as it would be read again."""

NEUTRAL_SUFFIXES = ("", ".txt", ".dat")
"""Names of a table that say nothing of its format; csv is written."""


def _ignore(text: str) -> None:
    """No message is written."""


@dataclass(frozen=True)
class Output:
    """Where results are written, and how; nothing is opened before there are data.

    Attributes
    ----------
    path : str
        File, or "-" for standard output.
    format : str
        Format, or "auto": by the file's ending, a table on a terminal.
    header : bool
        Whether a CSV begins with its provenance.
    color : {"auto", "always", "never"}
        Whether a table is coloured.
    wide : bool
        Whether a table has all columns.
    columns : tuple of str
        Columns that are written, in their order; empty for all.
    notify : callable
        Receives the columns excluded from a table, in words.
    """

    path: str = "-"
    format: str = "auto"
    header: bool = True
    color: str = "auto"
    wide: bool = False
    columns: tuple[str, ...] = ()
    notify: Callable[[str], None] = _ignore

    @property
    def to_stdout(self) -> bool:
        return self.path == "-"

    def chosen_format(self) -> str:
        """csv, json, ndjson, table, parquet; auto: by the file's suffix, else table on a terminal, csv in a pipe."""
        if self.format != "auto":
            return self.format
        if not self.to_stdout:
            return SUFFIX_FORMATS.get(table_suffix(self.path), "csv")
        return "table" if self._writes_to_terminal() else "csv"

    def _writes_to_terminal(self) -> bool:
        return self.to_stdout and sys.stdout is not None and sys.stdout.isatty()

    @contextmanager
    def open(self) -> Iterator[TextIO]:
        """The stream to write to, packed for a name in `.gz`.

        A file appears under its name only when the block ends without an error. Raises OSError.
        """
        from enginediag_cli.recordings.write import open_output

        with open_output(self.path) as stream:
            wipe()
            yield stream

    @contextmanager
    def open_recording(self, provenance: Sequence[str] = ()) -> Iterator[RecordingWriter]:
        """As `open`, for recordings in one of RECORDING_FORMATS. Raises DataError, OSError."""
        from enginediag_cli.recordings.write import open_recording_output

        with open_recording_output(self.path, provenance, parquet=self.chosen_format() == PARQUET) as writer:
            wipe()
            yield writer

    def write_text(self, text: str) -> None:
        """Write a document (YAML, JSON schema, prose) as it is; a terminal gets control characters as escapes."""
        with self.open() as stream:
            stream.write(visible(text) if stream.isatty() else text)

    def write_document(
        self,
        document: Mapping[str, Any] | Callable[[], Mapping[str, Any]],
        rows: Iterable[Mapping[str, Any]],
        columns: Sequence[str] | None = None,
        *,
        summary: Sequence[str] = (),
        provenance: Sequence[str] = (),
    ) -> None:
        """Write all of a result: as json one object, `document`, whose values may be iterators of what need not be held
        together, unless the user chose columns; else its `rows`."""
        if self.chosen_format() != "json" or self.columns:
            self.write_rows(rows, columns, summary=summary, provenance=provenance)
            return
        told = document() if callable(document) else document
        with self.open() as stream:
            write_object(told, stream)

    def write_rows(
        self,
        rows: Iterable[Mapping[str, Any]],
        columns: Sequence[str] | None = None,
        *,
        summary: Sequence[str] = (),
        provenance: Sequence[str] = (),
        live: bool = False,
    ) -> int:
        """Write `rows` in the chosen format as they come and return how many there were.

        `columns` defaults to the keys of the first row; `summary` are those that matter most, for a terminal on which
        not all have room. `provenance` lines go above a CSV, each behind `# `, unless the user gave --no-header.
        `live` hands every row on at once, for input that is still growing. A table needs all rows to find its widths;
        csv, json and ndjson hold one row at a time, parquet a group. Raises DataError when the user chose a column
        that is not there.
        """
        iterator = iter(rows)
        first = next(iterator, None)  # an error in the first row leaves no output behind, not even a header
        if first is not None:
            columns = tuple(columns or first)
            iterator = chain([first], iterator)
        columns = self._select_columns(columns)
        form = self.chosen_format()
        if form == PARQUET:
            return self._write_parquet(iterator, columns, provenance if self.header else ())
        with self.open() as stream:
            if form == "table":
                return self._write_table(iterator, columns, stream, summary)
            return write_rows(
                _wipe_before_each(iterator) if stream.isatty() else iterator,
                columns,
                format=form,
                stream=stream,
                live=live,
                provenance=provenance if self.header else (),
            )

    def _write_parquet(
        self, rows: Iterable[Mapping[str, Any]], columns: Sequence[str], provenance: Sequence[str]
    ) -> int:
        """Rows with lists and mappings as the texts that CSV has of them."""
        from enginediag_cli.recordings.write import open_binary_output, write_parquet

        notes = [line.removeprefix("#").strip() if line.startswith("#") else line for line in provenance]
        with open_binary_output(self.path) as stream:
            return write_parquet((bare_cells(row, columns) for row in rows), columns, stream, self.path, notes)

    def write_tables(self, parts: Iterable[Sequence[Mapping[str, Any]]], summary: Sequence[str] = ()) -> None:
        """Write several tables for people below each other, an empty line between."""
        with self.open() as stream:
            for number, rows in enumerate(part for part in parts if part):
                stream.write("\n" if number else "")
                self._write_table(rows, self._select_columns(tuple(rows[0])), stream, summary)

    def _write_table(
        self, rows: Iterable[Mapping[str, Any]], columns: Sequence[str], stream: TextIO, summary: Sequence[str]
    ) -> int:

        result = write_table(
            rows,
            columns,
            stream,
            color=wants_color(self.color, stream),
            summary=() if self.wide or self.columns else (summary or columns),
        )
        if result.omitted:
            some = f"{result.omitted} of {len(columns)} columns are hidden to fit the terminal"
            self.notify(f"{some}; --wide shows all of them, --columns A,B those that you name")
        return result.rows

    def _select_columns(self, columns: Sequence[str] | None) -> tuple[str, ...]:
        """The columns that the user named, or all. Raises DataError for one that is not there."""
        if not self.columns or not columns:  # of no rows with unknown columns, none can be wrong
            return tuple(columns or ())
        for name in self.columns:
            if name not in columns:
                from enginediag_cli.config.fields import near

                raise DataError(f"--columns: there is no column {name!r} ({near(name, columns)})")
        return self.columns


def table_suffix(path: str) -> str:
    """The ending that says the format of a table: ".json" of "a.json" and of "a.JSON.gz"."""
    return os.path.splitext(path.lower().removesuffix(".gz"))[1]


def check_parquet(path: str) -> None:
    """Raises DataError where Parquet cannot be written to `path`, for want of the package."""
    from enginediag_cli.recordings.write import parquet_library

    parquet_library(path, "write a .csv")


def write_rows(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    *,
    format: str,
    stream: TextIO,
    provenance: Sequence[str] = (),
    live: bool = False,
) -> int:
    """Write `rows` to an open stream as "csv", "json" (one array) or "ndjson" (a line each); returns their number."""
    if format == "csv":
        return write_csv(rows, columns, stream, provenance=provenance, live=live)
    if format == "json":
        return write_json(rows, columns, stream, live=live)
    return write_ndjson(rows, columns, stream)


def _wipe_before_each(rows: Iterable[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Rows for a terminal, which may also show how far the work is: that is wiped before each of them."""
    for row in rows:
        wipe()
        yield row


DIGITS = 4
"""Significant digits of a number in a table; csv and json have all."""

WHOLE = 1e6
"""Below it, the whole part of a number is shown to the last digit: 10668 m, not 1.067e+04 m."""


class TableSize(NamedTuple):
    """How many rows a table has, and how many of the columns had no room."""

    rows: int
    omitted: int


def write_table(
    rows: Iterable[Mapping[str, Any]],
    columns: Sequence[str],
    stream: TextIO,
    *,
    color: bool = False,
    width: int | None = None,
    summary: Sequence[str] = (),
) -> TableSize:
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
        return TableSize(0, 0)
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
    return TableSize(len(cells), left_out)


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
