"""Statistics over the last seconds before each record, at any time stamps."""

from __future__ import annotations

import numpy as np


class Trailing:
    """Windows (t_k − length, t_k] of a recording; they do not reach across gaps or backward steps of time."""

    def __init__(self, time_s: np.ndarray, length_s: float, gap_s: float = np.inf):
        """time_s: (N,), a missing one is that of the last record; a step over gap_s begins a new stretch."""
        n = len(time_s)
        time = np.asarray(time_s, dtype=float).copy()
        if n and np.isnan(time[0]):
            time[0] = 0.0
        known = np.maximum.accumulate(np.where(np.isfinite(time), np.arange(n), 0)) if n else np.zeros(0, int)
        time = time[known]
        step = np.diff(time)
        forward = step[step > 0.0]
        self.period_s = float(np.median(forward)) if len(forward) else 0.0
        breaks = np.concatenate([[True], (step < 0.0) | (step > gap_s)])[:n]
        stretch = np.cumsum(breaks) - 1
        first = np.flatnonzero(breaks)
        self.time = time
        self.end = np.arange(n)
        self.start = np.empty(n, dtype=np.int64)
        for k, begin in enumerate(first):
            stop = first[k + 1] if k + 1 < len(first) else n
            t = time[begin:stop]
            earliest = np.searchsorted(t, t - length_s + 1e-6 * self.period_s, "right")
            self.start[begin:stop] = begin + np.minimum(earliest, np.arange(stop - begin))
        since = time - time[first[stretch]] if n else time
        self.full = since >= length_s - 1.5 * self.period_s

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Maximum minus minimum (N,) in each window, missing values passed over; −inf where all are missing.

        A sparse table of maxima over spans of 2^j records: any window is the union of two such spans.
        """
        missing = ~np.isfinite(values)
        highest = self._maximum(np.where(missing, -np.inf, values))
        lowest = self._maximum(np.where(missing, -np.inf, -values))
        return highest + lowest

    def _maximum(self, values: np.ndarray) -> np.ndarray:
        n = len(values)
        length = self.end - self.start + 1
        level = np.frexp(length)[1] - 1  # floor(log2(length))
        result = np.full(n, -np.inf)
        table = values
        for j in range(int(level.max(initial=0)) + 1):
            if j:
                half = 1 << (j - 1)
                table = np.maximum(table[: len(table) - half], table[half:])
            rows = np.flatnonzero(level == j)
            result[rows] = np.maximum(table[self.start[rows]], table[self.end[rows] - (1 << j) + 1])
        return result

    def slope(self, values: np.ndarray) -> np.ndarray:
        """Least-squares slope per second (N,) in each window; 0 where fewer than two values are there.

        Summed lag by lag, with time counted from the window's end: differences of running sums over the whole
        recording would lose all digits after some hours.
        """
        known = np.isfinite(values)
        if not known.any():
            return np.zeros(len(values))
        x = np.where(known, values - np.mean(values[known]), 0.0)
        n, st, sx, stt, stx = np.zeros((5, len(values)))
        for lag in range(int(np.max(self.end - self.start, initial=0)) + 1):
            rows = np.flatnonzero((self.end - self.start >= lag) & known[np.maximum(self.end - lag, 0)])
            t, y = self.time[rows - lag] - self.time[rows], x[rows - lag]
            n[rows] += 1.0
            st[rows] += t
            sx[rows] += y
            stt[rows] += t * t
            stx[rows] += t * y
        denominator = n * stt - st * st
        good = denominator > 1e-9 * self.period_s**2
        return np.where(good, (n * stx - st * sx) / np.where(good, denominator, 1.0), 0.0)
