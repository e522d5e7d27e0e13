"""What a file of a table is, in whatever format: its head, its records, and its text."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.dialect import OWN, Dialect
from enginediag_cli.recordings.table import Recording
from enginediag_cli.units import is_numeric_column


@dataclass(frozen=True)
class Asked:
    """What a reader wants of a table. numbers: columns that hold numbers whatever their names say, and with
    `by_suffix` so do those whose name carries a unit; required: columns that must be there; dialect: how texts are
    written."""

    numbers: Collection[str]
    required: Collection[str] = ()
    by_suffix: bool = True
    dialect: Dialect = OWN

    def is_number(self, column: str) -> bool:
        return column in self.numbers or (self.by_suffix and is_numeric_column(column))


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


def check_header(order: Sequence[str], required: Collection[str], place: str) -> None:
    """Raises DataError for columns without a name, of one name, or that are required and not there."""
    for position, column in enumerate(order, start=1):
        if not column:
            raise DataError(f"{place}: column {position} has no name")
        if order.index(column) != position - 1:
            raise DataError(f"{place}:{column}: two columns have this name")
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
