"""Repeated rows: records of a flight that are there already, to the last digit and with the same time.

Only a record whose time does not go on can be one, so a file in order costs no search. Without `time_s` equal rows
are no proof (hourly means of a coarse sensor) and none is called repeated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from enginediag_cli.recordings.table import Recording

SEGMENT = 65_536
"""Rows of a segment; half a megabyte."""
SEGMENTS = 16
"""Rows are remembered in sorted segments, 8 bytes a row; the last SEGMENT · SEGMENTS rows, about a million (8 MB), so
that memory stays bounded. A copy further back than that is not seen."""

_PRIME = np.uint64(0x9E3779B97F4A7C15)
"""2⁶⁴ over the golden ratio, odd: Knuth's multiplicative hashing spreads neighbouring numbers over all bits."""
_SHIFT = np.uint64(29)
"""Folds high bits down between columns, so that low bits of the next one meet them."""


@dataclass
class Repeats:
    """Finds repeated rows of one file, given in chunks of any size."""

    _latest: dict[int, float] = field(default_factory=dict)
    _segments: list[np.ndarray] = field(default_factory=list)
    _open: list[np.ndarray] = field(default_factory=list)
    _open_rows: int = 0

    def add(self, recording: Recording, flights: np.ndarray) -> np.ndarray:
        """Mask (N,) of the records that repeat an earlier one of their flight number in `flights` (N,)."""
        found = np.zeros(len(recording), dtype=bool)
        if "time_s" not in recording:
            return found
        time, rows = recording["time_s"], _hashes(recording, flights)
        start = 0
        while start < len(rows):  # never across the end of a segment: what is remembered must not depend on chunks
            stop = min(len(rows), start + SEGMENT - self._open_rows)
            piece = slice(start, stop)
            candidates = np.flatnonzero(self._not_later(time[piece], flights[piece]))
            if candidates.size:
                found[piece] = self._among_earlier(rows[piece], candidates)
            self._remember(rows[piece])
            start = stop
        return found

    def _not_later(self, time: np.ndarray, flights: np.ndarray) -> np.ndarray:
        """Records (n,) whose time is not later than every one before in their flight."""
        result = np.zeros(len(time), dtype=bool)
        known = np.where(np.isfinite(time), time, -np.inf)
        order = np.argsort(flights, kind="stable")
        edges = [0, *(np.flatnonzero(np.diff(flights[order])) + 1).tolist(), len(order)]
        for begin, end in pairwise(edges):
            rows = order[begin:end]
            key = int(flights[rows[0]])
            before = np.maximum.accumulate(np.concatenate([[self._latest.get(key, -np.inf)], known[rows]]))
            result[rows] = (known[rows] <= before[:-1]) & np.isfinite(time[rows])
            self._latest[key] = float(before[-1])
        return result

    def _among_earlier(self, rows: np.ndarray, candidates: np.ndarray) -> np.ndarray:
        wanted = rows[candidates]
        seen = np.zeros(len(wanted), dtype=bool)
        for segment in self._segments:
            place = np.minimum(np.searchsorted(segment, wanted), len(segment) - 1)
            seen |= segment[place] == wanted
        if self._open:
            self._open = [np.concatenate(self._open)]
            seen |= np.isin(wanted, self._open[0])
        first = np.unique(rows, return_index=True)
        seen |= first[1][np.searchsorted(first[0], wanted)] < candidates
        found = np.zeros(len(rows), dtype=bool)
        found[candidates] = seen
        return found

    def _remember(self, rows: np.ndarray) -> None:
        self._open.append(rows)
        self._open_rows += len(rows)
        if self._open_rows == SEGMENT:
            self._segments = [*self._segments[1 - SEGMENTS :], np.sort(np.concatenate(self._open))]
            self._open, self._open_rows = [], 0


def _hashes(recording: Recording, flights: np.ndarray) -> np.ndarray:
    """(N,) uint64 of all numbers of each record and its flight; equal for equal rows, missing values included."""
    rows = flights.astype(np.uint64) * _PRIME
    for name in sorted(recording.columns):
        values = recording[name] + 0.0  # −0 becomes 0
        bits = np.where(np.isnan(values), np.nan, values).view(np.uint64)
        rows = (rows ^ bits) * _PRIME
        rows ^= rows >> _SHIFT
    return rows
