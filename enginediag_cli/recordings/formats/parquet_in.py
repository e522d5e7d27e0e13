"""Parquet in, row group by row group: the records that the same recording as CSV would give."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.arrow import ArrowFile, Kind
from enginediag_cli.recordings.formats.table_file import Asked, NumberForm, TableFile, no_number, read_positions
from enginediag_cli.recordings.table import Recording, check_clock, rechunk
from enginediag_cli.safe_text import guarded

SUFFIXES = (".parquet", ".pq")
"""Names of Parquet files, in any case."""
MAGIC = (b"PAR1", b"PARE")
"""What such a file begins with, whatever it is called; the second where it is encrypted."""

LINES_AT_ONCE = 100
"""Records whose text is in memory at once: a row of statistics may have thousands of cells."""


def is_parquet(path: str | Path) -> bool:
    """Whether a file is Parquet by its first bytes, or is called so."""
    if os.path.isfile(path):
        try:
            with open(path, "rb") as stream:
                if stream.read(4) in MAGIC:
                    return True
        except OSError:
            return False
    return named_parquet(path)


def named_parquet(path: str | Path) -> bool:
    """Whether a file is called Parquet."""
    return Path(path).suffix.lower() in SUFFIXES


class ParquetTable(TableFile):
    """An open Parquet file. The line of a record is the one that it would have as CSV."""

    def __init__(self, path: str | Path):
        """Raises DataError: not there, no Parquet, no pyarrow, a column that no table of numbers and texts has."""
        self.name = str(path)
        _refuse(path)
        self._file = ArrowFile(self.name)
        self.provenance, self.lines = self._file.notes, self._text()
        self.columns = tuple(name.strip() for name in self._file.names)
        for name, kind, of in zip(self.columns, self._file.kinds, self._file.types, strict=True):
            if kind in (Kind.NESTED, Kind.OTHER):
                raise DataError(
                    f"{self.name}: column {name}: {kind.value} ({of[:80]}), where a recording has numbers, texts and "
                    "time stamps; leave it out, or write a column for each of its parts"
                )

    def close(self) -> None:
        self._file.close()

    def _text(self) -> Iterator[str]:
        """The whole as lines of CSV."""
        yield from (f"# {note}\n" for note in self.provenance)
        yield _line(self.columns)
        for _, group, columns in self._batches(LINES_AT_ONCE):
            cells = [self._file.texts(c, k, group) for c, k in zip(columns, self._file.kinds, strict=True)]
            safe = [
                [guarded(cell) for cell in texts] if kind is Kind.TEXT else texts
                for texts, kind in zip(cells, self._file.kinds, strict=True)
            ]
            yield from map(_line, zip(*safe, strict=True))

    def records(self, asked: Asked, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Raises DataError naming file, row, row group and column."""
        self._positions = read_positions(self.columns, asked, self.name)
        self._form = NumberForm.from_dialect(asked.dialect)
        self._insist_on_numbers(asked)
        yield from rechunk(self._parts(asked, chunk_records), chunk_records)

    def _parts(self, asked: Asked, records: int) -> Iterator[Recording]:
        empty = True
        for row, group, columns in self._batches(records):
            yield self._recording(asked, row, group, columns)
            empty = False
        if empty:
            yield self._recording(asked, 0, 0, None)

    def _batches(self, records: int) -> Iterator[tuple[int, int, Sequence[Any]]]:
        """(rows before it, row group, columns) of each batch."""
        row = 0
        for group in range(len(self._file.groups)):
            for columns in self._file.batches(group, records):
                if columns and len(columns[0]):
                    yield row, group, columns
                    row += len(columns[0])

    def _recording(self, asked: Asked, row: int, group: int, columns: Sequence[Any] | None) -> Recording:
        n = len(columns[0]) if columns else 0
        numbers: dict[str, np.ndarray] = {}
        texts: dict[str, Sequence[str]] = {}
        for j in self._positions:
            name, kind = self.columns[j], self._file.kinds[j]
            if not asked.is_number(name):
                texts[name] = self._file.texts(columns[j], kind, group) if columns else []
            elif not columns:
                numbers[name] = np.zeros(0)
            elif kind is Kind.NUMBER:
                numbers[name] = self._file.floats(columns[j], group)
            else:
                cells = self._file.texts(columns[j], kind, group)
                numbers[name], bad, counts = self._form.values(cells)
                if bad:
                    raise no_number(cells[bad[0]], self._place(name, row + bad[0], group))
                asked.counts.take_words(name, counts)
        line = len(self.provenance) + 2 + row + np.arange(n)
        order = tuple(self.columns[j] for j in self._positions)
        found = Recording(numbers, texts, order, line, self.name, tuple(self.provenance))
        check_clock(found)
        return found

    def _place(self, column: str, row: int, group: int) -> str:
        return f"{self.name}: row {row + 1} (row group {group}): column {column}"

    def _insist_on_numbers(self, asked: Asked) -> None:
        for name, kind, of in zip(self.columns, self._file.kinds, self._file.types, strict=True):
            if kind is Kind.STAMP and asked.is_number(name):
                raise DataError(
                    f"{self.name}: column {name}: not numbers but time stamps ({of}); state in a recorder that they "
                    f"are, `time: {{from: [{name}]}}`, which `enginediag recorder FILE` drafts"
                )


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(list(cells))
    return text.getvalue()


def _refuse(path: str | Path) -> None:
    """Raises DataError for what cannot be opened, or is not Parquet though it is called so."""
    from enginediag_cli.recordings.source import refuse_devices

    refuse_devices(path)
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise DataError(f"{path}: a pipe, and Parquet has its index at the end; name the file itself")
        with open(path, "rb") as stream:
            first = stream.read(4)
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}") from error
    if first == MAGIC[1]:
        raise DataError(f"{path}: an encrypted Parquet file; write it without encryption")
    if first != MAGIC[0]:
        raise DataError(f"{path}: called Parquet, but does not begin as such a file; rename or write it anew")
