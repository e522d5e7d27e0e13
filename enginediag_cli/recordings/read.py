"""Flight-data CSV in, in chunks of constant memory: declared columns as float64, all others as they came.

Nothing is guessed: a column holds numbers because its name carries a unit or because the caller says so.
"""

from __future__ import annotations

import csv
import difflib
import gzip
import re
import sys
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording, concat
from enginediag_cli.units import is_numeric_column

MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Cells of a declared column that stand for a missing value, in any case."""

_LINE_END = re.compile(r"\r\n|\r|\n")

Source = str | Path | Iterable[str]


def read(
    source: Source,
    *,
    declared: Collection[str] = (),
    required: Collection[str] = (),
    by_suffix: bool = True,
    chunk_records: int = 20_000,
) -> Iterator[Recording]:
    """Yield the records of a CSV file in chunks; a file without records yields one empty recording.

    source: path (`-` is stdin, `.gz` is unpacked) or an open text stream. Numbers are the columns named in
    `declared` and `required` and, with `by_suffix`, those whose name carries a unit; the rest is text.
    Columns in `required` must be there. Raises DataError naming file, physical line and column.
    """
    with opened(source) as (stream, name):
        try:
            yield from _records(stream, name, {*declared, *required}, required, by_suffix, chunk_records)
        except UnicodeDecodeError as error:
            raise DataError(f"{name}: not UTF-8 text ({error.reason})") from error
        except (gzip.BadGzipFile, EOFError) as error:
            raise DataError(f"{name}: damaged gzip file ({error})") from error


def read_all(
    source: Source, *, declared: Collection[str] = (), required: Collection[str] = (), by_suffix: bool = True
) -> Recording:
    """As `read`, the whole file as one recording."""
    return concat(list(read(source, declared=declared, required=required, by_suffix=by_suffix)))


@contextmanager
def opened(source: Source) -> Iterator[tuple[Iterable[str], str]]:
    """The lines of a file and what it is called in messages. Raises DataError when it cannot be opened."""
    if not isinstance(source, (str, Path)):
        yield source, getattr(source, "name", "<stream>")
    elif str(source) == "-":
        # stdin's own text layer may use another encoding and would translate line ends inside quotes
        stream = open(sys.stdin.fileno(), encoding="utf-8-sig", newline="", closefd=False)
        with stream:
            yield stream, "<stdin>"
    else:
        try:
            file: TextIO = (
                gzip.open(source, "rt", encoding="utf-8-sig", newline="")
                if str(source).endswith(".gz")
                else open(source, encoding="utf-8-sig", newline="")
            )
        except OSError as error:
            raise DataError(f"{source}: {error.strerror or error}") from error
        with file:
            yield file, str(source)


def _records(
    stream: Iterable[str],
    name: str,
    numbers: set[str],
    required: Collection[str],
    by_suffix: bool,
    chunk_records: int,
) -> Iterator[Recording]:
    head, provenance, first = _head(stream, name)
    # the header goes through the csv reader too, so that a quoted name may hold a comma or a line end
    reader = csv.reader(_chain(first, stream), strict=True)
    try:
        order = [cell.strip() for cell in next(reader)]
    except csv.Error as error:
        raise DataError(f"{name}:{head + 1}: {error}") from error
    _check_header(order, required, name, head + 1)
    is_number = [cell in numbers or (by_suffix and is_numeric_column(cell)) for cell in order]
    empty = True
    while True:
        before = reader.line_num
        rows, line = _rows(reader, len(order), name, head, chunk_records)
        ended = reader.line_num == before
        if ended and not empty:
            return
        if not rows and not ended:
            continue
        cells = list(zip(*rows, strict=True)) if rows else [()] * len(order)
        yield Recording(
            columns={c: _floats(cells[j], c, line, name) for j, c in enumerate(order) if is_number[j]},
            text={c: list(cells[j]) for j, c in enumerate(order) if not is_number[j]},
            order=tuple(order),
            line=line,
            source=name,
            provenance=tuple(provenance),
        )
        empty = False


def _head(stream: Iterable[str], name: str) -> tuple[int, list[str], str]:
    """Number of lines before the header, the provenance lines among them, and the header's first line."""
    provenance: list[str] = []
    for number, text in enumerate(stream):
        bare = text.lstrip("\ufeff").rstrip("\r\n")
        if bare.startswith("#"):
            provenance.append(bare[1:].strip())
        elif bare.strip():
            return number, provenance, text.lstrip("\ufeff")
    raise DataError(f"{name}: no header line: the file is empty")


def _chain(first: str, rest: Iterable[str]) -> Iterator[str]:
    yield first
    yield from rest


def _check_header(order: list[str], required: Collection[str], name: str, line: int) -> None:
    for position, column in enumerate(order, start=1):
        if not column:
            raise DataError(f"{name}:{line}: column {position} has no name")
        if order.index(column) != position - 1:
            raise DataError(f"{name}:{line}:{column}: two columns have this name")
    absent = [column for column in required if column not in order]
    if not absent:
        return
    hints = []
    for column in absent:
        near = difflib.get_close_matches(column, order, n=1)
        hints.append(column + (f" (did you mean {near[0]!r}?)" if near else ""))
    raise DataError(
        f"{name}:{line}: missing column{'s' if len(absent) > 1 else ''} {', '.join(hints)}; "
        f"the file has {', '.join(order)}"
    )


def _rows(reader: Any, width: int, name: str, head: int, chunk_records: int) -> tuple[list[list[str]], np.ndarray]:
    """Up to chunk_records rows with the physical line on which each begins; blank lines are passed over.

    `reader` is a csv.reader: its line_num counts the physical lines that it has taken.
    """
    before = reader.line_num
    try:
        rows = list(islice(reader, chunk_records))
    except csv.Error as error:
        raise DataError(f"{name}:{head + reader.line_num}: {error}") from error
    if reader.line_num - before == len(rows) and all(map(width.__eq__, map(len, rows))) and width > 1:
        return rows, head + before + 1 + np.arange(len(rows))
    # a blank line, a quoted line end or a wrong row: find each row's own line. A quoted line end is one
    # inside a cell, so the lines of a row are one more than its line ends.
    taken, lines = [], []
    line = head + before + 1
    for row in rows:
        if len(row) == width and any(cell.strip() for cell in row):
            taken.append(row)
            lines.append(line)
        elif any(cell.strip() for cell in row):
            shown = ",".join(row[:4]) + (",…" if len(row) > 4 else "")
            raise DataError(f"{name}:{line}: {len(row)} fields where the header has {width}: {shown}")
        line += 1 + sum(len(_LINE_END.findall(cell)) for cell in row)
    return taken, np.array(lines, dtype=np.int64)


def _floats(cells: Collection[str], column: str, line: np.ndarray, name: str) -> np.ndarray:
    """(N,) float64 of one column's cells; the slow way only where a cell is missing or wrong."""
    try:
        values = np.fromiter(map(float, cells), dtype=float, count=len(cells))
    except ValueError:
        values = np.empty(len(cells))
        for k, cell in enumerate(cells):
            try:
                values[k] = np.nan if cell.strip().lower() in MISSING else float(cell)
            except ValueError:
                raise DataError(f"{name}:{line[k]}:{column}: not a number: {cell!r}") from None
    if "_" in "".join(cells):  # float() reads 1_000 as a thousand; a recorder that writes it has lost a digit
        bad = next(k for k, cell in enumerate(cells) if "_" in cell)
        raise DataError(f"{name}:{line[bad]}:{column}: not a number: {list(cells)[bad]!r}")
    return values
