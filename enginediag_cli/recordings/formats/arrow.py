"""Parquet files through pyarrow, the only module that knows it: imported when a Parquet file is named, never before.

Null values become NaN or empty texts here, and every error of pyarrow one that names the file and the place in it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from enum import Enum
from typing import Any, BinaryIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.safe_text import UNSPEAKABLE

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
