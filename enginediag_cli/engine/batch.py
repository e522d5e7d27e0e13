"""The points of one prediction on their way to solutions: in chunks, each of which several processes may share.

The way of a point to its solution depends on nothing but that point, so whoever solves it finds the same to the last
digit. Only what is tried again begins from its neighbours: a chunk that holds such points is done by one process.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.outputs import Outputs, Read
from enginediag_cli.engine.prediction import NOT_CONVERGED
from enginediag_cli.engine.strategy import Strategy, Tries
from enginediag_cli.side_by_side import processes, resident_MB, side_by_side

CHUNK = 10_000
"""Most points that are solved together: enough to hide the overhead of calls, few enough for memory."""
SHARE, SHARE_PER_MB = 300, 4.0
"""Fewest points for which another process is begun, and how many more for each megabyte that this one holds: a copy of
a small process takes as long as some hundred points, and one of a large process has its tables of memory to copy."""


@dataclass(frozen=True)
class Shared:
    """What another process found of some points: unknowns, residuals, passes, and what was read."""

    x: Array
    residual: Array
    passes: Array
    read: Read


class Batch:
    """Points (N,) with parameters `theta` of an engine, read by `out`; x (nx, N), residual (N,), passes (N,). unmet: of
    points that did not converge, the index of the balance that is met least."""

    def __init__(self, strategy: Strategy, points: Mapping[str, Any], theta: Mapping[str, Any], out: Outputs):
        self.strategy, self.points, self.theta, self.out = strategy, points, theta, out
        size = len(out.status)
        self.x = np.full((len(strategy.network.unknowns()), size), np.nan)
        self.residual, self.passes = np.full(size, np.inf), np.zeros(size, dtype=int)
        self.unmet: dict[int, int] = {}

    def solve(self, valid: Array, start: Array | None, tries: Tries) -> None:
        """The points valid (N,), from unknowns `start` (nx, N), or None."""
        if start is None:
            self.strategy.prepare(self.points, valid)
        for at in _chunks(np.flatnonzero(valid), CHUNK):
            if not self._by_several(at, start, tries):
                self._by_one(at, start, tries)

    def _by_one(self, at: Array, start: Array | None, tries: Tries) -> None:
        u, t, first = self._from(at, start)
        self._finish(at, self.strategy.solve(u, t, first, self.out.of(at), tries))

    def _by_several(self, at: Array, start: Array | None, tries: Tries) -> bool:
        """Whether several processes solved these points."""
        n = processes(len(at) // SHARE)
        if n > 1:  # seldom so, and to ask for the memory takes time
            n = processes(int(len(at) / (SHARE + SHARE_PER_MB * resident_MB())))
        if n == 1:
            return False
        parts = np.array_split(at, n)
        found = side_by_side(lambda k: self._share(parts[k], start, tries), n)
        shares = [share for share in found if share is not None]
        if len(shares) < n:
            self.out.forget(at)
            return False
        for part, share in zip(parts, shares, strict=True):
            self.x[:, part], self.residual[part], self.passes[part] = share.x, share.residual, share.passes
            self.out.take(part, share.read)
        return True

    def _share(self, at: Array, start: Array | None, tries: Tries) -> Shared | None:
        """None where not all of the points converge at once."""
        u, t, first = self._from(at, start)
        solved = self.strategy.first(u, t, first, self.out.of(at), tries)
        if not solved.converged.all():
            return None
        self._finish(at, solved)
        return Shared(self.x[:, at], self.residual[at], self.passes[at], self.out.part(at))

    def _from(self, at: Array, start: Array | None) -> tuple[Mapping[str, Any], Mapping[str, Any], Array | None]:
        return solver.take(self.points, at), solver.take(self.theta, at), None if start is None else start[:, at]

    def _finish(self, at: Array, solved: solver.Solution) -> None:
        """Takes over what was found, and reads what is not read yet."""
        out = self.out
        self.x[:, at], self.residual[at], self.passes[at] = solved.x, solved.residual, solved.passes
        failed = ~solved.converged
        out.status[at[failed]] = NOT_CONVERGED
        self.unmet |= {int(at[k]): solved.worst(k) for k in np.flatnonzero(failed).tolist()}
        reader = out.of(at)
        rest = np.flatnonzero(solved.converged & ~solved.read)
        for some in solver.blocks(rest, out.along):
            u, t, _ = self._from(at[some], None)
            e = solver.evaluate(self.strategy.network, u, t, solved.x[:, some], out.along)
            reader.read(e, np.arange(some.size), some)


def _chunks(index: Array, size: int) -> Iterator[Array]:
    for k in range(0, len(index), size):
        yield index[k : k + size]
