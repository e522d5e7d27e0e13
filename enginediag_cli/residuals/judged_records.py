"""Records that are judged, as they wait for the end of their window: in memory, or in a file where a window is long.

A window of any length costs memory for `IN_MEMORY` records. The file has no name, and is gone with the run: it takes 8
bytes a value, some 200 bytes a record, in the folder for temporary files.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import IO

import numpy as np

IN_MEMORY = 50_000
"""Records of one window that wait in memory: some ten megabytes."""


@dataclass(frozen=True)
class JudgedRecords:
    """n records in order: inputs, column -> (n,); readings y (n, m), NaN where missing; lags (n,): steps since the
    record before, inf where they are unrelated."""

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray
    lags: np.ndarray

    def __len__(self) -> int:
        return len(self.y)


class StoredRecords:
    """As `JudgedRecords`, in one matrix (n, inputs + m + 1) or, once moved there, in a file."""

    def __init__(self, records: JudgedRecords):
        self._columns = tuple(records.inputs)
        self._values: np.ndarray | None = np.column_stack([*records.inputs.values(), records.y, records.lags])
        self._width = self._values.shape[1]
        self._file: IO[bytes] | None = None
        self._first = 0
        self.count = len(records)

    @property
    def in_memory(self) -> bool:
        return self._values is not None

    def move(self, file: IO[bytes]) -> None:
        """To the end of a file."""
        assert self._values is not None
        self._first = file.seek(0, os.SEEK_END)
        file.write(np.ascontiguousarray(self._values).data)
        file.flush()
        self._file, self._values = file, None

    def read(self, first: int, stop: int) -> np.ndarray:
        """The rows first … stop − 1."""
        if self._values is not None:
            return self._values[first:stop]
        assert self._file is not None
        size, start = 8 * self._width, self._first + first * 8 * self._width
        if hasattr(os, "pread"):  # by place: the file's own position is shared with copies of this process
            text = os.pread(self._file.fileno(), (stop - first) * size, start)
        else:
            self._file.seek(start)
            text = self._file.read((stop - first) * size)
        return np.frombuffer(text).reshape(stop - first, self._width)

    def records(self, rows: np.ndarray) -> JudgedRecords:
        """What rows (k, inputs + m + 1) say."""
        d = len(self._columns)
        return JudgedRecords(dict(zip(self._columns, rows[:, :d].T, strict=True)), rows[:, d:-1], rows[:, -1])


class Keeping:
    """Moves what waits of long windows to a file."""

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None

    def __call__(self, waiting: Sequence[StoredRecords]) -> None:
        held = [stored for stored in waiting if stored.in_memory]
        if sum(stored.count for stored in held) <= IN_MEMORY:
            return
        if self._file is None or not any(not stored.in_memory for stored in waiting):
            import tempfile  # few records need none, and it takes a while to import

            self._file = tempfile.TemporaryFile(prefix="enginediag-")
        for stored in held:
            stored.move(self._file)


class RecordsOfWindow:
    """The judged records of one window, from what is stored of its pieces in order."""

    def __init__(self, stored: Sequence[StoredRecords]):
        self._stored = stored
        self._first = np.concatenate([[0], np.cumsum([part.count for part in stored])]).astype(int)

    def __len__(self) -> int:
        return int(self._first[-1])

    def read(self, spans: Sequence[tuple[int, int]]) -> JudgedRecords:
        """Those of the spans (first, one after the last) in turn."""
        rows = [self._stored[0].read(0, 0)]
        for first, stop in spans:
            k = int(np.searchsorted(self._first, first, side="right")) - 1
            while first < stop:
                base, end = int(self._first[k]), min(int(self._first[k + 1]), stop)
                if end > first:
                    rows.append(self._stored[k].read(first - base, end - base))
                first, k = max(end, first), k + 1
        return self._stored[0].records(np.concatenate(rows))

    @property
    def all(self) -> JudgedRecords:
        return self.read([(0, len(self))])
