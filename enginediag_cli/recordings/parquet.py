"""Parquet files through pyarrow, the only module that knows it: imported when a Parquet file is named, never before.

Null values become NaN or empty texts here, and every error of pyarrow one that names the file and the place in it.

Parquet in, row group by row group: the records that the same recording as CSV would give.

Parquet out: recordings and rows of results, in row groups of bounded size, with their `#` lines as metadata.

Numbers keep all their digits; a missing value is a null.
"""

from __future__ import annotations

import csv
import io
import os
import pickle
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from enum import Enum
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.table import Recording, check_clock, concat, rechunk
from enginediag_cli.recordings.table_file import Asked, NumberForm, TableFile, no_number, read_positions
from enginediag_cli.safe_text import UNSPEAKABLE, guarded

NOTES = b"enginediag"
"""Key of a file's metadata that holds the `#` lines of the same file as CSV, one below the other."""


class Kind(Enum):
    """What the values of a column are."""

    NUMBER = "numbers"
    TEXT = "texts"
    STAMP = "time stamps"
    NESTED = "nested values"
    OTHER = "values of another type"


def parquet_library(path: str, otherwise: str) -> Any:
    """The modules (pyarrow, pyarrow.parquet). Raises DataError, with what else can be done, where they are absent."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise DataError(
            f"{path}: a Parquet file needs pyarrow, which is not installed ({error}): "
            f"pip install 'enginediag[parquet]', or {otherwise}"
        ) from None
    return pyarrow, pyarrow.parquet


class ArrowFile:
    """An open Parquet file. names: its columns, in order; kinds: what each holds, and `types` in Arrow's own words;
    notes: the `#` lines that it would have as CSV; groups: records of each row group."""

    def __init__(self, path: str):
        self._path = path
        self._arrow, parquet = parquet_library(path, "convert the file to CSV")
        with self._told("its head or its index at the end"):
            # without pre_buffer only the pages that are being read are in memory, and not all row groups
            self._file = parquet.ParquetFile(
                path, pre_buffer=False, buffer_size=1 << 16, page_checksum_verification=True
            )
            schema = self._file.schema_arrow
            self.names = tuple(schema.names)
            self.types = tuple(str(field.type) for field in schema)
            self.kinds = tuple(self._kind(field.type) for field in schema)
            text = (schema.metadata or {}).get(NOTES, b"").decode("utf-8", errors="replace")
            self.notes = tuple(line.strip() for line in text.splitlines())
            metadata = self._file.metadata
            self.groups = tuple(metadata.row_group(k).num_rows for k in range(metadata.num_row_groups))

    def close(self) -> None:
        self._file.close()

    def batches(self, group: int, records: int) -> Iterator[Sequence[Any]]:
        """The columns of a row group, up to so many records at a time, for `floats` and `texts`."""
        with self._told(f"row group {group}"):
            for batch in self._file.iter_batches(batch_size=records, row_groups=[group], use_threads=False):
                yield batch.columns

    def floats(self, column: Any, group: int) -> np.ndarray:
        """(N,) float64 of a column of numbers, NaN where null; true is 1."""
        with self._told(f"row group {group}"):
            plain = self._decoded(column).cast(self._arrow.float64(), safe=False)
            return np.array(plain.to_numpy(zero_copy_only=False), dtype=float)

    def texts(self, column: Any, kind: Kind, group: int) -> list[str]:
        """N texts of any column but a nested one, "" where null: numbers so that they read back to the same value,
        whole ones without a point, time stamps as ISO 8601, in UTC where they know their zone."""
        types = self._arrow.types
        with self._told(f"row group {group}"):
            column = self._decoded(column)
            if types.is_timestamp(column.type):
                return self._stamps(column)
            if kind is Kind.STAMP or types.is_decimal(column.type):
                column = column.cast(self._arrow.string())
            values = column.to_pylist()
        return [_text(value) for value in values]

    def _decoded(self, column: Any) -> Any:
        """Without the dictionary that categories are kept in."""
        return column.dictionary_decode() if self._arrow.types.is_dictionary(column.type) else column

    def _stamps(self, column: Any) -> list[str]:
        zone = column.type.tz
        whole = column.cast(self._arrow.timestamp("us", tz=zone), safe=False).cast(self._arrow.int64())
        micros = whole.fill_null(np.iinfo(np.int64).min).to_numpy(zero_copy_only=False)
        cells = np.datetime_as_string(micros.astype("datetime64[us]")).tolist()
        return ["" if cell == "NaT" else cell + ("Z" if zone else "") for cell in cells]

    def _kind(self, of: Any) -> Kind:
        types = self._arrow.types
        if types.is_dictionary(of):
            return self._kind(of.value_type)
        if types.is_integer(of) or types.is_floating(of) or types.is_decimal(of):
            return Kind.NUMBER
        if types.is_boolean(of) or types.is_null(of):
            return Kind.NUMBER
        if types.is_string(of) or types.is_large_string(of):
            return Kind.TEXT
        if types.is_timestamp(of) or types.is_date(of) or types.is_time(of):
            return Kind.STAMP
        return Kind.NESTED if types.is_nested(of) else Kind.OTHER

    @contextmanager
    def _told(self, place: str) -> Iterator[None]:
        try:
            yield
        except (self._arrow.ArrowException, OSError, UnicodeDecodeError) as error:
            first = (str(error).splitlines() or [""])[0]
            raise DataError(
                f"{self._path}: {place} cannot be read ({first}): the file is damaged, cut off, or no Parquet; "
                "write or copy it anew"
            ) from error


class ArrowWriter:
    """Writes row groups to an open binary stream. columns: (name, type) with the type bool, int64, float64 or
    string; notes: the `#` lines."""

    def __init__(self, stream: BinaryIO, path: str, columns: Sequence[tuple[str, str]], notes: Sequence[str]):
        self._arrow, parquet = parquet_library(path, "write a .csv")
        types = {"bool": "bool_"}
        fields = [(name, getattr(self._arrow, types.get(of, of))()) for name, of in columns]
        metadata = {NOTES: "\n".join(notes).encode(errors=UNSPEAKABLE)} if notes else None
        self._schema = self._arrow.schema(fields, metadata=metadata)
        self._writer = parquet.ParquetWriter(stream, self._schema, write_page_checksum=True)

    def group(self, columns: Sequence[Sequence[Any] | np.ndarray]) -> None:
        """Append a row group; None and NaN are nulls."""
        arrays = [
            self._arrow.array(_texts(values) if field.type == "string" else values, type=field.type, from_pandas=True)
            for values, field in zip(columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema), row_group_size=1 << 30)

    def close(self) -> None:
        self._writer.close()


def _text(value: Any) -> str:
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def _texts(values: Sequence[Any] | np.ndarray) -> list[Any]:
    return [v.encode(errors=UNSPEAKABLE).decode() if isinstance(v, str) else v for v in values]


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


GROUP = 50_000
"""Records of a row group: large enough to pack well, small enough to be read in 20 MB at 50 columns."""
CELLS = 200_000
"""Of rows of results in a group, which may have thousands of cells each: some 20 MB while they wait."""
WHOLE = 2**63
"""Beyond it a whole number has no room in 64 bits, and is written as text."""


class ParquetWriter:
    """Writes recordings with the same columns, one after the other, to an open binary stream; complete when its `with`
    block has ended without an error."""

    def __init__(self, stream: BinaryIO, path: str, provenance: Sequence[str] = ()):
        self._stream, self._path, self._provenance = stream, path, provenance
        self._writer: ArrowWriter | None = None
        self._order: tuple[str, ...] = ()
        self._held: list[Recording] = []

    def write(self, recording: Recording) -> None:
        """Append the records (N,). Raises DataError when the columns are not those of the first call."""
        if self._writer is None:
            columns = [(c, "string" if c in recording.text else "float64") for c in recording.order]
            self._order = recording.order
            self._writer = ArrowWriter(self._stream, self._path, columns, self._provenance)
        elif set(recording.order) != set(self._order):
            odd = ", ".join(sorted(set(recording.order) ^ set(self._order)))
            raise DataError(f"{recording.source}: its columns differ from those already written: {odd}")
        self._held.append(recording)
        if sum(map(len, self._held)) >= GROUP:
            self._flush()

    def __enter__(self) -> ParquetWriter:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        """Write what is held, and the index. Raises DataError where nothing was written, not even a header."""
        if self._writer is None and error is None:
            raise DataError(f"{self._path}: nothing to write")
        if self._writer is not None:
            with closing(self._writer):
                if error is None:
                    self._flush()

    def _flush(self) -> None:
        whole = concat(self._held) if self._held else None
        self._held = []
        for start in range(0, len(whole) if whole is not None else 0, GROUP):
            assert whole is not None and self._writer is not None
            part = whole.select(slice(start, start + GROUP))
            self._writer.group(
                [[cell or None for cell in part.text[c]] if c in part.text else part.columns[c] for c in self._order]
            )


def write_parquet(
    rows: Iterable[Sequence[Any]], columns: Sequence[str], stream: BinaryIO, path: str, provenance: Sequence[str] = ()
) -> int:
    """Write rows of cells (None, bool, int, float or text) as they come; returns their number.

    A column has the narrowest type that holds all its cells: the rows wait in a file of their own until that is known,
    a group in memory at a time.
    """
    from tempfile import TemporaryFile

    kinds: list[set[type]] = [set() for _ in columns]
    count, size, rows = 0, max(CELLS // max(len(columns), 1), 1), iter(rows)
    with TemporaryFile() as waiting:
        while group := list(islice(rows, size)):
            for met, cells in zip(kinds, zip(*group, strict=True), strict=True):
                met.update(map(_kind, cells))
            pickle.dump(group, waiting)
            count += len(group)
        types = [_type(met - {type(None)}) for met in kinds]
        waiting.seek(0)
        with closing(ArrowWriter(stream, path, list(zip(columns, types, strict=True)), provenance)) as writer:
            for group in _groups(waiting, count):
                cells_of = zip(*group, strict=True)
                writer.group([_as(of, cells) for of, cells in zip(types, cells_of, strict=True)])
    return count


def _groups(waiting: Any, count: int) -> Iterator[list[Sequence[Any]]]:
    while count:
        group = pickle.load(waiting)
        count -= len(group)
        yield group


def _kind(cell: Any) -> type:
    if cell is None or cell == "" or cell != cell:
        return type(None)
    return str if type(cell) is int and not -WHOLE <= cell < WHOLE else type(cell)


def _type(met: set[type]) -> str:
    """The type of a column that has cells of these types."""
    if met == {bool}:
        return "bool"
    if met and met <= {int, float}:
        return "int64" if met == {int} else "float64"
    return "string"


def _as(of: str, cells: Sequence[Any]) -> list[Any]:
    """Cells of a column, of one type."""
    told = [None if _kind(cell) is type(None) else cell for cell in cells]
    if of == "string":
        return [cell if cell is None else _cell_text(cell) for cell in told]
    return [cell if cell is None else float(cell) for cell in told] if of == "float64" else told


def _cell_text(cell: Any) -> str:
    if isinstance(cell, bool):
        return "true" if cell else "false"
    return repr(cell) if isinstance(cell, float) else str(cell)
