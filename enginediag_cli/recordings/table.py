"""The recording: a table of records with named columns of numbers, and everything else as it came.

Which flight and engine each record of a file belongs to: records of different ones are different recordings.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby

import numpy as np

from enginediag_cli.errors import DataError

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
    """One recording of all records in turn; line numbers and provenance are those of each part.

    Raises DataError when the recordings do not have the same columns.
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


def check_clock(recording: Recording) -> None:
    """Raises DataError with the line of the first time_s that cannot be a time."""
    if "time_s" not in recording:
        return
    time = recording["time_s"]
    wrong = np.flatnonzero(np.isfinite(time) & (np.abs(time) > LATEST))
    if wrong.size:
        k = int(wrong[0])
        raise DataError(f"{recording.source}:{recording.line[k]}:time_s: {time[k]:g} s cannot be a time")


KEYS = ("flight", "engine")
"""Columns that tell recordings of one file apart, where the file has them."""


@dataclass
class FlightNumbers:
    """Numbers the (flight, engine) pairs of a file in order of first appearance, over all its chunks."""

    known: dict[tuple[str, ...], int] = field(default_factory=dict)

    def of(self, recording: Recording) -> np.ndarray:
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
