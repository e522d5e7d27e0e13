"""Recordings in, in chunks of constant memory: declared columns as float64, all others as they came.

Nothing is guessed: a column holds numbers because its name carries a unit or because the caller says so. The format
is that of the file, CSV or Parquet; what is read is the same.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from enginediag_cli.progress import touched
from enginediag_cli.recordings.formats.csv_in import CsvTable
from enginediag_cli.recordings.formats.excel_in import ExcelTable, is_excel
from enginediag_cli.recordings.formats.parquet_in import ParquetTable, is_parquet
from enginediag_cli.recordings.formats.table_file import Asked, ReadingCounts, TableFile
from enginediag_cli.recordings.source import OWN, Dialect, Source, opened
from enginediag_cli.recordings.table import Recording, concat


@contextmanager
def table_file(source: Source, codec: str = "utf-8-sig", sheet: str = "") -> Iterator[TableFile]:
    """The open table, in the format that its first bytes or its name say; CSV of all else, in the encoding `codec`.

    source: path (`-` is stdin, `.gz` is unpacked) or an open text stream; sheet: of a workbook. Raises DataError.
    """
    path = source if isinstance(source, (str, Path)) and str(source) != "-" else None
    if path is not None and is_excel(path):
        with closing(ExcelTable(path, sheet)) as workbook:
            yield workbook
    elif path is not None and is_parquet(path):
        with closing(ParquetTable(path)) as table:
            yield table
    else:
        with opened(source, codec) as (stream, name):
            yield CsvTable(stream, name, source)


def is_whole(path: str) -> bool:
    """Whether a file is of a format that is read only when it is complete."""
    return path.endswith(".gz") or is_parquet(path) or is_excel(path)


def read(
    source: Source | TableFile,
    *,
    declared: Collection[str] = (),
    required: Collection[str] = (),
    by_suffix: bool = True,
    chunk_records: int = 20_000,
    dialect: Dialect = OWN,
    texts: Collection[str] | None = None,
    stamps: Collection[str] = (),
    units: Mapping[str, str] = MappingProxyType({}),
    tolerant: bool = False,
    counts: ReadingCounts | None = None,
) -> Iterator[Recording]:
    """Yield the records of a file in chunks; a file without records yields one empty recording.

    source: as in `table_file`, or what that gave. Numbers are the columns named in `declared` and `required` (but for
    those of `texts`) and, with `by_suffix`, those whose name carries a unit; the rest is text, of which only `texts` is
    read if that is given. Columns in `required` must be there; `dialect`: how a CSV file is written; `stamps`: columns
    of text with a time in every record; `units`: of columns whose names do not say theirs; `tolerant`: lines that are
    no records are passed over, for a file that is still being written; `counts` takes what was read as no record or no
    reading. Raises DataError naming file, physical line (row, in Parquet) and column.
    """
    numbers = {*declared, *required} - set(texts or ())
    asked = Asked(numbers, required, by_suffix, dialect, texts, stamps, units, tolerant, counts or ReadingCounts())
    if isinstance(source, TableFile):
        touched("read:", source.name)
        yield from source.records(asked, chunk_records)
        return
    with table_file(source, dialect.codec, dialect.sheet) as table:
        touched("read:", table.name)
        yield from table.records(asked, chunk_records)


def read_all(source: Source, **how: Any) -> Recording:
    """As `read`, with its keywords, the whole file as one recording."""
    return concat(list(read(source, **how)))


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
