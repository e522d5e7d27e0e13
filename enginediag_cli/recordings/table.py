"""A recording as a table in memory, and how tables in files are written and read, whatever the format.

`Recording` holds columns of numbers and everything else as it came. A `Dialect` says how a text table is written
(delimiter, encoding, number format, words for a missing value); `TableFile` and `RecordingWriter` are the interface of
an open file and of a writer; `ReadingCounts` counts what was skipped.
"""

from __future__ import annotations

import codecs
import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import groupby

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.safe_text import shortened
from enginediag_cli.units import is_numeric_column

Rows = slice | np.ndarray

LATEST = 1e13
"""Seconds, 300,000 years, beyond which a number is no time: an epoch in milliseconds stays below, and so does the
square of a difference far below overflow."""


@dataclass(frozen=True)
class Recording:
    """N records in file order.

    columns: name → (N,) float64, NaN where missing; text: name → N strings, passed through untouched;
    order: all column names as they are to be written; line: (N,) physical line of each record in `source`,
    0 where it has none; provenance: the `#` lines of the file's head, without the `#`.
    """

    columns: Mapping[str, np.ndarray]
    text: Mapping[str, Sequence[str]] = field(default_factory=dict)
    order: tuple[str, ...] = ()
    line: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    source: str = ""
    provenance: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.order:
            object.__setattr__(self, "order", (*self.columns, *self.text))
        sizes = {len(values) for values in (*self.columns.values(), *self.text.values())}
        if len(sizes) > 1:
            raise ValueError(f"columns of different lengths: {sorted(sizes)}")
        if set(self.order) != {*self.columns, *self.text}:
            raise ValueError("the order of columns does not name each column once")
        size = sizes.pop() if sizes else 0
        if len(self.line) != size:
            object.__setattr__(self, "line", np.zeros(size, dtype=np.int64))

    def __len__(self) -> int:
        return len(self.line)

    def __getitem__(self, column: str) -> np.ndarray:
        return self.columns[column]

    def __contains__(self, column: object) -> bool:
        return column in self.columns

    def select(self, rows: Rows) -> Recording:
        """The records picked by a slice, a boolean mask (N,) or an index array."""
        index = np.arange(len(self))[rows]
        picked = index.tolist()
        return replace(
            self,
            columns={name: values[index] for name, values in self.columns.items()},
            text={name: [values[k] for k in picked] for name, values in self.text.items()},
            line=self.line[index],
        )

    def with_columns(self, columns: Mapping[str, np.ndarray]) -> Recording:
        """The same records with columns (N,) added at the end, or replaced in place."""
        new = {name: np.asarray(values, dtype=float) for name, values in columns.items()}
        return replace(
            self,
            columns={**self.columns, **new},
            text={name: values for name, values in self.text.items() if name not in new},
            order=(*self.order, *(name for name in new if name not in self.order)),
        )


def concat(recordings: Sequence[Recording]) -> Recording:
    """Join recordings of the same columns; line numbers and provenance are those of each part.

    Parameters
    ----------
    recordings : sequence of Recording

    Returns
    -------
    Recording
        All records in turn.

    Raises
    ------
    DataError
        If the recordings do not have the same columns.
    """
    if not recordings:
        raise ValueError("nothing to concatenate")
    first = recordings[0]
    for other in recordings[1:]:
        if set(other.columns) != set(first.columns) or set(other.text) != set(first.text):
            odd = sorted(set(other.order) ^ set(first.order)) or ["(numbers in one, text in the other)"]
            raise DataError(f"{other.source}: its columns differ from those of {first.source}: {', '.join(odd)}")
    if len(recordings) == 1:
        return first
    return Recording(
        columns={name: np.concatenate([part.columns[name] for part in recordings]) for name in first.columns},
        text={name: [cell for part in recordings for cell in part.text[name]] for name in first.text},
        order=first.order,
        line=np.concatenate([part.line for part in recordings]),
        source=" + ".join(dict.fromkeys(part.source for part in recordings)),
        provenance=tuple(dict.fromkeys(note for part in recordings for note in part.provenance)),
    )


def rechunk(recordings: Iterable[Recording], chunk_records: int) -> Iterator[Recording]:
    """The same records in chunks of exactly so many, the last of fewer; of no records one empty recording."""
    waiting: list[Recording] = []
    given = False
    for recording in recordings:
        waiting.append(recording)
        if sum(map(len, waiting)) < chunk_records:
            continue
        whole = concat(waiting)
        full = len(whole) - len(whole) % chunk_records
        for start in range(0, full, chunk_records):
            yield whole.select(slice(start, start + chunk_records))
        waiting, given = [whole.select(slice(full, None))], True
    if waiting and (not given or sum(map(len, waiting))):
        yield concat(waiting)


def check_time(recording: Recording) -> None:
    """Raises DataError with the line of the first time_s that cannot be a time."""
    if "time_s" not in recording:
        return
    time = recording["time_s"]
    wrong = np.flatnonzero(np.isfinite(time) & (np.abs(time) > LATEST))
    if wrong.size:
        k = int(wrong[0])
        raise DataError(f"{recording.source}:{recording.line[k]}:time_s: {time[k]:g} s cannot be a time")


KEYS = ("flight", "engine")
"""Columns that distinguish recordings of one file, where the file has them."""


@dataclass
class FlightNumbers:
    """Numbers the (flight, engine) pairs of a file in order of first appearance, over all its chunks."""

    known: dict[tuple[str, ...], int] = field(default_factory=dict)

    def numbers(self, recording: Recording) -> np.ndarray:
        """(N,) int64: the number of each record's flight and engine."""
        labels = []
        for column in KEYS:
            if column in recording.text:
                labels.append(list(recording.text[column]))
            elif column in recording.columns:
                labels.append([f"{value:g}" for value in recording.columns[column]])
        n = len(recording)
        if not n or all(cells.count(cells[0]) == n for cells in labels):
            key = tuple(cells[0] for cells in labels) if n else ()
            number = self.known.setdefault(key, len(self.known)) if n else 0
            return np.full(n, number, dtype=np.int64)
        known, numbers, lengths = self.known, [], []
        for key, same in groupby(zip(*labels, strict=True)):  # records of a flight mostly follow each other
            numbers.append(known.setdefault(key, len(known)))
            lengths.append(len(list(same)))
        return np.repeat(np.array(numbers, dtype=np.int64), lengths)


DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|"}
"""Names of the delimiters that `auto` looks for, and the characters."""


WHITESPACE, FIXED = "whitespace", "fixed"


LAYOUTS = (WHITESPACE, FIXED)
"""Columns without a delimiter: parted by any number of blanks, or each so many characters wide."""


THOUSANDS = {"comma": ",", "point": ".", "space": " ", "apostrophe": "'"}
"""Names of the marks between groups of three digits; a space is any kind of space, an apostrophe also a typographic
one."""


EMPTY = frozenset({"", "na", "n/a", "nan", "null", "none"})
"""Cells that stand for a missing value and need no word about it, in any case."""

MISSING = EMPTY | frozenset(
    word
    for line in (
        "- -- --- — – ? nil n.a. #n/a #na #value! #ref! #div/0! #num! #name? #null! 1.#qnan -1.#qnan 1.#ind -1.#ind",
        "bad|bad data|bad input|bad quality|bad total|no data|nodata|no good data|no value|no result|no sample|missing",
        "i/o timeout|io timeout|i/o time-out|timeout|scan timeout|scan off|comm fail|comm failure|comm error",
        "communication failure|not connected|disconnected|offline|off-line|out of service|out of serv|shutdown",
        "shut down|intf shut|interface shut|pt created|point created|configure|over range|under range|overrange",
        "underrange|inp fail|input fail|input failure|sensor fail|sensor failure|calc failed|calc fail|calc off",
        "calc crash|bad_quality|not available|not avail|unavailable|invalid|invalid data|invalid float|undefined|undef",
        "error|err|failed|fail|fault|unknown|stale|arc off-line|arc offline|access denied|no access|no lab data",
    )
    for word in (line.split("|") if "|" in line else line.split())
)
"""Those, and the words of plant historians, spreadsheets and C libraries (PI digital states, Excel errors, printf)."""

_CODED = re.compile(r"\*+|\[-\d+\].*")
"""Asterisks that fill a field whose number is too wide (Fortran), and a historian's error number with its text."""

_SPACES = re.compile("[\u00a0\u2007\u2009\u202f]")
"""Spaces that do not break, between groups of digits."""


def is_missing(cell: str) -> bool:
    """Whether a cell stands for a missing value in any recording."""
    bare = cell.strip().lower()
    return bare in MISSING or _CODED.fullmatch(bare) is not None


@dataclass(frozen=True)
class Dialect:
    """How a text table is written.

    delimiter: one character; "auto": the one of DELIMITERS that the header has most of, outside quotes; or one of
    LAYOUTS. decimal: "." or ",". header_line: physical line of the header; 0: the first line that is neither blank nor
    begins with #. unit_row: a row of units follows the header. names: columns of a file without a header, "" for one
    that is not read. widths: characters of each column where they are fixed. thousands: a mark of THOUSANDS, or "".
    missing: further words for a missing value, in any case, or numbers that stand for one. sheet: of a workbook.
    """

    delimiter: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    header_line: int = 0
    unit_row: bool = False
    names: tuple[str, ...] = ()
    widths: tuple[int, ...] = ()
    thousands: str = ""
    missing: tuple[str, ...] = ()
    sheet: str = ""

    @property
    def codec(self) -> str:
        """The encoding to open a file with; a byte order mark is no part of UTF-8 text."""
        return "utf-8-sig" if codecs.lookup(self.encoding).name == "utf-8" else self.encoding

    def separator(self, header: str, place: str) -> str:
        """The character between cells (detected in this header line where it is not stated), or one of LAYOUTS.

        Raises DataError when the decimal mark and the delimiter are the same.
        """
        found = detect_separator(header) if self.delimiter == "auto" else self.delimiter
        if found == self.decimal:
            raise DataError(f"{place}: the decimal mark and the delimiter are both '{found}'; state another delimiter")
        return found

    @cached_property
    def _missing_words(self) -> frozenset[str]:
        return MISSING | {word.strip().lower() for word in self.missing}

    @cached_property
    def _missing_numbers(self) -> np.ndarray:
        """(K,) numbers that stand for a missing value, as -9999 does."""
        return np.array([value for word in self.missing if (value := parse_number(word)) is not None])

    @cached_property
    def _grouped(self) -> re.Pattern[str]:
        mark, point = re.escape(self.thousands), re.escape(self.decimal)
        return re.compile(rf"\s*[-+]?\d{{1,3}}(?:{mark}\d{{3}})+(?:{point}\d*)?\s*")

    def numbers(self, cells: Sequence[str]) -> tuple[np.ndarray, list[int], Counter[str]]:
        """The numbers in a column's cells. Slow only where a cell is no number.

        Parameters
        ----------
        cells : N texts

        Returns
        -------
        values : (N,) float64, NaN where missing
        bad : indices of the cells that are no number
        counts : how often each word or number stood for a missing value, those of EMPTY not counted
        """
        bad: list[int] = []
        counts: Counter[str] = Counter()
        plain = self._plain(cells)
        try:
            values = np.fromiter(map(float, plain), dtype=float, count=len(cells))
        except ValueError:
            values = np.empty(len(cells))
            for k, cell in enumerate(plain):
                number = parse_number(cell)
                values[k] = np.nan if number is None else number
                bare = cells[k].strip().lower()
                if number is not None or bare in EMPTY:
                    continue
                if bare in self._missing_words or _CODED.fullmatch(bare):
                    counts[shortened(cells[k].strip())] += 1
                else:
                    bad.append(k)
        if "_" in "".join(cells):  # float() reads 1_000 as a thousand; a recorder that writes it has lost a digit
            bad = sorted({*bad, *(k for k, cell in enumerate(cells) if "_" in cell and parse_number(cell) is not None)})
        if self._missing_numbers.size:
            coded = np.isin(values, self._missing_numbers)
            counts.update(f"{value:g}" for value in values[coded])
            values[coded] = np.nan
        return values, bad, counts

    def _plain(self, cells: Sequence[str]) -> Sequence[str]:
        """The cells with decimal points and without thousands marks. A mark in a wrong place, or a point where decimals
        have commas, stays no number."""
        if self.thousands:
            cells = [self._ungrouped(cell) for cell in cells]
        if self.decimal == ",":
            return [cell.replace(".", "\u00b7").replace(",", ".") for cell in cells]
        return cells

    def _ungrouped(self, cell: str) -> str:
        if self.thousands == " ":
            cell = _SPACES.sub(" ", cell)
        elif self.thousands == "'":
            cell = cell.replace("\u2019", "'")
        if self.thousands not in cell.strip():
            return cell
        return cell.replace(self.thousands, "") if self._grouped.fullmatch(cell) else cell + "\u00b7"


NATIVE_DIALECT = Dialect()
"""Files of this program: commas, decimal points, UTF-8, the header first."""


def detect_separator(header: str) -> str:
    """The delimiter that a header line has most of, outside quotes; a comma where it has none."""
    bare = "".join(header.split('"')[::2])
    return max(DELIMITERS.values(), key=bare.count) if any(map(bare.count, DELIMITERS.values())) else ","


def is_encoding(name: str) -> bool:
    """Whether Python has a text codec of this name."""
    try:
        return bool(codecs.lookup(name)._is_text_encoding)
    except LookupError:
        return False


def number_error(cell: str, place: str) -> DataError:
    """The error for a cell that is no number, with the key of a recorder that may make it one."""
    bare = _SPACES.sub(" ", cell.strip())
    hint = ""
    if re.fullmatch(r"[-+]?\d+,\d+", bare) and not re.fullmatch(r"[-+]?\d{1,3},\d{3}", bare):
        hint = "decimal: comma"
    elif found := re.fullmatch(r"[-+]?\d{1,3}(?:([, '])\d{3})(?:\1\d{3})*(?:\.\d*)?", bare):
        hint = "thousands: " + {",": "comma", " ": "space", "'": "apostrophe"}[found[1]]
    elif re.fullmatch(r"[A-Za-z#*?!/ .-]{1,30}", bare):
        hint = f'missing: ["{bare}"]'
    told = f"; if it stands for one, or for a missing one, a recorder says how: `file: {{{hint}}}`" if hint else ""
    return DataError(f"{place}: not a number: {shortened(cell)!r}{told}")


def parse_number(cell: str) -> float | None:
    """A cell as a number, or None; a typographic minus sign is one."""
    try:
        return float(cell)
    except ValueError:
        pass
    try:
        return float(cell.replace("\u2212", "-")) if "\u2212" in cell else None
    except ValueError:
        return None


SHOWN_WORDS = 5
"""Words of a column, or columns, that a message lists."""
MOST_COLUMNS = 20_000
"""Columns of a table; a workbook has at most 16,384."""


@dataclass
class ReadingCounts:
    """What of a file was read as no record or no reading. lines: kind ("repeated header", "footer", …) → lines passed
    over, their number and the first of them; words: column → word or number → cells in which it stood for a missing
    value; unread: columns without a name of their own, which nobody asked for; doubts: where the file's own row of
    units says something else than the recorder."""

    lines: dict[str, list[int]] = field(default_factory=dict)
    words: dict[str, dict[str, int]] = field(default_factory=dict)
    unread: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)

    def skip_line(self, kind: str, line: int) -> None:
        """Count a line that holds no record."""
        self.lines.setdefault(kind, [0, line])[0] += 1

    def count_missing(self, column: str, counts: Mapping[str, int]) -> None:
        """Count cells of a column that stood for a missing value."""
        known = self.words.setdefault(column, {}) if counts else {}
        for word, n in counts.items():
            known[word] = known.get(word, 0) + n

    def report_lines(self) -> list[str]:
        """One sentence for each column with such words, each kind of line and all columns that were not read."""
        found = list(self.doubts)
        for column, words in self.words.items():
            most, total = sorted(words, key=lambda word: -words[word]), sum(words.values())
            shown = ", ".join(f"{word!r} {words[word]}" for word in most[:SHOWN_WORDS])
            more = f" and {len(most) - SHOWN_WORDS} other words" if len(most) > SHOWN_WORDS else ""
            found.append(f"{column}: {total} cell{'s' * (total > 1)} taken as missing ({shown}{more})")
        for kind, (n, first) in self.lines.items():
            where = f"line {first} is" if n == 1 else f"{n} lines, line {first} the first, are"
            found.append(f"{where} passed over: {kind}")
        if self.unread:
            found.append(f"not read: {', '.join(self.unread[:SHOWN_WORDS])}")
        return found


@dataclass(frozen=True)
class ReadRequest:
    """What a reader wants of a table. numbers: columns that hold numbers whatever their names say, and with
    `by_suffix` so do those whose name carries a unit; required: columns that must be there, also those of `texts`;
    dialect: how texts are written; texts: the only columns of text wanted, None for all; stamps: those of them that
    hold a time in every record; units: column → unit that its numbers are taken for, where its name does not say;
    tolerant: lines that are no records are passed over wherever they stand; counts: what was read as no record or no
    reading."""

    numbers: Collection[str]
    required: Collection[str] = ()
    by_suffix: bool = True
    dialect: Dialect = NATIVE_DIALECT
    texts: Collection[str] | None = None
    stamps: Collection[str] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    tolerant: bool = False
    counts: ReadingCounts = field(default_factory=ReadingCounts)

    def is_number(self, column: str) -> bool:
        return column in self.numbers or (self.by_suffix and is_numeric_column(column))

    def is_read(self, column: str) -> bool:
        """Whether a column is read where there is one of this name."""
        return self.texts is None or column in self.texts or self.is_number(column)

    def must_be_unique(self, column: str) -> bool:
        """Whether it matters which of two columns of this name is read."""
        if column in self.numbers or column in (self.texts or ()) or column in KEYS:
            return True
        return not self.numbers and self.is_number(column)


class TableFile(ABC):
    """An open file. name: as errors call it; provenance: the `#` lines of its head, without the `#`; columns: the
    names in its header; lines: the whole as lines of CSV. One of `lines` and `records` can be read, and once."""

    name: str
    provenance: Sequence[str]
    columns: tuple[str, ...]
    lines: Iterable[str]

    @abstractmethod
    def records(self, asked: ReadRequest, chunk_records: int) -> Iterator[Recording]:
        """Chunks of exactly so many records, the last of fewer; one empty recording of a file without records."""


class RecordingWriter(ABC):
    """Writes recordings with the same columns, one after the other; `write` may be called once the head is known."""

    _order: tuple[str, ...] | None = None

    def write(self, recording: Recording) -> None:
        """Append the records (N,). Raises DataError when the columns are not those of the first call."""
        if self._order is None:
            self._begin(recording)
            self._order = recording.order
        elif set(recording.order) != set(self._order):
            odd = ", ".join(sorted(set(recording.order) ^ set(self._order)))
            raise DataError(f"{recording.source}: its columns differ from those already written: {odd}")
        self._append(recording)

    @abstractmethod
    def _begin(self, recording: Recording) -> None:
        """Write the head of a file with the columns of this recording."""

    @abstractmethod
    def _append(self, recording: Recording) -> None:
        """Write the records (N,)."""


@dataclass(frozen=True)
class MissingColumn:
    """A column that a file lacks, and the column of the file that may be it, misspelt ("" where none is near)."""

    column: str
    near: str = ""

    def __str__(self) -> str:
        return self.column + (f" (did you mean {self.near!r}?)" if self.near else "")


def find_missing_columns(wanted: Iterable[str], order: Collection[str]) -> tuple[MissingColumn, ...]:
    """Find required columns that a header lacks, each with a near match that is not required itself.

    Parameters
    ----------
    wanted : iterable of str
        The required columns.
    order : collection of str
        The header.

    Returns
    -------
    tuple of MissingColumn
    """
    names = list(wanted)
    others = [column for column in order if column not in names]
    folded = {column.casefold(): column for column in reversed(others)}
    found = []
    for column in names:
        if column not in order:
            from difflib import get_close_matches

            near = get_close_matches(column.casefold(), list(folded), n=1, cutoff=0.75)
            found.append(MissingColumn(column, folded[near[0]] if near else ""))
    return tuple(found)


def read_positions(order: Sequence[str], asked: ReadRequest, place: str) -> list[int]:
    """Positions of the columns to read. Columns without a name, and those of one name that nobody asked for, are not
    read, which is counted. Raises DataError for two of one name that is required, for columns that are required and
    not there, and for too many."""
    if len(order) > MOST_COLUMNS:
        raise DataError(f"{place}: {len(order)} columns, and at most {MOST_COLUMNS} are read; is it a table?")
    times, unread = Counter(order), []
    for column, n in times.items():
        if not column:
            unread.append(f"{n} column{'s' if n > 1 else ''} without a name")
        elif n > 1 and asked.must_be_unique(column):
            raise DataError(f"{place}:{column}: two columns have this name")
        elif n > 1:
            unread.append(f"{n} columns {column!r}")
    asked.counts.unread = unread
    names = [column for column, n in times.items() if column and n == 1]
    check_required(names, asked.required, place)
    return [j for j, column in enumerate(order) if column and times[column] == 1 and asked.is_read(column)]


def check_required(order: Sequence[str], required: Collection[str], place: str) -> None:
    """Raises DataError, with near matches, for required columns that are not there."""
    missing = find_missing_columns(required, order)
    if missing:
        words = ", ".join(map(str, missing))
        raise DataError(f"{place}: missing column{'s' * (len(missing) > 1)} {words}; the file has {', '.join(order)}")
