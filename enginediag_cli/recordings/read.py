"""Recordings in, in chunks of constant memory: declared columns as float64, all others as they came.

Nothing is guessed: a column holds numbers because its name carries a unit or because the caller says so. What is read
does not depend on the format, text, Excel or Parquet.

Of each line of a text it is decided whether it is a record: repeated headers and rows of units, comments, footers and
a last line that was cut off are skipped and counted; any other line that does not fit is an error with its place.
"""

from __future__ import annotations

import csv
import gzip
import io
import re
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from datetime import date, datetime, time, timedelta
from itertools import chain, islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.progress import touched
from enginediag_cli.recordings.source import (
    MOST_BLANK_LINES,
    Format,
    PeekedLines,
    Source,
    decoding_error,
    file_format,
    open_lines,
    refuse_devices,
)
from enginediag_cli.recordings.table import (
    DELIMITERS,
    FIXED,
    NATIVE_DIALECT,
    WHITESPACE,
    Dialect,
    ReadingCounts,
    ReadRequest,
    Recording,
    TableFile,
    check_time,
    concat,
    detect_separator,
    is_missing,
    number_error,
    parse_number,
    read_positions,
    rechunk,
)
from enginediag_cli.recordings.write import ParquetTable
from enginediag_cli.safe_text import shortened, unguarded
from enginediag_cli.units import find_unit, is_numeric_column, parse_unit, split_column

_LINE_END = re.compile(r"\r\n|\r|\n")
_SUMMARY = re.compile(r"\W*(total|sum|count|average|avg|mean|median|min(imum)?|max(imum)?|std(dev)?|end)\b", re.I)
"""How a row below a table begins that sums it up."""

CELLS_AT_ONCE = 400_000
"""Cells that are texts in memory at once, some 30 MB, whatever the width of a table."""
CUT = "cut off at the end of the file"
LEAST_LENGTHS = 10
"""Records from which the lengths of a column's numbers are known."""
LEAST_UNITS = 0.6
"""Share of the cells of a row of units that must be known units."""
MOST_FOOTER_LINES = 50
"""Lines at the end of a file that may be no records."""


class TextTable(TableFile):
    """An open text file."""

    def __init__(self, lines: Iterable[str], name: str, source: Source):
        """source: what the lines come from, to find the place of a byte that is no text."""
        self._source, self._text = source, lines
        self.lines = peeked = PeekedLines(lines, name)
        self.name, self.provenance, self.columns = name, peeked.provenance, peeked.columns

    def records(self, asked: ReadRequest, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Raises DataError naming file, physical line and column."""
        try:
            yield from read_text_records(self.lines, self.name, asked, chunk_records, self._cut)
        except UnicodeDecodeError as error:
            raise decoding_error(self._source, self.name, error) from error
        except (gzip.BadGzipFile, EOFError, zlib.error) as error:
            raise DataError(f"{self.name}: damaged gzip file ({error})") from error

    def _cut(self) -> bool:
        return bool(getattr(self._text, "cut", False))


def read_text_records(
    stream: Iterable[str], name: str, asked: ReadRequest, chunk_records: int, cut: Callable[[], bool] = lambda: False
) -> Iterator[Recording]:
    """The records of a text table, see `TableFile.records`. cut: whether the last line has no end, known when it has
    been read. Raises DataError."""
    dialect = asked.dialect
    head, provenance, first = _head(stream, name, dialect)
    place = f"{name}:{head + 1}"
    rows = _RowReader(chain([first], stream), dialect, dialect.separator(first, place), name, head)
    if dialect.names:
        order = [column.strip() for column in dialect.names]
    else:
        order = [unguarded(cell.strip()) for cell in rows.next_row() or []]
        _doubt_header(first, order, rows.separator, asked, place)
    table = _RecordReader(name, asked, order, read_positions(order, asked, place), tuple(provenance), cut)
    if dialect.unit_row and not dialect.names:
        table.check_units(rows.next_row() or [], head + 2)
    at_once = max(1, min(chunk_records, CELLS_AT_ONCE // max(len(order), 1)))
    for chunk in rechunk(_parts(rows, table, at_once), chunk_records):
        check_time(chunk)
        yield chunk


def _parts(rows: _RowReader, table: _RecordReader, at_once: int) -> Iterator[Recording]:
    ended = False
    while not ended:
        raw, ended = rows.take(at_once)
        yield table.read(raw, ended)


Row = tuple[int, list[str]]
"""The physical line on which a row begins, and its cells."""


class _RowReader:
    """Rows of cells of an open text. separator: a delimiter, or a layout."""

    def __init__(self, lines: Iterable[str], dialect: Dialect, separator: str, name: str, head: int):
        self.separator = separator
        self._name, self._line, self._blank = name, head + 1, 0
        if separator == WHITESPACE:
            self._reader: Iterator[list[str]] = (line.split() for line in lines)
        elif separator == FIXED:
            ends = np.cumsum(dialect.widths).tolist()
            spans = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
            self._reader = ([line.rstrip("\r\n")[span].strip() for span in spans] for line in lines)
        else:
            # the header goes through the csv reader too, so that a quoted name may hold a comma or a line end
            self._reader = csv.reader(lines, strict=True, delimiter=separator)

    def next_row(self) -> list[str] | None:
        """The next row, None at the end. Raises DataError for a text that is no row."""
        rows = self._rows(1)
        if rows:
            self._line += _count_lines(rows[0])
        return rows[0] if rows else None

    def _rows(self, most: int) -> list[list[str]]:
        before = getattr(self._reader, "line_num", 0)
        try:
            return list(islice(self._reader, most))
        except csv.Error as error:
            line = self._line - 1 + getattr(self._reader, "line_num", 0) - before
            raise DataError(f"{self._name}:{line}: {error}") from error

    def take(self, most: int) -> tuple[list[Row], bool]:
        """Up to `most` rows but for those that are blank, and whether the text has ended."""
        first, before = self._line, getattr(self._reader, "line_num", 0)
        rows = self._rows(most)
        ended = len(rows) < most
        if getattr(self._reader, "line_num", len(rows)) - before == len(rows) and all(
            row and row[0] and not row[0].isspace() for row in rows
        ):
            self._line, self._blank = first + len(rows), 0
            return list(enumerate(rows, start=first)), ended
        found: list[Row] = []
        for row in rows:  # a blank line, or a line end in a quoted cell
            if any(cell and not cell.isspace() for cell in row):
                found.append((self._line, row))
                self._blank = 0
            else:
                self._blank += 1
            self._line += _count_lines(row)
        if self._blank > MOST_BLANK_LINES:
            raise DataError(f"{self._name}:{self._line}: {self._blank} blank lines in a row; is it a table?")
        return found, ended


def _count_lines(row: Sequence[str]) -> int:
    """Physical lines of a row: a line end is one in a quoted cell, or ends it."""
    return 1 + sum(len(_LINE_END.findall(cell)) for cell in row if "\n" in cell or "\r" in cell)


@dataclass
class _RecordReader:
    """The records of one file. order: its columns; positions: of those that are read; held: rows that are no records,
    and what is wrong with them, until it is known whether they end the file; header: line of the last header that was
    repeated; shortest: characters of the shortest number in the last column."""

    name: str
    asked: ReadRequest
    order: Sequence[str]
    positions: Sequence[int]
    provenance: tuple[str, ...]
    cut: Callable[[], bool]
    held: list[tuple[Row, DataError]] = field(default_factory=list)
    records: int = 0
    header: int = 0
    shortest: int = 1 << 30

    def __post_init__(self) -> None:
        asked = self.asked
        self.form = asked.dialect
        self.numbers = [j for j in self.positions if asked.is_number(self.order[j])]
        self.stamps = [j for j in self.positions if self.order[j] in asked.stamps]
        named = [j for j, column in enumerate(self.order) if column]
        self.least = named[-1] + 1 if named else 0  # the columns behind have no name, and need not be there

    def read(self, rows: list[Row], ended: bool) -> Recording:
        """The records of these rows, which may be none. Raises DataError for one that is neither record nor footer."""
        width = len(self.order)
        wrong: list[tuple[Row, DataError]] = []
        if not all(map(width.__eq__, (len(cells) for _, cells in rows))):
            rows, wrong = self._fitted(rows)
        if rows and self._ends_within_a_number(rows, ended):
            self.asked.counts.skip_line(CUT, rows.pop()[0])
        chunk, bad = self._columns(rows)
        wrong += [(rows[k], error) for k, error in bad.items()]
        if wrong or self.held:
            keep = np.ones(len(rows), bool)
            keep[list(bad)] = False
            self._judge(sorted(wrong, key=lambda item: item[0][0]), chunk.line[keep], ended)
            chunk = chunk.select(keep) if bad else chunk
        self.records += len(chunk)
        return chunk

    def _ends_within_a_number(self, rows: list[Row], ended: bool) -> bool:
        """Whether the last row ends the file without a line end, in a number that is shorter than all before it."""
        last = len(self.order) - 1
        if last not in self.numbers:
            return False
        lengths = [len(cells[last].strip()) for _, cells in rows]
        cut = ended and self.cut()
        before = min([self.shortest, *(lengths[:-1] if cut else lengths)])
        self.shortest = before
        return cut and self.records + len(rows) > LEAST_LENGTHS and lengths[-1] < before

    def _fitted(self, rows: list[Row]) -> tuple[list[Row], list[tuple[Row, DataError]]]:
        """Rows as wide as the header, but for columns without a name at its end and empty cells behind it; others, with
        what is wrong."""
        width = len(self.order)
        fitting: list[Row] = []
        wrong: list[tuple[Row, DataError]] = []
        for line, cells in rows:
            n = len(cells)
            if n > width and not any(cell.strip() for cell in cells[width:]):
                cells = cells[:width]
            elif self.least <= n < width:
                cells = cells + [""] * (width - n)
            if len(cells) == width:
                fitting.append((line, cells))
            else:
                shown = ",".join(cells[:4]) + (",…" if n > 4 else "")
                owner = "`names`" if self.asked.dialect.names else "the header"
                what = f"{n} fields where {owner} has {width}: {shortened(shown)}"
                wrong.append(((line, cells), DataError(f"{self.name}:{line}: {what}")))
        return fitting, wrong

    def _columns(self, rows: list[Row]) -> tuple[Recording, dict[int, DataError]]:
        """All rows (of one width) as records, and by index those in which a number or a stamp is none."""
        lines = np.array([line for line, _ in rows], dtype=np.int64)
        cells: list[tuple[str, ...]] = list(zip(*(c for _, c in rows), strict=True)) if rows else [()] * len(self.order)
        bad: dict[int, DataError] = {}
        columns: dict[str, np.ndarray] = {}
        words = []
        for j in self.numbers:
            column = self.order[j]
            columns[column], wrong, counts = self.form.numbers(cells[j])
            words.append((column, counts))
            for k in wrong:
                bad.setdefault(k, number_error(cells[j][k], f"{self.name}:{lines[k]}:{column}"))
        for j in self.stamps:
            for k, cell in enumerate(cells[j]):
                if not any(c.isdigit() for c in cell) and not is_missing(cell):
                    what = f"{self.name}:{lines[k]}:{self.order[j]}: not a time stamp: {shortened(cell)!r}"
                    bad.setdefault(k, DataError(what))
        for column, counts in words:
            self.asked.counts.count_missing(column, counts)
        text = {self.order[j]: _texts(cells[j]) for j in self.positions if self.order[j] not in columns}
        order = tuple(self.order[j] for j in self.positions)
        return Recording(columns, text, order, lines, self.name, self.provenance), bad

    def _judge(self, wrong: list[tuple[Row, DataError]], good: np.ndarray, ended: bool) -> None:
        """Count the rows that are no records where they may stand where they do; `good`: lines of the records here.
        Raises the error of one that may not."""
        counts, held = self.asked.counts, self.held
        for row, error in wrong:
            line, cells = row
            first = not self.records and not (good.size and good[0] < line)
            kind = self._kind(cells, line, first)
            if kind or self.asked.tolerant:
                counts.skip_line(kind or "unreadable", line)
            elif first:
                raise error
            else:
                held.append((row, error))
        if held and (len(held) > MOST_FOOTER_LINES or (good.size and good[-1] > held[0][0][0])):
            raise held[0][1]
        for k, ((line, cells), error) in enumerate(held if ended else ()):
            if not self._like_a_record(cells):
                counts.skip_line("footer", line)
            elif self.cut() and k == len(held) - 1 and len(cells) <= len(self.order):
                counts.skip_line(CUT, line)
            else:
                raise error

    def _kind(self, cells: Sequence[str], line: int, first: bool) -> str:
        """What a row is that is no record, wherever it stands, or "". Raises DataError for a row of units that are not
        those of the columns' names. first: no record stands before it."""
        bare = [cell.strip() for cell in cells]
        if [unguarded(cell) for cell in bare] == list(self.order):
            self.header = line
            return "repeated header"
        if bare[0].startswith("#") and not is_missing(bare[0]):
            return "comment"
        if (first or line == self.header + 1) and self._units(bare, line):
            self.header = line
            return "row of units"
        return ""

    def _units(self, cells: Sequence[str], line: int) -> bool:
        """Whether a row holds the units of the columns of numbers, or most of them."""
        named = [cells[j] for j in self.numbers if j < len(cells) and not is_missing(cells[j])]
        known = sum(parse_unit(cell) is not None for cell in named)
        if not named or known < LEAST_UNITS * len(named) or any(parse_number(cell) is not None for cell in named):
            return False
        self.check_units(cells, line)
        return True

    def check_units(self, cells: Sequence[str], line: int) -> None:
        """Hold a row of units against those that the columns are taken for. Raises DataError where a name says another
        one; another one than the recorder's is a doubt, which its author may have had a reason for."""
        for j in self.numbers:
            column, word = self.order[j], parse_unit(cells[j]) if j < len(cells) else None
            named = split_column(column)[1] if self.asked.by_suffix else ""
            stated = named or self.asked.units.get(column, "")
            if word is None or not stated:
                continue
            same = (find_unit(stated).name, 1.0) == (word.unit, word.scale)
            what = f"the row of units says {cells[j].strip()}, "
            if named and (not same or word.gauge):
                what += f"the column's name {named}; state in a recorder which of them it is"
                raise DataError(f"{self.name}:{line}:{column}: {what}")
            doubt, doubts = f"{column}: {what}the recorder {stated}", self.asked.counts.doubts
            if not same and doubt not in doubts:
                doubts.append(doubt)

    def _like_a_record(self, cells: Sequence[str]) -> bool:
        """Whether a row holds numbers where a record does, or is as wide and begins with a digit, and does not begin as
        a summary."""
        first = next((cell.strip() for cell in cells if cell.strip()), "")
        if _SUMMARY.match(first):
            return False
        if len(cells) == len(self.order) and first[:1].isdigit():
            return True
        values, _, _ = self.form.numbers([cells[j] for j in self.numbers if j < len(cells)])
        return bool(np.isfinite(values).any())


def _texts(cells: Sequence[str]) -> Sequence[str]:
    """The cells as they were before `guarded` wrote them, which leaves its mark on few."""
    return [unguarded(cell) for cell in cells] if "'" in "".join(cells) else list(cells)


def _doubt_header(header: str, order: Sequence[str], separator: str, asked: ReadRequest, place: str) -> None:
    """Raises DataError for a header of one column that another delimiter would part, and for one of numbers."""
    if any(column in asked.numbers for column in order):
        return
    words = header.split()
    if all(parse_number(cell) is not None for cell in (words if len(order) == 1 else order) if cell):
        layout = "delimiter: whitespace, " if len(order) == 1 and len(words) > 1 else ""
        raise DataError(
            f"{place}: numbers where a header should name the columns: {shortened(header.strip())!r}; if the file has "
            f"no header, a recorder names them: `file: {{{layout}header: none, names: [...]}}`"
        )
    if len(order) > 1:
        return
    found, word = detect_separator(header), ""
    if found != separator and found in header:
        word = next(word for word, mark in DELIMITERS.items() if mark == found)
    elif len(words) > 1 and any(map(is_numeric_column, words)):
        found, word = "blanks", WHITESPACE
    if word:
        raise DataError(
            f"{place}: one column, {shortened(header.strip())!r}: cells seem to be parted by {found!r}; state it in a "
            f"recorder, `file: {{delimiter: {word}}}`, which `enginediag recorder FILE` drafts"
        )


def _head(stream: Iterable[str], name: str, dialect: Dialect) -> tuple[int, list[str], str]:
    """Number of lines before the header (before the first record, where there is none), the provenance lines among
    them, and its first line."""
    provenance: list[str] = []
    stated, what = dialect.header_line, "record" if dialect.names else "header line"
    for number, text in enumerate(stream):
        if stated:
            if number + 1 == stated:
                return number, provenance, text.lstrip("\ufeff")
            continue
        bare = text.lstrip("\ufeff").rstrip("\r\n")
        if bare.startswith("#"):
            provenance.append(bare[1:].strip())
        elif bare.strip():
            return number, provenance, text.lstrip("\ufeff")
        if number > MOST_BLANK_LINES:
            raise DataError(f"{name}: no {what} in the first {MOST_BLANK_LINES} lines; is it a table?")
    if stated:
        raise DataError(f"{name}: no {what}: the file has fewer than {stated} lines")
    raise DataError(f"{name}: no {what}: the file is empty")


MOST_TEXT_BYTES = 500_000_000
"""Unpacked size of a workbook's texts, which are in memory at once."""
MOST_BYTES = 20_000_000_000
"""Unpacked size of a workbook: a full sheet of a million rows and a thousand columns."""


class ExcelTable(TableFile):
    """An open workbook. The line of a record is the row of the sheet."""

    def __init__(self, path: str | Path, sheet: str = ""):
        """sheet: its name; the first if empty. Raises DataError: no openpyxl, damaged, too large, no such sheet."""
        refuse_devices(path)
        self.name = str(path)
        try:
            import openpyxl
        except ImportError as error:
            raise DataError(
                f"{path}: an Excel workbook needs openpyxl, which is not installed ({error}): "
                "pip install 'enginediag[excel]', or save it as CSV"
            ) from None
        self._refuse_bombs()
        with self._readable():
            self._book = openpyxl.load_workbook(path, read_only=True, data_only=True, keep_links=False)
            names = self._book.sheetnames
        if sheet and sheet not in names:
            raise DataError(f"{path}: no sheet {sheet!r}; there are {', '.join(names)}")
        self._sheet = sheet or names[0]
        self.lines = peeked = PeekedLines(self._text(","), self.name)
        self.provenance, self.columns = peeked.provenance, peeked.columns

    def close(self) -> None:
        self._book.close()

    def records(self, asked: ReadRequest, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Numbers are written as the dialect says, which their cells do not depend on."""
        written = replace(asked.dialect, delimiter="\t", widths=(), encoding=NATIVE_DIALECT.encoding)
        rows = self._text("\t", asked.dialect.decimal)
        yield from read_text_records(rows, self.name, replace(asked, dialect=written), chunk_records)

    def _text(self, delimiter: str, decimal: str = ".") -> Iterator[str]:
        """The rows as lines of text."""
        with self._readable():
            for row in self._book[self._sheet].iter_rows(values_only=True):
                line = io.StringIO()
                csv.writer(line, delimiter=delimiter, lineterminator="\n").writerow(
                    _cell_text(cell, decimal) for cell in row
                )
                yield line.getvalue()

    def _refuse_bombs(self) -> None:
        with self._readable(), zipfile.ZipFile(self.name) as archive:
            sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
        texts = sizes.get("xl/sharedStrings.xml", 0)
        if texts > MOST_TEXT_BYTES or sum(sizes.values()) > MOST_BYTES:
            told = f"{max(texts, sum(sizes.values())) / 1e6:.0f} MB when unpacked"
            raise DataError(f"{self.name}: a workbook of {told}, which is not read; save the sheet as CSV")

    @contextmanager
    def _readable(self) -> Iterator[None]:
        """Errors of a damaged workbook, with its name."""
        try:
            yield
        except DataError:
            raise
        except (OSError, zipfile.BadZipFile, KeyError, ValueError, SyntaxError, TypeError, AttributeError) as error:
            first = (str(error).splitlines() or [""])[0]
            raise DataError(f"{self.name}: a damaged Excel workbook ({first}); save it anew, or as CSV") from error


def _cell_text(cell: Any, decimal: str) -> str:
    """A cell as CSV has it: stamps as ISO 8601, midnight as a date alone, durations in seconds."""
    if cell is None:
        return ""
    if isinstance(cell, (bool, int)):
        return str(int(cell))
    if isinstance(cell, float):
        return repr(cell).removesuffix(".0").replace(".", decimal)
    if isinstance(cell, datetime):
        return cell.date().isoformat() if cell.time() == time() else cell.isoformat(" ")
    if isinstance(cell, timedelta):
        return repr(cell.total_seconds()).replace(".", decimal)
    if isinstance(cell, (date, time)):
        return cell.isoformat()
    return " ".join(str(cell).splitlines())


@contextmanager
def open_table(source: Source, codec: str = "utf-8-sig", sheet: str = "") -> Iterator[TableFile]:
    """Open a table in the format of its first bytes or its name; anything else is read as text.

    Parameters
    ----------
    source : path (`-` is stdin, `.gz` is unpacked) or an open text stream
    codec : encoding of a text
    sheet : of a workbook; the first if empty

    Raises
    ------
    DataError
        The file cannot be opened, or is no table.
    """
    kind = file_format(source)
    if kind is Format.TEXT:
        with open_lines(source, codec) as (stream, name):
            yield TextTable(stream, name, source)
        return
    assert isinstance(source, (str, Path))
    with closing(ExcelTable(source, sheet) if kind is Format.EXCEL else ParquetTable(source)) as table:
        yield table


def read(
    source: Source | TableFile,
    *,
    declared: Collection[str] = (),
    required: Collection[str] = (),
    by_suffix: bool = True,
    chunk_records: int = 20_000,
    dialect: Dialect = NATIVE_DIALECT,
    texts: Collection[str] | None = None,
    stamps: Collection[str] = (),
    units: Mapping[str, str] = MappingProxyType({}),
    tolerant: bool = False,
    counts: ReadingCounts | None = None,
) -> Iterator[Recording]:
    """Yield the records of a file in chunks; a file without records yields one empty recording.

    Numbers are the columns of `declared` and `required` (but for those of `texts`) and, with `by_suffix`, those whose
    name carries a unit. The rest is text.

    Parameters
    ----------
    source : path (`-` is stdin, `.gz` is unpacked), open text stream, or an open table
    declared : columns of numbers
    required : columns that must be there
    by_suffix : whether columns with a unit in their name are numbers
    chunk_records : records of a chunk
    dialect : how a text is written
    texts : the only columns of text to read; None for all
    stamps : columns of text with a time in every record
    units : column → unit, for names that do not say it
    tolerant : skip lines that are no records, as in a file that is still being written
    counts : takes what was skipped, and what stood for a missing value

    Raises
    ------
    DataError
        Names file, physical line (row, in Parquet) and column.
    """
    numbers = {*declared, *required} - set(texts or ())
    asked = ReadRequest(
        numbers, required, by_suffix, dialect, texts, stamps, units, tolerant, counts or ReadingCounts()
    )
    with (
        nullcontext(source) if isinstance(source, TableFile) else open_table(source, dialect.codec, dialect.sheet) as t
    ):
        touched("read:", t.name)
        yield from t.records(asked, chunk_records)


def read_all(source: Source, **how: Any) -> Recording:
    """As `read`, with its keywords, the whole file as one recording."""
    return concat(list(read(source, **how)))
