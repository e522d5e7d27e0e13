"""Flight-data CSV in, in chunks of constant memory: declared columns as float64, all others as they came.

Nothing is guessed: a column holds numbers because its name carries a unit or because the caller says so.
"""

from __future__ import annotations

import csv
import gzip
import re
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, islice
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.progress import touched
from enginediag_cli.recordings.dialect import DELIMITERS, OWN, Dialect, separator_of
from enginediag_cli.recordings.source import Source, opened, undecodable
from enginediag_cli.recordings.table import Recording, check_clock, concat
from enginediag_cli.safe_text import unguarded
from enginediag_cli.units import is_numeric_column

MISSING = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Cells of a declared column that stand for a missing value, in any case."""

_LINE_END = re.compile(r"\r\n|\r|\n")


def read(
    source: Source,
    *,
    declared: Collection[str] = (),
    required: Collection[str] = (),
    by_suffix: bool = True,
    chunk_records: int = 20_000,
    dialect: Dialect = OWN,
) -> Iterator[Recording]:
    """Yield the records of a CSV file in chunks; a file without records yields one empty recording.

    source: path (`-` is stdin, `.gz` is unpacked) or an open text stream. Numbers are the columns named in
    `declared` and `required` and, with `by_suffix`, those whose name carries a unit; the rest is text.
    Columns in `required` must be there; `dialect`: how the file is written. Raises DataError naming
    file, physical line and column.
    """
    with opened(source, dialect.codec) as (stream, name):
        touched("read:", name)
        try:
            yield from _records(
                stream, name, _Wanted({*declared, *required}, required, by_suffix, dialect), chunk_records
            )
        except UnicodeDecodeError as error:
            raise undecodable(source, name, error) from error
        except (gzip.BadGzipFile, EOFError) as error:
            raise DataError(f"{name}: damaged gzip file ({error})") from error


def read_all(
    source: Source,
    *,
    declared: Collection[str] = (),
    required: Collection[str] = (),
    by_suffix: bool = True,
    dialect: Dialect = OWN,
) -> Recording:
    """As `read`, the whole file as one recording."""
    return concat(list(read(source, declared=declared, required=required, by_suffix=by_suffix, dialect=dialect)))


@dataclass(frozen=True)
class Absent:
    """A column that a file lacks, and the column of the file that may be it, misspelt ("" where none is near)."""

    column: str
    near: str = ""


def absent_columns(wanted: Iterable[str], order: Collection[str]) -> tuple[Absent, ...]:
    """Those of the wanted columns that are not in the file's header, each with a near match that is not wanted, too."""
    names = list(wanted)
    others = [column for column in order if column not in names]
    folded = {column.casefold(): column for column in reversed(others)}
    found = []
    for column in names:
        if column not in order:
            from difflib import get_close_matches

            near = get_close_matches(column.casefold(), list(folded), n=1, cutoff=0.75)
            found.append(Absent(column, folded[near[0]] if near else ""))
    return tuple(found)


@dataclass(frozen=True)
class _Wanted:
    """What `read` was asked for."""

    numbers: Collection[str]
    required: Collection[str]
    by_suffix: bool
    dialect: Dialect

    def is_number(self, column: str) -> bool:
        return column in self.numbers or (self.by_suffix and is_numeric_column(column))


def _records(stream: Iterable[str], name: str, wanted: _Wanted, chunk_records: int) -> Iterator[Recording]:
    dialect = wanted.dialect
    head, provenance, first = _head(stream, name, dialect.header_line)
    separator = dialect.separator(first, f"{name}:{head + 1}")
    # the header goes through the csv reader too, so that a quoted name may hold a comma or a line end
    reader = csv.reader(chain([first], stream), strict=True, delimiter=separator)
    try:
        order = [unguarded(cell.strip()) for cell in next(reader)]
        if dialect.unit_row:
            next(reader, None)
    except csv.Error as error:
        raise DataError(f"{name}:{head + 1}: {error}") from error
    if len(order) == 1:
        _other_delimiter(first, separator, f"{name}:{head + 1}")
    required = wanted.required
    _check_header(order, required, name, head + 1)
    is_number = [wanted.is_number(cell) for cell in order]
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
        chunk = Recording(
            columns={
                c: _floats(_points(cells[j], dialect.decimal), c, line, name)
                for j, c in enumerate(order)
                if is_number[j]
            },
            text={c: _texts(cells[j]) for j, c in enumerate(order) if not is_number[j]},
            order=tuple(order),
            line=line,
            source=name,
            provenance=tuple(provenance),
        )
        check_clock(chunk)
        yield chunk
        empty = False


def _texts(cells: Sequence[str]) -> Sequence[str]:
    """The cells as they were before `guarded` wrote them, which leaves its mark on few."""
    return [unguarded(cell) for cell in cells] if "'" in "".join(cells) else list(cells)


def _other_delimiter(header: str, separator: str, place: str) -> None:
    """Raises DataError for a header of one column that another delimiter would part."""
    found = separator_of(header)
    if found != separator and found in header:
        word = next(word for word, mark in DELIMITERS.items() if mark == found)
        raise DataError(
            f"{place}: one column, {header.strip()[:60]!r}: cells seem to be parted by {found!r}; state it in a "
            f"recorder, `file: {{delimiter: {word}}}`, which `enginediag recorder FILE` drafts"
        )


def _points(cells: Collection[str], decimal: str) -> Collection[str]:
    """The cells with decimal points; a point in a file with decimal commas is left for `_floats` to refuse."""
    if decimal == ".":
        return cells
    return [cell.replace(".", "\u00b7").replace(",", ".") for cell in cells]


def _head(stream: Iterable[str], name: str, header_line: int) -> tuple[int, list[str], str]:
    """Number of lines before the header, the provenance lines among them, and the header's first line."""
    provenance: list[str] = []
    for number, text in enumerate(stream):
        if header_line:
            if number + 1 == header_line:
                return number, provenance, text.lstrip("\ufeff")
            continue
        bare = text.lstrip("\ufeff").rstrip("\r\n")
        if bare.startswith("#"):
            provenance.append(bare[1:].strip())
        elif bare.strip():
            return number, provenance, text.lstrip("\ufeff")
    if header_line:
        raise DataError(f"{name}: no header line: the file has fewer than {header_line} lines")
    raise DataError(f"{name}: no header line: the file is empty")


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
        from difflib import get_close_matches

        near = get_close_matches(column, order, n=1)
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
