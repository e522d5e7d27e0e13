"""Damped Newton iteration over a whole batch of operating points at once.

Each pass evaluates the points that are still open, with the exact Jacobian from the same evaluation
(near the solution without it: the last one serves); points that meet the tolerance leave the batch. A step
is shortened so that no unknown moves by more than `LARGEST_STEP` of itself, and halved again where the
residual grew. A point that does not converge is data: its residuals say which balance failed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.network import Network

TOLERANCE = 1e-10  # on every balance, all of order one
MAX_ITERATIONS = 60
"""Passes at most: a good start needs a few; what has not converged by then does not. Judgement."""
LARGEST_STEP = 0.4
"""Largest change of an unknown in one step, as a share of itself: beyond it the linear model says little about maps.
Judgement."""
SMALL = 0.05  # unknowns are of order one; smaller ones may move by this much of LARGEST_STEP
MAX_HALVINGS = 6
"""A step a sixty-fourth as long that still gains nothing is taken, since it may lead out of a fold. Judgement."""
CONFIRM_BELOW = 3e-5
"""Residual below which the next Newton step, which squares it, leaves about TOLERANCE, so that one pass confirms all
points."""
DIFFERENCE = 1e-7
"""Share of an unknown by which it is moved for a difference: the root of rounding, about."""
FEW_POINTS = 40
"""Points up to which the overhead of choosing among them costs more than computing them all."""


@dataclass
class Solution:
    """Unknowns (nx, N), largest residual (N,), index of the balance it belongs to (N,) and passes used (N,).

    `evaluation` is the pass that confirmed most points, at points `evaluated`, for outputs to be read from.
    """

    x: Array
    residual: Array
    worst: Array
    passes: Array
    evaluation: Evaluation | None = None
    evaluated: Array | None = None

    @property
    def converged(self) -> Array:
        return self.residual <= TOLERANCE


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


def matrix(e: Evaluation, rows: Mapping[str, Value], names: tuple[str, ...]) -> Array:
    """Derivatives of `rows` with respect to leaves `names`, shape (N, rows, names)."""
    return np.ascontiguousarray(directed(e, rows, names).transpose(2, 0, 1))


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
    final: frozenset[str] = frozenset(),
    max_iterations: int = MAX_ITERATIONS,
) -> Solution:
    """Solves the balances from starting unknowns x (nx, N); inputs and parameters are floats or (N,).

    A pass that most likely only confirms convergence is differentiated along `final` instead of the
    unknowns alone, so that it can serve for outputs and sensitivities.
    """
    unknowns = network.unknowns()
    lower = np.array([[u.lower] for u in unknowns])
    upper = np.array([[u.upper] for u in unknowns])
    n = x.shape[1]
    best = Solution(x.copy(), np.full(n, np.inf), np.zeros(n, dtype=int), np.zeros(n, dtype=int))
    open_points = _OpenPoints(
        np.arange(n),
        x.copy(),
        x.copy(),
        np.zeros_like(x),
        np.full(n, np.inf),
        np.zeros(n, dtype=int),
        np.zeros((n, len(x), len(x))),
    )
    for iteration in range(max_iterations):
        p = open_points
        u = inputs if len(p.index) == n else take(inputs, p.index)
        t = parameters if len(p.index) == n else take(parameters, p.index)
        # near the solution convergence is quadratic: this pass most likely only confirms it
        confirming = bool((p.base_norm < CONFIRM_BELOW).all())
        e = None
        if confirming:
            e = evaluate(network, u, t, p.x, final)
            R, J = balances(e), None
        else:
            R, J = values_and_jacobian(network, u, t, p.x)
        size = np.where(np.isfinite(R), np.abs(R), np.inf)
        worst = np.argmax(size, axis=0)
        norm = size[worst, np.arange(len(p.index))]
        better = norm < best.residual[p.index]
        at = p.index[better]
        best.x[:, at], best.residual[at], best.worst[at] = p.x[:, better], norm[better], worst[better]
        best.passes[p.index] = iteration + 1
        if e is not None and best.evaluation is None and np.mean(norm <= TOLERANCE) > 0.5:
            best.evaluation, best.evaluated = e, p.index
        # a step that made things worse is halved, a few times in a row
        rejected = (norm > p.base_norm) & (p.halvings < MAX_HALVINGS) & (norm > TOLERANCE)
        accepted = (norm > TOLERANCE) & ~rejected & np.isfinite(norm)
        if accepted.any():
            if J is not None:
                p.J[accepted] = J[accepted]
            step = _linear_solve(p.J[accepted], R[:, accepted].T).T
            largest = np.max(np.abs(step) / np.maximum(np.abs(p.x[:, accepted]), SMALL), axis=0)
            step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-300))
            p.base[:, accepted], p.step[:, accepted] = p.x[:, accepted], step
            p.base_norm[accepted], p.halvings[accepted] = norm[accepted], 0
        p.step[:, rejected] *= 0.5
        p.halvings[rejected] += 1
        keep = (accepted | rejected) & np.isfinite(p.step).all(axis=0)
        if not keep.any():
            break
        open_points = p.kept(keep)
        open_points.x = np.clip(open_points.base + open_points.step, lower, upper)
    return best


@dataclass
class _OpenPoints:
    """Points that have not converged: where the last accepted step began, the step, and its Jacobian."""

    index: Array
    x: Array
    base: Array
    step: Array
    base_norm: Array
    halvings: Array
    J: Array

    def kept(self, keep: Array) -> _OpenPoints:
        if keep.all():
            return self
        return _OpenPoints(
            self.index[keep],
            self.x[:, keep],
            self.base[:, keep],
            self.step[:, keep],
            self.base_norm[keep],
            self.halvings[keep],
            self.J[keep],
        )


def balances(e: Evaluation) -> Array:
    """Values of all balances (nx, n)."""
    return np.stack([np.broadcast_to(value(b), (e.size,)) for b in e.balances.values()])


def largest_balance(e: Evaluation) -> Array:
    """Largest residual of each point (N,), infinite where one is not finite."""
    R = balances(e)
    return np.where(np.isfinite(R), np.abs(R), np.inf).max(axis=0)


def values_and_jacobian(
    network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array
) -> tuple[Array, Array]:
    """Balances (nx, n) and their derivatives (n, nx, nx): exact, or for a few points by forward differences
    in one widened batch, which costs one plain pass where the overhead of calls dominates."""
    nx, n = x.shape
    if n <= FEW_POINTS:
        h = DIFFERENCE * np.maximum(np.abs(x), SMALL)
        wide = np.repeat(x[:, None, :], nx + 1, axis=1)
        wide[np.arange(nx), np.arange(1, nx + 1)] += h
        tile = {k: np.tile(v, nx + 1) if isinstance(v, np.ndarray) and v.ndim else v for k, v in inputs.items()}
        theta = {k: np.tile(v, nx + 1) if isinstance(v, np.ndarray) and v.ndim else v for k, v in parameters.items()}
        R = balances(evaluate(network, tile, theta, wide.reshape(nx, -1), frozenset())).reshape(-1, nx + 1, n)
        with np.errstate(invalid="ignore", over="ignore"):
            return R[:, 0], np.ascontiguousarray(((R[:, 1:] - R[:, :1]) / h).transpose(2, 0, 1))
    names = tuple(u.name for u in network.unknowns())
    e = evaluate(network, inputs, parameters, x, frozenset(names))
    return balances(e), matrix(e, e.balances, names)


def _linear_solve(J: Array, R: Array) -> Array:
    """−J⁻¹ R for a stack (n, k, k), (n, k)."""
    return -linear_solve(J, R[:, :, None])[:, :, 0]


def linear_solve(A: Array, B: Array) -> Array:
    """A⁻¹ B for stacks (n, k, k), (n, k, m); a matrix that is exactly singular or not finite gives NaN in its
    own rows only."""
    try:
        return np.linalg.solve(A, B)
    except np.linalg.LinAlgError:
        bad = ~(np.abs(np.linalg.det(A)) > 0.0)
        solved = np.linalg.solve(np.where(bad[:, None, None], np.eye(A.shape[1]), A), B)
        return np.where(bad[:, None, None], np.nan, solved)


def take(leaves: Mapping[str, Value], index: Array) -> dict[str, Value]:
    return {k: v[index] if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}
