"""Parquet out: recordings and rows of results, in row groups of bounded size, with their `#` lines as metadata.

Numbers keep all their digits; a missing value is a null.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from itertools import islice
from tempfile import TemporaryFile
from typing import Any, BinaryIO

from enginediag_cli.errors import DataError
from enginediag_cli.recordings.formats.arrow import ArrowWriter
from enginediag_cli.recordings.table import Recording, concat

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
        return [cell if cell is None else _text(cell) for cell in told]
    return [cell if cell is None else float(cell) for cell in told] if of == "float64" else told


def _text(cell: Any) -> str:
    if isinstance(cell, bool):
        return "true" if cell else "false"
    return repr(cell) if isinstance(cell, float) else str(cell)
