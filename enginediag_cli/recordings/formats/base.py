"""What a file of a table is, in whatever format: its head, its records, and its text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.dialect import OWN, Dialect
from enginediag_cli.recordings.flights import KEYS
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import is_numeric_column

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

    def pass_over(self, kind: str, line: int) -> None:
        """Count a line that holds no record."""
        self.lines.setdefault(kind, [0, line])[0] += 1

    def take_words(self, column: str, counts: Mapping[str, int]) -> None:
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
class Asked:
    """What a reader wants of a table. numbers: columns that hold numbers whatever their names say, and with
    `by_suffix` so do those whose name carries a unit; required: columns that must be there, also those of `texts`;
    dialect: how texts are written; texts: the only columns of text wanted, None for all; stamps: those of them that
    hold a time in every record; units: column → unit that its numbers are taken for, where its name does not say;
    tolerant: lines that are no records are passed over wherever they stand; counts: what was read as no record or no
    reading."""

    numbers: Collection[str]
    required: Collection[str] = ()
    by_suffix: bool = True
    dialect: Dialect = OWN
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

    def must_be_one(self, column: str) -> bool:
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
    def records(self, asked: Asked, chunk_records: int) -> Iterator[Recording]:
        """Chunks of exactly so many records, the last of fewer; one empty recording of a file without records."""


class RecordingWriter(Protocol):
    """Takes recordings with the same columns, one after the other."""

    def write(self, recording: Recording) -> None:
        """Append the records (N,). Raises DataError when the columns are not those of the first call."""


def read_positions(order: Sequence[str], asked: Asked, place: str) -> list[int]:
    """Positions of the columns to read. Columns without a name, and those of one name that nobody asked for, are not
    read, which is counted. Raises DataError for two of one name that is asked for, for columns that are required and
    not there, and for too many."""
    if len(order) > MOST_COLUMNS:
        raise DataError(f"{place}: {len(order)} columns, and at most {MOST_COLUMNS} are read; is it a table?")
    times, unread = Counter(order), []
    for column, n in times.items():
        if not column:
            unread.append(f"{n} column{'s' if n > 1 else ''} without a name")
        elif n > 1 and asked.must_be_one(column):
            raise DataError(f"{place}:{column}: two columns have this name")
        elif n > 1:
            unread.append(f"{n} columns {column!r}")
    asked.counts.unread = unread
    names = [column for column, n in times.items() if column and n == 1]
    check_required(names, asked.required, place)
    return [j for j, column in enumerate(order) if column and times[column] == 1 and asked.is_read(column)]


def check_required(order: Sequence[str], required: Collection[str], place: str) -> None:
    """Raises DataError, with near matches, for columns that are required and not there."""
    absent = [column for column in required if column not in order]
    if not absent:
        return
    hints = []
    for column in absent:
        from difflib import get_close_matches

        near = get_close_matches(column, order, n=1)
        hints.append(column + (f" (did you mean {near[0]!r}?)" if near else ""))
    raise DataError(
        f"{place}: missing column{'s' if len(absent) > 1 else ''} {', '.join(hints)}; the file has {', '.join(order)}"
    )
