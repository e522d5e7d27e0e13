"""Damped Newton iteration over a whole batch of operating points at once.

Each pass evaluates the points that have not converged (`OpenPoints`); those that meet the tolerance leave the batch.
Far from the solution a pass gives the balances R with their exact Jacobian J, and the step is −J⁻¹ R. Near it a pass
gives the balances alone at less than half the cost, and the earlier J is corrected by what the last steps s, s' have
shown of it (Broyden's update):

    t = -J⁻¹ R,      t' = t + s' (s·t) / s·s,      step = t' / (1 - s'·t' / s'·s'),

or, for few points, J itself is updated, until a step gains less than it should (C. T. Kelley, Iterative Methods for
Linear and Nonlinear Equations, 1995, ch. 7). A step is shortened so that no unknown moves by more than `LARGEST_STEP`
of itself, and halved again where the residual grew. Balances need only be continuous: at a kink steps gain less and the
Jacobian is computed again. A point that does not converge is a result too: its residuals name the balance that failed.

The iteration of a point depends on that point alone, so its solution has the same digits in every batch: of more than
`FEW_POINTS`, whose Jacobians come from the pass itself, and of fewer, where they come from differences.

Small linear systems of many points are solved at once, with points as the last axis, so that every step is one array
operation. LAPACK, point by point, costs up to four times as much for matrices of five to ten rows.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network

TOLERANCE = 1e-10  # on every balance, all of order one
AIM = 1e-3
"""Share of TOLERANCE that the iteration aims at, so that differences of solutions 1e-5 apart are good to
a ten-millionth. A point that cannot come nearer, for rounding, and meets TOLERANCE is solved all the same."""
MAX_ITERATIONS = 60
"""Passes at most: a good start needs a few; what has not converged by then does not. Judgement."""
NEAR, NEAR_BY_DIFFERENCES = 5e-3, 6e-6
"""Largest residual from which a full step with the Jacobian there is expected to gain so much that the next passes need
none: measured on batches of 300 to 10,000 points whose parameters are 0 to 12 % off, and of 1 to 40 points whose power
setting is. A Jacobian from differences costs little more than a pass without, and does not gain by being late."""
GAINS, GAINS_BY_DIFFERENCES = 0.3, 0.1
"""A step that leaves more than this share of the residual says that the Jacobian is no longer good: so much is gained
by three passes without it that cost as much as one with it; from differences it costs less than two."""


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

    @property
    def gains(self) -> float:
        """The largest share of the residual that a step may leave without a fresh Jacobian."""
        return GAINS_BY_DIFFERENCES if self.by_differences else GAINS

    @property
    def near(self) -> float:
        """The residual from which a Jacobian serves for the next steps too."""
        return NEAR_BY_DIFFERENCES if self.by_differences else NEAR


LARGEST_STEP = 0.4
"""Largest change of an unknown in one step, as a share of itself: beyond it the linear model says little about maps.
Judgement."""
SMALL = 0.05  # unknowns are of order one; smaller ones may move by this much of LARGEST_STEP
MAX_HALVINGS = 6
"""A step a sixty-fourth as long that still gains nothing is taken, since it may lead out of a fold. Judgement."""
PROGRESS, PATIENCE = 0.9, 10
"""A point whose residual has not fallen to this share of its lowest in so many passes is given up: of those that
converge at all, nearly a thousandth waits longer, and has other starts."""
LARGEST_SHARE = 0.5
"""Largest s'·t'/s'·s' that is believed: near 1 the step would have no end."""
TINY = 1e-300
"""In place of a square that is zero, of a step that was not taken."""


@dataclass
class OpenPoints:
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
    lowest: Array
    waited: Array

    @staticmethod
    def take(x: Array) -> OpenPoints:
        nx, n = x.shape
        return OpenPoints(
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
            lowest=np.full(n, np.inf),
            waited=np.zeros(n, dtype=int),
        )

    def advance(self, R: Array, norm: Array, effort: Effort) -> Array:
        """The next step of every point from its balances R (nx, n) and the largest of them, norm (n,); which points
        stay open (n,)."""
        # a step that made things worse is halved, a few times in a row
        rejected = (norm > self.base_norm) & (self.halvings < MAX_HALVINGS)
        stalled = (norm <= TOLERANCE) & (norm > GAINS * self.base_norm)
        going = ~rejected & ~stalled & np.isfinite(norm)
        disappointed = going & ~self.fresh & (norm > effort.gains * self.base_norm)
        accepted = going & ~disappointed
        if accepted.any():
            # what is computed of all, for what is taken of some
            whole = 2 * np.count_nonzero(accepted) >= len(accepted)
            self._accept(slice(None) if whole else np.flatnonzero(accepted), accepted, R, norm, effort)
        self.step[:, rejected] *= 0.5
        self.halvings[rejected] += 1
        # asked again where it is, with the Jacobian
        self.base[:, disappointed], self.step[:, disappointed] = self.x[:, disappointed], 0.0
        self.base_norm[disappointed] = np.inf
        self.fresh |= rejected | disappointed
        return np.asarray((going | rejected) & ~stalled & np.isfinite(self.step).all(axis=0))

    def hopeful(self, norm: Array) -> Array:
        """Points (n,) whose residual has fallen lately."""
        fallen = norm < PROGRESS * self.lowest
        self.waited = np.where(fallen, 0, self.waited + 1)
        self.lowest = np.where(fallen, norm, self.lowest)
        return self.waited <= PATIENCE

    @np.errstate(all="ignore")  # what cannot be solved leaves the batch
    def _accept(self, some: Array | slice, accepted: Array, R: Array, norm: Array, effort: Effort) -> None:
        """Steps of the accepted points, which are among `some`."""
        fresh, before, x = self.fresh[some], self.base_norm[some], self.x[:, some]
        if effort.by_differences:
            step = self._updated(some, accepted, R[:, some])
        else:
            step = -substituted(self.LU[:, :, some], self.order[:, some], R[:, some])
            if not fresh.all():
                self._correct(step, some, fresh)
        largest = np.max(np.abs(step) / np.maximum(np.abs(x), SMALL), axis=0)
        step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, TINY))
        norm = norm[some]
        # with its own Jacobian the next residual is about the square of this, with the last one's it shrinks as before
        expected = norm * np.where(fresh | ~np.isfinite(before), norm, norm / before)
        again = (norm >= effort.near) | (largest > LARGEST_STEP)
        taken = some
        if not accepted[some].all():
            those = np.flatnonzero(accepted[some])
            taken, x, step = np.flatnonzero(accepted), x[:, those], step[:, those]
            norm, expected, again, fresh = norm[those], expected[those], again[those], fresh[those]
        if not effort.by_differences:
            self.earlier[:, taken] = np.where(fresh, 0.0, self.step[:, taken])
        self.base[:, taken], self.step[:, taken] = x, step
        self.base_norm[taken], self.halvings[taken] = norm, 0
        self.expected[taken], self.fresh[taken] = expected, again

    def _correct(self, step: Array, some: Array | slice, fresh: Array) -> None:
        """Corrects steps by those since their Jacobian was computed."""
        first, last = self.earlier[:, some], self.step[:, some]
        step += last * np.where(fresh, 0.0, (first * step).sum(axis=0) / np.maximum((first * first).sum(axis=0), TINY))
        share = np.where(fresh, 0.0, (last * step).sum(axis=0) / (last * last).sum(axis=0))
        step /= np.where(share < LARGEST_SHARE, 1.0 - share, 1.0)

    def _updated(self, some: Array | slice, accepted: Array, R: Array) -> Array:
        """Steps -J⁻¹ R of points whose Jacobians are at hand themselves, J + R sᵀ / s·s after a step s that left R."""
        J, last = self.LU[:, :, some], self.step[:, some]
        square = np.where(self.fresh[some] | ~accepted[some], 0.0, (last * last).sum(axis=0))
        if square.any():
            J = J + R[:, None] * (last * np.where(square > 0.0, 1.0 / np.maximum(square, TINY), 0.0))
            self.LU[:, :, some] = J
        return -directly(J, R)

    def keep_points(self, keep: Array) -> OpenPoints:
        if keep.all():
            return self
        return OpenPoints(*(getattr(self, f.name)[..., keep] for f in fields(self)))


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
    def directions(self) -> frozenset[str]: ...
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
    p = OpenPoints.take(x)
    balances = _Balances(network, inputs, parameters, effort, reader, n)
    waiting = np.zeros(n, dtype=bool)
    for iteration in range(effort.max_iterations):
        R = balances.evaluate(p, best, effort.by_differences or iteration >= LATE)
        norm = np.abs(R).max(axis=0)
        norm[~np.isfinite(norm)] = np.inf
        best.note(p, R, norm, iteration + 1)
        left = norm > effort.aim
        if not left.any():
            break
        keep = p.advance(R, norm, effort) & p.hopeful(norm) & left
        if not keep.any():
            break
        p = p.keep_points(keep)
        p.x = np.clip(p.base + p.step, lower, upper)
        # what was cut short has not gone where its Jacobian leads
        p.fresh |= (p.x != p.base + p.step).any(axis=0)
        sure = (
            ~p.fresh & (p.expected < SURE)
            if reader is not None and reader.directions
            else np.zeros(len(norm), dtype=bool)
        )
        if sure.any():
            waiting[p.index[sure]], best.x[:, p.index[sure]] = True, p.x[:, sure]
            if sure.all():
                break
            p = p.keep_points(~sure)
    if waiting.any():
        _confirm(balances, best, np.flatnonzero(waiting))
    return best


def _confirm(balances: _Balances, best: Solution, waiting: Array) -> None:
    """One pass along all that is wanted at points that are expected to be solved; those that are not go on without."""
    assert balances.reader is not None
    best.residual[waiting] = np.inf
    for some in blocks(waiting, balances.reader.directions):
        p = OpenPoints.take(best.x[:, some])
        p.index = some
        R = balances.evaluate_outputs(p, best)
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

    def evaluate(self, p: OpenPoints, best: Solution, by_differences: bool) -> Array:
        """Balances (nx, n) of the points, whose Jacobians are put where they belong."""
        if by_differences:
            return self._difference_quotients(p, best)
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
            p.LU[:, :, here], p.order[:, here] = factors(directed(e, e.balances, names))
            p.earlier[:, here] = 0.0
        self._read(e, R[:, here], np.arange(e.size), p.index[here], best)

    def _difference_quotients(self, p: OpenPoints, best: Solution) -> Array:
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
                p.LU[:, :, fresh], p.order[:, fresh] = factors(J)
            p.earlier[:, fresh] = 0.0
        self._read(e, R, rows, p.index, best)
        return R

    def evaluate_outputs(self, p: OpenPoints, best: Solution) -> Array:
        """Balances (nx, n) of points from a pass along all that the reader wants, who has it where they are met."""
        assert self.reader is not None
        e = evaluate(self.network, *self._leaves(p.index), p.x, self.reader.directions)
        R = balances(e)
        self._deliver(e, R, np.arange(e.size), p.index, TOLERANCE, best)
        return R

    def _leaves(self, index: Array) -> tuple[Mapping[str, Value], Mapping[str, Value]]:
        if len(index) == self.size:  # points stay in order
            return self.inputs, self.parameters
        return take(self.inputs, index), take(self.parameters, index)

    def _read(self, e: Evaluation, R: Array, rows: Array, index: Array, best: Solution) -> None:
        """Lets the reader have what needs no derivatives."""
        if self.reader is not None and not self.reader.directions:
            self._deliver(e, R, rows, index, self.effort.aim, best)

    def _deliver(self, e: Evaluation, R: Array, rows: Array, index: Array, tolerance: float, best: Solution) -> None:
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


PIVOT = 0.1
"""Least share of the largest element below it at which an element of the diagonal is divided by (threshold pivoting):
growth of rounding errors stays below 1/PIVOT a row, and most points exchange no rows."""


@np.errstate(all="ignore")  # a singular matrix gives what is not finite, in its own point only
def factors(A: Array) -> tuple[Array, Array]:
    """L and U in one array (k, k, n), with 1/diagonal of U, and the order (k, n) in which each point's rows were taken,
    for A (k, k, n)."""
    LU = A.copy()
    k, _, n = LU.shape
    order = np.repeat(np.arange(k)[:, None], n, axis=1)
    for c in range(k):
        if c < k - 1:
            _exchange(LU, order, c)
        LU[c, c] = 1.0 / LU[c, c]
        LU[c + 1 :, c] *= LU[c, c]
        LU[c + 1 :, c + 1 :] -= LU[c + 1 :, c, None] * LU[c, None, c + 1 :]
    return LU, order


@np.errstate(all="ignore")
def substituted(LU: Array, order: Array, B: Array) -> Array:
    """A⁻¹ B (k, n) or (k, m, n) for the factors of A and B of that shape."""
    vectors = B.ndim == 2
    n = LU.shape[2]
    X = B.ravel().take(order * n + np.arange(n)) if vectors else np.take_along_axis(B, order[:, None], axis=0)
    L = LU if vectors else LU[:, :, None]
    k = len(LU)
    for c in range(k - 1):
        X[c + 1 :] -= L[c + 1 :, c] * X[c]
    for c in range(k - 1, -1, -1):
        X[c] *= L[c, c]
        X[:c] -= L[:c, c] * X[c]
    return X


def directly(A: Array, B: Array) -> Array:
    """A⁻¹ B (k, n) for A (k, k, n) and B (k, n), by LAPACK: for so few points that calls cost more than computing."""
    matrices, vectors = A.transpose(2, 0, 1), B.T[:, :, None]
    try:
        return np.linalg.solve(matrices, vectors)[:, :, 0].T
    except np.linalg.LinAlgError:  # of one point, which says nothing about the others
        bad = ~(np.abs(np.linalg.det(matrices)) > 0.0)
        X = np.linalg.solve(np.where(bad[:, None, None], np.eye(len(A)), matrices), vectors)[:, :, 0].T
        X[:, bad] = np.nan
        return X


def _exchange(LU: Array, order: Array, c: int) -> None:
    """Brings the largest element of column c to the diagonal, at points where the one there is too small."""
    size = np.abs(LU[c:, c])
    at = np.flatnonzero(~(size[0] >= PIVOT * size.max(axis=0)))
    if at.size:
        row = c + size[:, at].argmax(axis=0)
        taken = LU[row, :, at]
        LU[row, :, at] = LU[c][:, at].T
        LU[c][:, at] = taken.T
        order[row, at], order[c, at] = order[c, at], order[row, at]
