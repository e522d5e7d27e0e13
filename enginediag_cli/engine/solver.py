"""Damped Newton iteration over a whole batch of operating points at once.

Each pass evaluates the points that are still open; those that meet the tolerance leave the batch. Far from the
solution a pass gives the exact Jacobian J with the balances R. Near it the balances alone are computed, at half the
cost, and J of before is corrected by what the last steps s, s' have shown of it (Broyden's update):

    t = -J⁻¹ R,      t' = t + s' (s·t) / s·s,      step = t' / (1 - s'·t' / s'·s'),

until a step gains less than it should: then it is computed again (C. T. Kelley, Iterative Methods for Linear and
Nonlinear Equations, 1995, ch. 7). A step is shortened so that no unknown moves by more than `LARGEST_STEP` of itself,
and halved again where the residual grew. A point that does not converge is data: its residuals say which
balance failed. The way of a point depends on nothing but that point, so its solution is the same to the last digit
in every batch of more than `FEW_POINTS`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from enginediag_cli.engine import elimination
from enginediag_cli.engine.dual import Array, Dual, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network

TOLERANCE = 1e-10  # on every balance, all of order one
AIM = 0.01
"""Share of TOLERANCE that the iteration aims at, so that differences of solutions 1e-5 apart are good to
a ten-millionth. A point that cannot come nearer, for rounding, and meets TOLERANCE is solved all the same."""
MAX_ITERATIONS = 60
"""Passes at most: a good start needs a few; what has not converged by then does not. Judgement."""
LARGEST_STEP = 0.4
"""Largest change of an unknown in one step, as a share of itself: beyond it the linear model says little about maps.
Judgement."""
SMALL = 0.05  # unknowns are of order one; smaller ones may move by this much of LARGEST_STEP
MAX_HALVINGS = 6
"""A step a sixty-fourth as long that still gains nothing is taken, since it may lead out of a fold. Judgement."""
NEAR = 0.03
"""Largest residual from which a full step with the Jacobian there is expected to gain so much that the next pass needs
none. A disappointed point costs one pass."""
GAINS = 0.3
"""A step that leaves more than this share of the residual says that the Jacobian is no longer good: so much is gained
by three passes without it that cost as much as one with it."""
LARGEST_SHARE = 0.5
"""Largest s'·t'/s'·s' that is believed: near 1 the step would have no end."""
TINY = 1e-300
"""In place of a square that is zero, of a step that was not taken."""
SURE = 4e-11
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


@dataclass(frozen=True)
class Effort:
    """How far an iteration goes: passes at most, largest residual left (None: by AIM); `by_differences`: with Jacobians
    from forward differences in one widened batch, which for a few points costs one plain pass."""

    max_iterations: int = MAX_ITERATIONS
    tolerance: float | None = None
    by_differences: bool = False

    @property
    def aim(self) -> float:
        """The largest residual at which a point is left alone."""
        return AIM * TOLERANCE if self.tolerance is None else self.tolerance


@dataclass
class Solution:
    """Unknowns (nx, N), largest residual (N,), balances (nx, N) and passes used (N,); `read` (N,): points that the
    reader has."""

    x: Array
    residual: Array
    balances: Array
    passes: Array
    read: Array

    def note(self, p: _OpenPoints, R: Array, norm: Array, passes: int | Array) -> None:
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
        return self.residual <= TOLERANCE


def evaluate(
    network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array, wrt: frozenset[str]
) -> Evaluation:
    """One pass at unknowns x (nx, N)."""
    names = [u.name for u in network.unknowns()]
    leaves = network.leaves(inputs, parameters, dict(zip(names, x, strict=True)))
    e = Evaluation(network.gas, x.shape[1], leaves, wrt, hooks=network.hooks)
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
        x.copy(), np.full(n, np.inf), np.full_like(x, np.nan), np.zeros(n, dtype=int), np.zeros(n, dtype=bool)
    )
    p = _OpenPoints.at(x)
    balances = _Balances(network, inputs, parameters, effort, reader, n)
    waiting = np.zeros(n, dtype=bool)
    for iteration in range(effort.max_iterations):
        R = balances.at(p, best)
        norm = np.abs(R).max(axis=0)
        norm[~np.isfinite(norm)] = np.inf
        best.note(p, R, norm, iteration + 1)
        left = norm > effort.aim
        if not left.any():
            break
        if not left.all():
            p, R, norm = p.kept(left), R[:, left], norm[left]
        keep = p.step_on(R, norm, effort)
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
        p = _OpenPoints.at(best.x[:, some])
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


@dataclass
class _OpenPoints:
    """Points that have not converged: where the last accepted step began, the step and the one before; LU (nx, nx, n)
    and order (nx, n) of the Jacobian, or the Jacobian of few points in place of LU; whether the next pass is to give a
    fresh one, and what residual is expected of it."""

    index: Array
    x: Array
    base: Array
    step: Array
    earlier: Array
    base_norm: Array
    halvings: Array
    LU: Array
    order: Array
    fresh: Array
    expected: Array

    @staticmethod
    def at(x: Array) -> _OpenPoints:
        nx, n = x.shape
        return _OpenPoints(
            index=np.arange(n),
            x=x.copy(),
            base=x.copy(),
            step=np.zeros_like(x),
            earlier=np.zeros_like(x),
            base_norm=np.full(n, np.inf),
            halvings=np.zeros(n, dtype=int),
            LU=np.zeros((nx, nx, n)),
            order=np.zeros((nx, n), dtype=int),
            fresh=np.ones(n, dtype=bool),
            expected=np.full(n, np.inf),
        )

    def step_on(self, R: Array, norm: Array, effort: Effort) -> Array:
        """The next step of every point from its balances R (nx, n) and the largest of them, norm (n,); which points
        stay open (n,)."""
        # a step that made things worse is halved, a few times in a row
        rejected = (norm > self.base_norm) & (self.halvings < MAX_HALVINGS)
        stalled = (norm <= TOLERANCE) & (norm > GAINS * self.base_norm)
        going = ~rejected & ~stalled & np.isfinite(norm)
        disappointed = going & ~self.fresh & (norm > GAINS * self.base_norm)
        accepted = going & ~disappointed
        if accepted.any():
            self._accept(slice(None) if accepted.all() else np.flatnonzero(accepted), R, norm, effort)
        self.step[:, rejected] *= 0.5
        self.halvings[rejected] += 1
        # asked again where it is, with the Jacobian
        self.base[:, disappointed], self.step[:, disappointed] = self.x[:, disappointed], 0.0
        self.base_norm[disappointed] = np.inf
        self.fresh |= rejected | disappointed
        return np.asarray((going | rejected) & ~stalled & np.isfinite(self.step).all(axis=0))

    @np.errstate(all="ignore")  # what cannot be solved leaves the batch
    def _accept(self, taken: Array | slice, R: Array, norm: Array, effort: Effort) -> None:
        """Steps of the accepted points."""
        fresh, norm, before, x = self.fresh[taken], norm[taken], self.base_norm[taken], self.x[:, taken]
        if effort.by_differences:
            step = -elimination.directly(self.LU[:, :, taken], R[:, taken])
        else:
            step = -elimination.substituted(self.LU[:, :, taken], self.order[:, taken], R[:, taken])
        if not fresh.all():
            first, last = self.earlier[:, taken], self.step[:, taken]
            # a step is corrected by those since its Jacobian was computed
            step += last * np.where(
                fresh, 0.0, (first * step).sum(axis=0) / np.maximum((first * first).sum(axis=0), TINY)
            )
            share = np.where(fresh, 0.0, (last * step).sum(axis=0) / (last * last).sum(axis=0))
            step /= np.where(share < LARGEST_SHARE, 1.0 - share, 1.0)
            self.earlier[:, taken] = np.where(fresh, 0.0, last)
        largest = np.max(np.abs(step) / np.maximum(np.abs(x), SMALL), axis=0)
        step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, TINY))
        self.base[:, taken], self.step[:, taken] = x, step
        self.base_norm[taken], self.halvings[taken] = norm, 0
        # with its own Jacobian the next residual is about the square of this, with the last one's it shrinks as before
        expected = norm * np.where(fresh, norm, norm / before)
        # of a few points a Jacobian costs next to nothing
        without = (norm < NEAR) if not effort.by_differences else (expected < SURE)
        self.fresh[taken] = ~without | (largest > LARGEST_STEP)
        self.expected[taken] = expected

    def kept(self, keep: Array) -> _OpenPoints:
        if keep.all():
            return self
        return _OpenPoints(*(getattr(self, f.name)[..., keep] for f in fields(self)))


@dataclass(frozen=True)
class _Balances:
    """Balances of open points, each computed as its kind says; confirmed points go to the reader."""

    network: Network
    inputs: Mapping[str, Value]
    parameters: Mapping[str, Value]
    effort: Effort
    reader: Reader | None
    size: int

    def at(self, p: _OpenPoints, best: Solution) -> Array:
        """Balances (nx, n) of the points, whose Jacobians are put where they belong."""
        R = np.empty_like(p.x)
        if self.effort.by_differences:
            self._pass(p, slice(None), R, bool(p.fresh.any()), best)
            return R
        for rows in blocks(np.flatnonzero(p.fresh), range(len(p.x))):
            self._pass(p, rows, R, True, best)
        rest = np.flatnonzero(~p.fresh)
        if rest.size:
            self._pass(p, slice(None) if rest.size == len(p.index) else rest, R, False, best)
        return R

    def _pass(self, p: _OpenPoints, here: Array | slice, R: Array, fresh: bool, best: Solution) -> None:
        """One pass at some of the open points, with fresh Jacobians or without."""
        u, t = self._leaves(p.index[here])
        if fresh:
            e, R[:, here], J = self._with_jacobian(u, t, p.x[:, here])
            if self.effort.by_differences:
                p.LU[:, :, here] = J
            else:
                p.LU[:, :, here], p.order[:, here] = elimination.factors(J)
            p.fresh[here], p.earlier[:, here] = True, 0.0
        else:
            e = evaluate(self.network, u, t, p.x[:, here], frozenset())
            R[:, here] = _balances(e)
        if self.reader is not None and not self.reader.along:
            self._read(e, R[:, here], self.effort.aim, p.index[here], best)

    def wanted(self, p: _OpenPoints, best: Solution) -> Array:
        """Balances (nx, n) of points from a pass along all that the reader wants, who has it where they are met."""
        assert self.reader is not None
        e = evaluate(self.network, *self._leaves(p.index), p.x, self.reader.along)
        R = _balances(e)
        self._read(e, R, TOLERANCE, p.index, best)
        return R

    def _leaves(self, index: Array) -> tuple[Mapping[str, Value], Mapping[str, Value]]:
        if len(index) == self.size:
            return self.inputs, self.parameters
        return take(self.inputs, index), take(self.parameters, index)

    def _read(self, e: Evaluation, R: Array, tolerance: float, index: Array, best: Solution) -> None:
        met = np.flatnonzero((np.abs(R) <= tolerance).all(axis=0))
        if met.size and self.reader is not None:
            self.reader.read(e, met, index[met])
            best.read[index[met]] = True

    def _with_jacobian(
        self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array
    ) -> tuple[Evaluation, Array, Array]:
        """The pass, its balances (nx, n) and their derivatives (nx, nx, n)."""
        if not self.effort.by_differences:
            names = tuple(u.name for u in self.network.unknowns())
            e = evaluate(self.network, inputs, parameters, x, frozenset(names))
            return e, _balances(e), directed(e, e.balances, names)
        nx, n = x.shape
        h = 1e-7 * np.maximum(np.abs(x), SMALL)
        wide = np.repeat(x[:, None, :], nx + 1, axis=1)
        wide[np.arange(nx), np.arange(1, nx + 1)] += h
        u, t = _repeated(inputs, nx + 1), _repeated(parameters, nx + 1)
        e = evaluate(self.network, u, t, wide.reshape(nx, -1), frozenset())
        R = _balances(e).reshape(-1, nx + 1, n)
        with np.errstate(invalid="ignore", over="ignore"):
            return e, R[:, 0], (R[:, 1:] - R[:, :1]) / h


def _balances(e: Evaluation) -> Array:
    """Values of all balances (nx, n)."""
    R = np.empty((len(e.balances), e.size))
    for row, b in zip(R, e.balances.values(), strict=True):
        row[:] = value(b)
    return R


def blocks(points: Array, along: Collection[str]) -> Iterator[Array]:
    """Points in parts whose derivatives along so many directions stay in the cache."""
    size = max(IN_CACHE // max(len(along), 1), LEAST_POINTS)
    for k in range(0, len(points), size):
        yield points[k : k + size]


def take(leaves: Mapping[str, Value], index: Array) -> dict[str, Value]:
    return {k: v[index] if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}


def _repeated(leaves: Mapping[str, Value], times: int) -> dict[str, Value]:
    return {k: np.tile(v, times) if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}
