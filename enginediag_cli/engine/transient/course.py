"""What moving engines are asked for along time: runs of records, their inputs straight between corners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.dual import Array

STRAIGHT = 1e-6
"""Of the largest value of a column: records that lie as near as that to a straight line between others bend nothing."""


@dataclass(frozen=True)
class Course:
    """Corners of all runs one after the other: `time` (C,) s, columns (C,) by name; run r has corners `first[r]` to
    `last[r]`, both included."""

    time: Array
    columns: Mapping[str, Array]
    first: Array
    last: Array

    def at(self, corner: Array, time: Array) -> dict[str, Array]:
        """Columns (n,) at `time` (n,), each between its `corner` (n,) and the next one."""
        span = self.time[corner + 1] - self.time[corner]
        share = (time - self.time[corner]) / span
        return {c: v[corner] + (v[corner + 1] - v[corner]) * share for c, v in self.columns.items()}


def course_of(runs: Sequence[tuple[Array, Mapping[str, Array]]]) -> Course:
    """From rising times (C,) and columns (C,) of each run; every run has two corners at least."""
    names = list(runs[0][1])
    scale = {c: max(max(float(np.abs(of[c]).max(initial=0.0)) for _, of in runs), 1e-300) for c in names}
    times, columns, first, last = [], [], [], []
    total = 0
    for time, of in runs:
        kept = corners(time, np.stack([of[c] / scale[c] for c in names]))
        t = time[kept]
        if len(kept) == 1:  # one record alone: it stands still
            kept, t = np.repeat(kept, 2), np.array([t[0], t[0] + 1.0])
        times.append(t)
        columns.append({c: of[c][kept] for c in names})
        first.append(total)
        total += len(kept)
        last.append(total - 1)
    table = {c: np.concatenate([of[c] for of in columns]) for c in names}
    return Course(np.concatenate(times), table, np.array(first), np.array(last))


def corners(time: Array, table: Array) -> Array:
    """Records of (n,) that straight lines must pass through, so that none of `table` (columns, n) lies further off than
    STRAIGHT: the first, the last, and of each stretch between two the one that lies furthest off, until none does
    (Ramer 1972, Douglas and Peucker 1973)."""
    n = len(time)
    kept = np.zeros(n, dtype=bool)
    kept[[0, n - 1]] = True
    open_stretches = [(0, n - 1)]
    while open_stretches:
        a, b = open_stretches.pop()
        if b - a < 2:
            continue
        share = (time[a + 1 : b] - time[a]) / (time[b] - time[a])
        line = table[:, a, None] + (table[:, b] - table[:, a])[:, None] * share
        off = np.abs(table[:, a + 1 : b] - line).max(axis=0, initial=0.0)
        if not off.max() <= STRAIGHT:
            k = a + 1 + int(off.argmax())
            kept[k] = True
            open_stretches += [(a, k), (k, b)]
    return np.flatnonzero(kept)
