"""Damped Newton iteration over a whole batch of operating points at once.

Each pass evaluates the points that are still open; those that meet the tolerance leave the batch. Far from the
solution a pass gives the exact Jacobian with the balances, near it the balances alone at less than half the cost, and
the Jacobian of before serves (`open_points`). Nothing is asked of a balance but that it is continuous: where it has a
kink, steps gain less and the Jacobian is computed again. A point that does not converge is data: its residuals say
which balance failed.

The way of a point depends on nothing but that point, so its solution is the same to the last digit in every batch: of
more than `FEW_POINTS`, whose Jacobians come from the pass itself, and of fewer, where they come from differences.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from enginediag_cli.engine import elimination
from enginediag_cli.engine.dual import Array, Dual, Value, value
from enginediag_cli.engine.effort import TOLERANCE, Effort
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.open_points import SMALL, OpenPoints

DIFFERENCE = 1e-7  # of an unknown of order one
LATE = 4
"""Passes after which fresh Jacobians come from differences, in one pass with what needs none: few points need one then.
"""
SURE = 1e-12
"""Expected residual at which a point is taken to be solved and waits for the pass along all that is wanted, which all
points make together at the end: the expectation is right to a factor of about two, and outputs are carried from what is
left to zero by their derivatives."""
LEAST_POINTS = 1_000
"""Points of a pass that hide the overhead of calls."""
IN_CACHE = 36_000
"""Points × directions of a pass: the derivatives of some quantities, 0.3 MB each, stay in the cache of a core. Ten
thousand points along twenty directions take 1.5 times as long at once as in passes of this size, along eighty 2.4."""
FEW_POINTS = 40
"""Points up to which the overhead of calls costs more than computing them: Jacobians come from differences there."""


class Reader(Protocol):
    """Takes what is wanted of a solution from the pass that confirms it: derivatives along the leaves `along`."""

    @property
    def along(self) -> frozenset[str]: ...
    def read(self, e: Evaluation, rows: Array, points: Array) -> None:
        """`rows` of the evaluation, which are these points of the batch."""


@dataclass
class Solution:
    """Unknowns (nx, N), largest residual (N,), balances (nx, N) and passes used (N,); `read` (N,): points that the
    reader has; `tolerance`: the residual of a point that has converged."""

    x: Array
    residual: Array
    balances: Array
    passes: Array
    read: Array
    tolerance: float = TOLERANCE

    def note(self, p: OpenPoints, R: Array, norm: Array, passes: int | Array) -> None:
        """Keeps what is better than before."""
        at: Array | slice = slice(None) if len(p.index) == len(self.residual) else p.index
        self.passes[at] = passes
        better = norm < self.residual[at]
        those: Array | slice = slice(None)
        if not better.all():
            at, those = p.index[better], better
        self.x[:, at], self.balances[:, at], self.residual[at] = p.x[:, those], R[:, those], norm[those]

    def worst(self, point: int) -> int:
        """Index of the balance that is met least."""
        R = self.balances[:, point]
        return int(np.argmax(np.where(np.isfinite(R), np.abs(R), np.inf)))

    @property
    def converged(self) -> Array:
        return self.residual <= self.tolerance


def evaluate(
    network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array, wrt: frozenset[str]
) -> Evaluation:
    """One pass at unknowns x (nx, N)."""
    names = [u.name for u in network.unknowns()]
    leaves = network.leaves(inputs, parameters, dict(zip(names, x, strict=True)))
    e = Evaluation(network.gas, x.shape[1], leaves, wrt, hooks=network.hooks, derived=network.derived)
    with np.errstate(all="ignore"):
        network.evaluate(e)
    return e


def directed(e: Evaluation, rows: Mapping[str, Value], names: tuple[str, ...]) -> Array:
    """Derivatives of `rows` with respect to leaves `names`, shape (rows, names, N)."""
    out = np.zeros((len(rows), len(names), e.size))
    source = np.array([e.directions.get(name, -1) for name in names])
    for row, y in enumerate(rows.values()):
        if isinstance(y, Dual):
            use = (source >= 0) & (source < len(y.d))
            out[row, use] = y.d[source[use]]
    return out


def newton(
    network: Network,
    inputs: Mapping[str, Value],
    parameters: Mapping[str, Value],
    x: Array,
    effort: Effort | None = None,
    reader: Reader | None = None,
) -> Solution:
    """Solves the balances from starting unknowns x (nx, N); inputs and parameters are floats or (N,).

    What the reader wants of the points that converge is handed to it, where the last pass gives it; the others are left
    to the caller.
    """
    effort = effort or Effort()
    unknowns = network.unknowns()
    lower = np.array([[u.lower] for u in unknowns])
    upper = np.array([[u.upper] for u in unknowns])
    n = x.shape[1]
    best = Solution(
        x.copy(),
        np.full(n, np.inf),
        np.full_like(x, np.nan),
        np.zeros(n, dtype=int),
        np.zeros(n, dtype=bool),
        max(TOLERANCE, effort.aim),
    )
    p = OpenPoints.at(x)
    balances = _Balances(network, inputs, parameters, effort, reader, n)
    waiting = np.zeros(n, dtype=bool)
    for iteration in range(effort.max_iterations):
        R = balances.at(p, best, effort.by_differences or iteration >= LATE)
        norm = np.abs(R).max(axis=0)
        norm[~np.isfinite(norm)] = np.inf
        best.note(p, R, norm, iteration + 1)
        left = norm > effort.aim
        if not left.any():
            break
        keep = p.step_on(R, norm, effort) & p.hopeful(norm) & left
        if not keep.any():
            break
        p = p.kept(keep)
        p.x = np.clip(p.base + p.step, lower, upper)
        # what was cut short has not gone where its Jacobian leads
        p.fresh |= (p.x != p.base + p.step).any(axis=0)
        sure = (
            ~p.fresh & (p.expected < SURE) if reader is not None and reader.along else np.zeros(len(norm), dtype=bool)
        )
        if sure.any():
            waiting[p.index[sure]], best.x[:, p.index[sure]] = True, p.x[:, sure]
            if sure.all():
                break
            p = p.kept(~sure)
    if waiting.any():
        _confirm(balances, best, np.flatnonzero(waiting))
    return best


def _confirm(balances: _Balances, best: Solution, waiting: Array) -> None:
    """One pass along all that is wanted at points that are expected to be solved; those that are not go on without."""
    assert balances.reader is not None
    best.residual[waiting] = np.inf
    for some in blocks(waiting, balances.reader.along):
        p = OpenPoints.at(best.x[:, some])
        p.index = some
        R = balances.wanted(p, best)
        norm = np.abs(R).max(axis=0)
        best.note(p, R, np.where(np.isfinite(norm), norm, np.inf), best.passes[some] + 1)
    rest = waiting[~(best.residual[waiting] <= TOLERANCE)]
    if rest.size:
        b = balances
        found = newton(b.network, take(b.inputs, rest), take(b.parameters, rest), best.x[:, rest], b.effort)
        best.x[:, rest], best.residual[rest], best.balances[:, rest] = found.x, found.residual, found.balances
        best.passes[rest] += found.passes


@dataclass(frozen=True)
class _Balances:
    """Balances of open points, each computed as its kind says; confirmed points go to the reader."""

    network: Network
    inputs: Mapping[str, Value]
    parameters: Mapping[str, Value]
    effort: Effort
    reader: Reader | None
    size: int

    def at(self, p: OpenPoints, best: Solution, by_differences: bool) -> Array:
        """Balances (nx, n) of the points, whose Jacobians are put where they belong."""
        if by_differences:
            return self._by_differences(p, best)
        R = np.empty_like(p.x)
        for rows in blocks(np.flatnonzero(p.fresh), range(len(p.x))):
            self._pass(p, _span(rows), R, True, best)
        rest = np.flatnonzero(~p.fresh)
        if rest.size:
            self._pass(p, _span(rest), R, False, best)
        return R

    def _pass(self, p: OpenPoints, here: Array | slice, R: Array, fresh: bool, best: Solution) -> None:
        """One pass at some of the open points, with fresh Jacobians or without."""
        names = tuple(u.name for u in self.network.unknowns()) if fresh else ()
        e = evaluate(self.network, *self._leaves(p.index[here]), p.x[:, here], frozenset(names))
        R[:, here] = balances(e)
        if fresh:
            p.LU[:, :, here], p.order[:, here] = elimination.factors(directed(e, e.balances, names))
            p.earlier[:, here] = 0.0
        self._read(e, R[:, here], np.arange(e.size), p.index[here], best)

    def _by_differences(self, p: OpenPoints, best: Solution) -> Array:
        """One pass at all open points, and beside those that need a fresh Jacobian for forward differences."""
        nx, n = p.x.shape
        fresh, rest = np.flatnonzero(p.fresh), np.flatnonzero(~p.fresh)
        f = fresh.size
        x, rows = p.x, np.arange(n)
        u, t = self._leaves(p.index) if not f else (self.inputs, self.parameters)
        if f:
            here = p.x[:, fresh]
            h = DIFFERENCE * np.maximum(np.abs(here), SMALL)
            wide = np.repeat(here[:, None, :], nx + 1, axis=1)
            wide[np.arange(nx), np.arange(1, nx + 1)] += h
            x = np.concatenate([wide.reshape(nx, -1), p.x[:, rest]], axis=1)
            index = np.concatenate([np.tile(p.index[fresh], nx + 1), p.index[rest]])
            u, t = take(u, index), take(t, index)
            rows[fresh], rows[rest] = np.arange(f), np.arange((nx + 1) * f, x.shape[1])
        e = evaluate(self.network, u, t, x, frozenset())
        found = balances(e)
        R = found[:, rows]
        if f:
            with np.errstate(invalid="ignore", over="ignore"):
                beside = found[:, : (nx + 1) * f].reshape(-1, nx + 1, f)
                J = (beside[:, 1:] - beside[:, :1]) / h
            if self.effort.by_differences:
                p.LU[:, :, fresh] = J
            else:
                p.LU[:, :, fresh], p.order[:, fresh] = elimination.factors(J)
            p.earlier[:, fresh] = 0.0
        self._read(e, R, rows, p.index, best)
        return R

    def wanted(self, p: OpenPoints, best: Solution) -> Array:
        """Balances (nx, n) of points from a pass along all that the reader wants, who has it where they are met."""
        assert self.reader is not None
        e = evaluate(self.network, *self._leaves(p.index), p.x, self.reader.along)
        R = balances(e)
        self._hand_over(e, R, np.arange(e.size), p.index, TOLERANCE, best)
        return R

    def _leaves(self, index: Array) -> tuple[Mapping[str, Value], Mapping[str, Value]]:
        if len(index) == self.size:  # points stay in order
            return self.inputs, self.parameters
        return take(self.inputs, index), take(self.parameters, index)

    def _read(self, e: Evaluation, R: Array, rows: Array, index: Array, best: Solution) -> None:
        """Lets the reader have what needs no derivatives."""
        if self.reader is not None and not self.reader.along:
            self._hand_over(e, R, rows, index, self.effort.aim, best)

    def _hand_over(self, e: Evaluation, R: Array, rows: Array, index: Array, tolerance: float, best: Solution) -> None:
        """Points `index`, which are these rows of the evaluation, where their balances R are met."""
        met = np.flatnonzero((np.abs(R) <= tolerance).all(axis=0))
        if met.size and self.reader is not None:
            self.reader.read(e, rows[met], index[met])
            best.read[index[met]] = True


def balances(e: Evaluation) -> Array:
    """Values of all balances (nx, n)."""
    R = np.empty((len(e.balances), e.size))
    for row, b in zip(R, e.balances.values(), strict=True):
        row[:] = value(b)
    return R


def _span(rows: Array) -> Array | slice:
    """Rows that follow each other as a slice, which copies nothing."""
    first, last = int(rows[0]), int(rows[-1])
    return slice(first, last + 1) if last - first + 1 == len(rows) else rows


def blocks(points: Array, along: Collection[Any]) -> Iterator[Array]:
    """Points in parts whose derivatives along so many directions stay in the cache."""
    size = max(IN_CACHE // max(len(along), 1), LEAST_POINTS)
    for k in range(0, len(points), size):
        yield points[k : k + size]


def take(leaves: Mapping[str, Value], index: Array) -> dict[str, Value]:
    return {k: v[index] if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}


def repeated(leaves: Mapping[str, Value], times: int) -> dict[str, Value]:
    """Of a batch so many times one after the other."""
    return {k: np.tile(v, times) if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}
