"""Writing of recordings and rows of results: one header, then chunk after chunk; a file appears complete or not at all.

In CSV, numbers are written with 10 significant digits: more than any recorder resolves, and short. A missing value is
an empty cell. A closed pipe is left to the caller.

**Parquet** files need pyarrow, which is imported when one is named, never before. They are read row group by row group,
and give the records that the same recording as CSV would give. They are written in row groups of bounded size, with
their `#` lines as metadata. Numbers keep all their digits; a missing value is a null in the file, and NaN or an empty
text here.
"""

from __future__ import annotations

import csv
import glob
import gzip
import io
import os
import pickle
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from enum import Enum
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, TextIO

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.parallel import try_lock
from enginediag_cli.progress import touched, wipe
from enginediag_cli.recordings.source import PARQUET_MAGIC, named_parquet, refuse_devices
from enginediag_cli.recordings.table import (
    ReadRequest,
    Recording,
    RecordingWriter,
    TableFile,
    check_time,
    number_error,
    read_positions,
    rechunk,
)
from enginediag_cli.safe_text import UNSPEAKABLE, guarded, visible

PART = ".part"
"""Ending of a file that is being written, beside its final place and hidden."""
LEFT_BEHIND_S = 60.0
"""Age from which such a file may be a killed run's: one that is at work has locked its own long before."""


class CsvWriter(RecordingWriter):
    """Writes recordings to an open text stream; each is handed on at once."""

    def __init__(self, stream: TextIO, provenance: Sequence[str] = (), *, digits: int = 10):
        """provenance: lines to put behind `# ` at the head; none leaves the head out."""
        self._stream, self._provenance = stream, provenance
        self._csv = csv.writer(stream, lineterminator="\n")
        self._format = f"%.{digits}g"
        self._shown = stream.isatty()

    def _begin(self, recording: Recording) -> None:
        self._stream.writelines(f"# {line}\n" for line in self._provenance)
        self._csv.writerow(map(self._safe, recording.order))

    def _append(self, recording: Recording) -> None:
        if self._shown:
            wipe()
        self._csv.writerows(zip(*(self._cells(recording, c) for c in self._order or ()), strict=True))
        self._stream.flush()

    def _safe(self, text: str) -> str:
        """A text that neither a spreadsheet nor a terminal obeys."""
        return guarded(visible(text) if self._shown else text)

    def _cells(self, recording: Recording, column: str) -> Sequence[str]:
        if column in recording.text:
            return [self._safe(cell) for cell in recording.text[column]]
        values = recording.columns[column]
        cells = list(map(self._format.__mod__, values.tolist()))
        for k in np.flatnonzero(np.isnan(values)):
            cells[k] = ""
        return cells


@contextmanager
def open_output(path: str | Path) -> Iterator[TextIO]:
    """Open a text stream to a path.

    A file is written beside its final place and renamed when the block ends well. After an error or an interrupt, what
    was there before is still there; of two runs that write the same file one wins, whole. Pipes and devices are written
    to directly.

    Parameters
    ----------
    path : path
        ``-`` is standard output, ``.gz`` is packed.

    Yields
    ------
    TextIO

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    if str(path) == "-":
        yield sys.stdout
        sys.stdout.flush()
        return
    with open_binary_output(path) as raw:
        if Path(os.path.realpath(path)).suffix == ".gz" and raw.seekable():
            # no name and no time in the packed file: the same data give the same bytes
            with gzip.GzipFile(filename="", fileobj=raw, mode="wb", mtime=0) as packed:
                with io.TextIOWrapper(packed, encoding="utf-8", errors=UNSPEAKABLE, newline="") as stream:
                    yield stream
        else:
            with io.TextIOWrapper(raw, encoding="utf-8", errors=UNSPEAKABLE, newline="") as stream:
                yield stream


def _descriptor(path: str | Path) -> int | None:
    """Number of the open file that a name such as /dev/stdout stands for."""
    name = str(path)
    known = {"/dev/stdout": 1, "/dev/stderr": 2}
    folder, _, number = name.rpartition("/")
    return int(number) if folder in ("/dev/fd", "/proc/self/fd") and number.isdigit() else known.get(name)


@contextmanager
def open_binary_output(path: str | Path) -> Iterator[BinaryIO]:
    """As `output`, a stream of bytes, packed nowhere; not for stdout."""
    if (descriptor := _descriptor(path)) is not None:  # what a shell has opened, to be appended to where it says so
        with os.fdopen(os.dup(descriptor), "wb") as stream:
            yield stream
        return
    final = Path(os.path.realpath(path))  # through a symbolic link: replace the file, not the link
    if final.exists() and not final.is_file():
        with open(final, "wb") as stream:
            yield stream
        return
    from tempfile import mkstemp

    _remove_stale(final)
    handle, temporary = mkstemp(prefix=f".{final.name}.", suffix=PART, dir=final.parent)
    same = os.dup(handle)  # the stream's user may close it
    try:
        try_lock(same)
        with os.fdopen(handle, "wb") as raw:
            yield raw
        os.chmod(temporary, _file_mode(final))
        _to_disk(same, path)
        os.replace(temporary, final)
        touched("written:", path)
    except BaseException:
        with suppress(FileNotFoundError):
            os.unlink(temporary)
        raise
    finally:
        os.close(same)


def _to_disk(handle: int, path: str | Path) -> None:
    """See a file on the disk before it takes its name: after a power cut there is the old one or the new one. A disk
    without room, or somebody's quota, may show only now."""
    try:
        os.fsync(handle)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def _remove_stale(final: Path) -> None:
    """Remove what runs that were killed have left beside the file: old, and locked by nobody."""
    for entry in final.parent.glob(f".{glob.escape(final.name)}.*{PART}"):
        with suppress(OSError):
            if time.time() - entry.stat().st_mtime < LEFT_BEHIND_S:
                continue
            handle = os.open(entry, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
            try:
                if try_lock(handle):
                    entry.unlink()
            finally:
                os.close(handle)


@contextmanager
def open_recording_output(
    path: str | Path, provenance: Sequence[str] = (), *, parquet: bool | None = None
) -> Iterator[RecordingWriter]:
    """What writes recordings to `path`, as Parquet or CSV; with None its name says which. Raises DataError, OSError."""
    if named_parquet(path) if parquet is None else parquet:
        with open_binary_output(path) as raw, ParquetWriter(raw, str(path), provenance) as writer:
            yield writer
    else:
        with open_output(path) as stream:
            yield CsvWriter(stream, provenance)


def _file_mode(path: Path) -> int:
    """Permissions that a plain open() would have given: those of the file there, or the umask's."""
    if path.exists():
        return stat.S_IMODE(path.stat().st_mode)
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask


def write_csv(
    path: str | Path, recordings: Iterable[Recording], provenance: Sequence[str] = (), *, digits: int = 10
) -> int:
    """Write the recordings as CSV to a path or, for `-`, to stdout; returns the number of records.

    Raises DataError (columns differ, or nothing to write, not even a header) and OSError.
    """
    sizes = []
    with open_output(path) as stream:
        writer = CsvWriter(stream, provenance, digits=digits)
        for recording in recordings:
            writer.write(recording)
            sizes.append(len(recording))
        if not sizes:
            raise DataError(f"{path}: nothing to write")
    return sum(sizes)


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


LINES_AT_ONCE = 100
"""Records whose text is in memory at once: a row of statistics may have thousands of cells."""


class ParquetTable(TableFile):
    """An open Parquet file. The line of a record is the one that it would have as CSV."""

    def __init__(self, path: str | Path):
        """Raises DataError: not there, no Parquet, no pyarrow, a column that no table of numbers and texts has."""
        self.name = str(path)
        _refuse(path)
        self._arrow, parquet = parquet_library(self.name, "convert the file to CSV")
        with self._readable("its head or its index at the end"):
            # without pre_buffer only the pages that are being read are in memory, and not all row groups
            self._file = parquet.ParquetFile(
                path, pre_buffer=False, buffer_size=1 << 16, page_checksum_verification=True
            )
            schema = self._file.schema_arrow
        notes = (schema.metadata or {}).get(NOTES, b"").decode("utf-8", errors="replace")
        self.provenance = tuple(line.strip() for line in notes.splitlines())
        self.columns = tuple(name.strip() for name in schema.names)
        self._types = tuple(str(field.type) for field in schema)
        self._kinds = tuple(self._kind(field.type) for field in schema)
        self.lines = self._text()
        for name, kind, type_ in zip(self.columns, self._kinds, self._types, strict=True):
            if kind in (Kind.NESTED, Kind.OTHER):
                raise DataError(
                    f"{self.name}: column {name}: {kind.value} ({type_[:80]}), where a recording has numbers, texts "
                    "and time stamps; leave it out, or write a column for each of its parts"
                )

    def close(self) -> None:
        self._file.close()

    def _text(self) -> Iterator[str]:
        """The whole as lines of CSV."""
        yield from (f"# {note}\n" for note in self.provenance)
        yield _line(self.columns)
        for _, group, columns in self._batches(LINES_AT_ONCE):
            cells = [self._texts(c, k, group) for c, k in zip(columns, self._kinds, strict=True)]
            safe = [
                [guarded(cell) for cell in texts] if kind is Kind.TEXT else texts
                for texts, kind in zip(cells, self._kinds, strict=True)
            ]
            yield from map(_line, zip(*safe, strict=True))

    def records(self, asked: ReadRequest, chunk_records: int) -> Iterator[Recording]:
        """See `TableFile.records`. Raises DataError naming file, row, row group and column."""
        positions = read_positions(self.columns, asked, self.name)
        for name, kind, type_ in zip(self.columns, self._kinds, self._types, strict=True):
            if kind is Kind.STAMP and asked.is_number(name):
                raise DataError(
                    f"{self.name}: column {name}: not numbers but time stamps ({type_}); state in a recorder that they "
                    f"are, `time: {{from: [{name}]}}`, which `enginediag recorder FILE` drafts"
                )
        yield from rechunk(self._parts(asked, positions, chunk_records), chunk_records)

    def _parts(self, asked: ReadRequest, positions: Sequence[int], records: int) -> Iterator[Recording]:
        empty = True
        for row, group, columns in self._batches(records):
            yield self._recording(asked, positions, row, group, columns)
            empty = False
        if empty:
            yield self._recording(asked, positions, 0, 0, None)

    def _batches(self, records: int) -> Iterator[tuple[int, int, Sequence[Any]]]:
        """(rows before it, row group, columns) of each batch."""
        row = 0
        for group in range(self._file.metadata.num_row_groups):
            with self._readable(f"row group {group}"):
                for batch in self._file.iter_batches(batch_size=records, row_groups=[group], use_threads=False):
                    if batch.num_columns and batch.num_rows:
                        yield row, group, batch.columns
                        row += batch.num_rows

    def _recording(
        self, asked: ReadRequest, positions: Sequence[int], row: int, group: int, columns: Sequence[Any] | None
    ) -> Recording:
        n = len(columns[0]) if columns else 0
        numbers: dict[str, np.ndarray] = {}
        texts: dict[str, Sequence[str]] = {}
        for j in positions:
            name, kind = self.columns[j], self._kinds[j]
            if not asked.is_number(name):
                texts[name] = self._texts(columns[j], kind, group) if columns else []
            elif not columns:
                numbers[name] = np.zeros(0)
            elif kind is Kind.NUMBER:
                numbers[name] = self._floats(columns[j], group)
            else:
                cells = self._texts(columns[j], kind, group)
                numbers[name], bad, counts = asked.dialect.numbers(cells)
                if bad:
                    place = f"{self.name}: row {row + bad[0] + 1} (row group {group}): column {name}"
                    raise number_error(cells[bad[0]], place)
                asked.counts.count_missing(name, counts)
        line = len(self.provenance) + 2 + row + np.arange(n)
        order = tuple(self.columns[j] for j in positions)
        found = Recording(numbers, texts, order, line, self.name, tuple(self.provenance))
        check_time(found)
        return found

    def _floats(self, column: Any, group: int) -> np.ndarray:
        """(N,) float64 of a column of numbers, NaN where null; true is 1."""
        with self._readable(f"row group {group}"):
            plain = self._decoded(column).cast(self._arrow.float64(), safe=False)
            return np.array(plain.to_numpy(zero_copy_only=False), dtype=float)

    def _texts(self, column: Any, kind: Kind, group: int) -> list[str]:
        """N texts of any column but a nested one, "" where null. Numbers read back to the same value, whole ones have
        no point; time stamps are ISO 8601, in UTC where they know their zone."""
        types = self._arrow.types
        with self._readable(f"row group {group}"):
            column = self._decoded(column)
            if types.is_timestamp(column.type):
                return self._stamps(column)
            if kind is Kind.STAMP or types.is_decimal(column.type):
                column = column.cast(self._arrow.string())
            return [_text(value).removesuffix(".0" * isinstance(value, float)) for value in column.to_pylist()]

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
    def _readable(self, place: str) -> Iterator[None]:
        """Errors of pyarrow, with the file and the place in it."""
        try:
            yield
        except (self._arrow.ArrowException, OSError, UnicodeDecodeError) as error:
            first = (str(error).splitlines() or [""])[0]
            raise DataError(
                f"{self.name}: {place} cannot be read ({first}): the file is damaged, cut off, or no Parquet; "
                "write or copy it anew"
            ) from error


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(list(cells))
    return text.getvalue()


def _text(value: Any) -> str:
    """A cell as text, "" where there is no value."""
    if value is None or value != value:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _refuse(path: str | Path) -> None:
    """Raises DataError for what cannot be opened, or is not Parquet though it is called so."""
    refuse_devices(path)
    try:
        if os.path.exists(path) and not os.path.isfile(path):
            raise DataError(f"{path}: a pipe, and Parquet has its index at the end; name the file itself")
        with open(path, "rb") as stream:
            first = stream.read(4)
    except OSError as error:
        raise DataError(f"{path}: {error.strerror or error}") from error
    if first == PARQUET_MAGIC[1]:
        raise DataError(f"{path}: an encrypted Parquet file; write it without encryption")
    if first != PARQUET_MAGIC[0]:
        raise DataError(f"{path}: called Parquet, but does not begin as such a file; rename or write it anew")


GROUP = 50_000
"""Records of a row group: large enough to pack well, small enough to be read in 20 MB at 50 columns."""
CELLS = 200_000
"""Of rows of results in a group, which may have thousands of cells each: some 20 MB while they wait."""
WHOLE = 2**63
"""Beyond it a whole number has no room in 64 bits, and is written as text."""


class ParquetWriter(RecordingWriter):
    """Writes recordings to an open binary stream; complete when its `with` block has ended without an error."""

    def __init__(self, stream: BinaryIO, path: str, provenance: Sequence[str] = ()):
        self._stream, self._path, self._provenance = stream, path, provenance
        self._waiting: list[Recording] = []

    def _begin(self, recording: Recording) -> None:
        columns = [(c, "string" if c in recording.text else "float64") for c in recording.order]
        self._groups = _GroupWriter(self._stream, self._path, columns, self._provenance)

    def _append(self, recording: Recording) -> None:
        self._waiting.append(recording)
        if sum(map(len, self._waiting)) >= GROUP:
            self._flush()

    def __enter__(self) -> ParquetWriter:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        """Write what is waiting, and the index. Raises DataError where nothing was written, not even a header."""
        if self._order is not None:
            with closing(self._groups):
                if error is None:
                    self._flush()
        elif error is None:
            raise DataError(f"{self._path}: nothing to write")

    def _flush(self) -> None:
        for part in rechunk(self._waiting, GROUP):
            if len(part):
                self._groups.write(
                    [[cell or None for cell in part.text[c]] if c in part.text else part[c] for c in self._order or ()]
                )
        self._waiting = []


class _GroupWriter:
    """Writes row groups to an open binary stream. columns: (name, type) with the type bool, int64, float64 or string;
    notes: the `#` lines."""

    def __init__(self, stream: BinaryIO, path: str, columns: Sequence[tuple[str, str]], notes: Sequence[str]):
        self._arrow, parquet = parquet_library(path, "write a .csv")
        fields = [(name, getattr(self._arrow, {"bool": "bool_"}.get(type_, type_))()) for name, type_ in columns]
        metadata = {NOTES: "\n".join(notes).encode(errors=UNSPEAKABLE)} if notes else None
        self._schema = self._arrow.schema(fields, metadata=metadata)
        self._writer = parquet.ParquetWriter(stream, self._schema, write_page_checksum=True)

    def write(self, columns: Sequence[Sequence[Any] | np.ndarray]) -> None:
        """Append a row group; None and NaN are nulls."""
        arrays = [
            self._arrow.array(_encodable(cells) if field.type == "string" else cells, type=field.type, from_pandas=True)
            for cells, field in zip(columns, self._schema, strict=True)
        ]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema), row_group_size=1 << 30)

    def close(self) -> None:
        self._writer.close()


def _encodable(cells: Sequence[Any] | np.ndarray) -> list[Any]:
    return [c.encode(errors=UNSPEAKABLE).decode() if isinstance(c, str) else c for c in cells]


def write_parquet(
    rows: Iterable[Sequence[Any]], columns: Sequence[str], stream: BinaryIO, path: str, provenance: Sequence[str] = ()
) -> int:
    """Write rows of cells (None, bool, int, float or text) as they come; returns their number.

    A column has the narrowest type that holds all its cells: the rows wait in a file of their own until that is known,
    a group in memory at a time.
    """
    from tempfile import TemporaryFile

    kinds: list[set[type]] = [set() for _ in columns]
    sizes, rows = [], iter(rows)
    with TemporaryFile() as waiting:
        while group := list(islice(rows, max(CELLS // max(len(columns), 1), 1))):
            for met, cells in zip(kinds, zip(*group, strict=True), strict=True):
                met.update(map(_cell_type, cells))
            pickle.dump(group, waiting)
            sizes.append(len(group))
        types = [_column_type(met - {type(None)}) for met in kinds]
        waiting.seek(0)
        with closing(_GroupWriter(stream, path, list(zip(columns, types, strict=True)), provenance)) as writer:
            for _ in sizes:
                by_column = zip(*pickle.load(waiting), strict=True)
                writer.write([_converted(type_, cells) for type_, cells in zip(types, by_column, strict=True)])
    return sum(sizes)


def _cell_type(cell: Any) -> type:
    if cell is None or cell == "" or cell != cell:
        return type(None)
    return str if type(cell) is int and not -WHOLE <= cell < WHOLE else type(cell)


def _column_type(met: set[type]) -> str:
    """The Parquet type of a column that has cells of these types."""
    if met == {bool}:
        return "bool"
    if met and met <= {int, float}:
        return "int64" if met == {int} else "float64"
    return "string"


def _converted(type_: str, cells: Sequence[Any]) -> list[Any]:
    """Cells of a column, of one type; None where there is no value."""
    known = [None if _cell_type(cell) is type(None) else cell for cell in cells]
    if type_ == "string":
        return [cell if cell is None else _text(cell) for cell in known]
    return [cell if cell is None else float(cell) for cell in known] if type_ == "float64" else known
