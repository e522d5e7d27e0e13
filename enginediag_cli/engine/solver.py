"""Damped Newton iteration over a whole batch of operating points at once.

Each pass evaluates the points that are still open, with the exact Jacobian from the same evaluation;
points that meet the tolerance leave the batch. A step is shortened so that no unknown moves by more than
`LARGEST_STEP` of itself, and halved again where the residual grew. A point that does not converge is data:
its residuals say which balance failed.
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
LARGEST_STEP = 0.4
GROWTH_ALLOWED = 1.0


@dataclass
class Solution:
    """Unknowns (nx, N), largest residual (N,), index of the balance it belongs to (N,) and passes used (N,)."""

    x: Array
    residual: Array
    worst: Array
    passes: Array

    @property
    def converged(self) -> Array:
        return self.residual <= TOLERANCE


def evaluate(network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array,
             wrt: frozenset[str]) -> Evaluation:
    """One pass at unknowns x (nx, N)."""
    names = [u.name for u in network.unknowns()]
    leaves = network.leaves(inputs, parameters, dict(zip(names, x, strict=True)))
    e = Evaluation(network.gas, x.shape[1], leaves, wrt)
    with np.errstate(all="ignore"):
        network.evaluate(e)
    return e


def matrix(e: Evaluation, rows: Mapping[str, Value], names: tuple[str, ...]) -> Array:
    """Derivatives of `rows` with respect to leaves `names`, shape (N, rows, names)."""
    out = np.zeros((len(rows), len(names), e.size))
    column = np.full(len(e.directions), -1)
    for k, name in enumerate(names):
        if name in e.directions:
            column[e.directions[name]] = k
    for row, y in enumerate(rows.values()):
        if isinstance(y, Dual):
            at = column[: len(y.d)]
            use = at >= 0
            out[row, at[use]] = y.d if use.all() else y.d[use]
    return np.ascontiguousarray(out.transpose(2, 0, 1))


def newton(network: Network, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Array,
           max_iterations: int = MAX_ITERATIONS) -> Solution:
    """Solves the balances from starting unknowns x (nx, N); inputs and parameters are floats or (N,)."""
    unknowns = network.unknowns()
    names = tuple(u.name for u in unknowns)
    wrt = frozenset(names)
    lower = np.array([u.lower for u in unknowns])[:, None]
    upper = np.array([u.upper for u in unknowns])[:, None]
    n = x.shape[1]
    best = Solution(x.copy(), np.full(n, np.inf), np.zeros(n, dtype=int), np.zeros(n, dtype=int))
    active = np.arange(n)
    base, step = x.copy(), np.zeros_like(x)
    base_norm, shortened = np.full(n, np.inf), np.zeros(n, dtype=int)
    current = x.copy()
    for iteration in range(max_iterations):
        whole = len(active) == n
        e = evaluate(network, inputs if whole else _take(inputs, active), parameters if whole else _take(parameters, active),
                     current, wrt)
        R = np.stack([np.broadcast_to(value(b), (len(active),)) for b in e.balances.values()])
        size = np.abs(R)
        worst = np.argmax(np.where(np.isfinite(size), size, np.inf), axis=0)
        norm = size[worst, np.arange(len(active))]
        norm = np.where(np.isfinite(norm), norm, np.inf)
        better = norm < best.residual[active]
        at = active[better]
        best.x[:, at], best.residual[at], best.worst[at] = current[:, better], norm[better], worst[better]
        best.passes[active] = iteration + 1
        # a step that made things worse is halved, at most six times in a row
        rejected = (norm > GROWTH_ALLOWED * base_norm) & (shortened < 6) & (norm > TOLERANCE)
        open_ = norm > TOLERANCE
        accepted = open_ & ~rejected & np.isfinite(norm)
        if accepted.any():
            J = matrix(e, e.balances, names)[accepted]
            new_step = _linear_solve(J, R[:, accepted].T).T
            largest = np.max(np.abs(new_step) / np.maximum(np.abs(current[:, accepted]), 0.05), axis=0)
            new_step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-300))
            base[:, accepted], step[:, accepted] = current[:, accepted], new_step
            base_norm[accepted], shortened[accepted] = norm[accepted], 0
        step[:, rejected] *= 0.5
        shortened[rejected] += 1
        keep = (accepted | rejected) & (np.isfinite(step).all(axis=0))
        if not keep.any():
            break
        base, step = base[:, keep], step[:, keep]
        current = np.clip(base + step, lower, upper)
        base_norm, shortened, active = base_norm[keep], shortened[keep], active[keep]
    return best


def _linear_solve(J: Array, R: Array) -> Array:
    """−J⁻¹ R for a stack (n, k, k), (n, k); a singular matrix is regularised, its point is judged by its residual."""
    J = np.where(np.isfinite(J), J, 0.0)
    try:
        return -np.linalg.solve(J, R[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        return -np.linalg.solve(J + 1e-9 * np.eye(J.shape[1]), R[:, :, None])[:, :, 0]


def _take(leaves: Mapping[str, Value], index: Array) -> dict[str, Value]:
    return {k: v[index] if isinstance(v, np.ndarray) and v.ndim else v for k, v in leaves.items()}
