"""CSV in, in chunks of constant memory: declared columns as float64, all others as they came.

Nothing is guessed: a column holds numbers because its name carries a unit or because the caller says so.
"""

from __future__ import annotations

import csv
import gzip
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, islice
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.dialect import DELIMITERS, separator_of
from enginediag_cli.recordings.formats.base import Asked, TableFile, check_header
from enginediag_cli.recordings.formats.cells import floats, points
from enginediag_cli.recordings.peeked import Peeked
from enginediag_cli.recordings.source import Source, undecodable
from enginediag_cli.recordings.table import Recording, check_clock
from enginediag_cli.safe_text import unguarded

_LINE_END = re.compile(r"\r\n|\r|\n")


class CsvTable(TableFile):
    """An open text file."""

    def __init__(self, lines: Iterable[str], name: str, source: Source):
        """source: what the lines come from, to find the place of a byte that is no text."""
        self._source = source
        self.lines = peeked = Peeked(lines, name)
        self.name, self.provenance, self.columns = name, peeked.provenance, peeked.columns

    def records(self, asked: Asked, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Raises DataError naming file, physical line and column."""
        try:
            yield from _records(self.lines, self.name, asked, chunk_records)
        except UnicodeDecodeError as error:
            raise undecodable(self._source, self.name, error) from error
        except (gzip.BadGzipFile, EOFError) as error:
            raise DataError(f"{self.name}: damaged gzip file ({error})") from error


def _records(stream: Iterable[str], name: str, asked: Asked, chunk_records: int) -> Iterator[Recording]:
    dialect = asked.dialect
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
    check_header(order, asked.required, f"{name}:{head + 1}")
    is_number = [asked.is_number(cell) for cell in order]
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
                c: floats(points(cells[j], dialect.decimal), _place(name, line, c))
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


def _place(name: str, line: np.ndarray, column: str) -> Callable[[int], str]:
    return lambda k: f"{name}:{line[k]}:{column}"
