"""Regularised Gauss–Newton with a robust loss, bounds, kinks and records that may fail to converge.

Minimises  Q(x, z) = Σ_ks ρ(e_ks/σ_s)/κ_s + ½|x|² + ½|z|²  with x and z in prior standard deviations, by

    S dx = −β g,   |dx| ≤ FARTHEST     on the parameters that are not held at a bound,

S being the reweighted normal matrix with priors after elimination of the offsets, g its gradient, combined with those
of the points tried near by where the misfit has kinks (`kinks.py`), β ≤ 1 the boldness, and the step projected on
bounds and longest step (D. P. Bertsekas, "Projected Newton Methods", SIAM J. Control Optim. 20 (1982) 221–246).

A step that loses records is shortened along itself; damping would turn it away from where the misfit is. Where no step
lowers the misfit any more the search is over: it has converged when what is left is no more than `STALL` standard
errors, and the distance stands in the reason.

Why not `scipy.optimize.least_squares`: it needs residuals that are all finite (a record that does not
converge would have to count as a perfect fit), calls the model for the Jacobian apart from the residuals, and
builds the (N·m, p + R·q) Jacobian that the elimination of the offsets avoids.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.identification.kinks import Kinks, Piece, Pieces
from enginediag_cli.identification.normal_equations import (
    Arrow,
    NormalEquations,
    eliminate,
    normal_equations,
    offset_step,
)
from enginediag_cli.identification.problem import Problem
from enginediag_cli.progress import each

LOST_FRACTION = 0.02
"""A step may lose this share of the converged records; one that loses more is rejected as too long."""

FARTHEST = 2.0
"""Prior standard deviations by which a parameter may change in one step: half of what is believable at all. A first
step of a badly scaled model would otherwise go where no record has a prediction."""
SHORTENED, SHORTER, BOLDER = 0.25, 0.5, 4.0
"""Factors of the length of the next step after one that lost records, after one that lowered the misfit too little, and
after one that kept its promise. Judgement: back at full length in one or two steps."""
ENOUGH = 0.05
"""Share of the promised fall that makes a step worth taking; with less its point serves as a piece of the misfit."""

MAX_REJECTED = 24
"""Rejected steps in a row after which nothing is expected of another."""
STALL = 0.3
"""Standard errors. An optimum that near is statistically the same answer: its misfit is lower by 0.045, where 0.5 is
one standard error, and an interval about the place reached would have to be wider by 4 % at most to be as good."""
NEGLIGIBLE = 1e-9  # relative change of cost that is the solver's own rounding


@dataclass(frozen=True)
class Iteration:
    """One model evaluation: cost on all converged records, distance to the optimum, records lost, boldness of the next
    step, and whether this one was taken."""

    cost: float
    decrement: float
    failed: int
    boldness: float
    accepted: bool


@dataclass(frozen=True)
class Fit:
    """Where the search ended and why; `converged` must be looked at before anything else."""

    x: np.ndarray  # (p,) in prior standard deviations from the prior mean
    z: np.ndarray  # (R, q) offsets in prior standard deviations
    equations: NormalEquations
    at_bound: np.ndarray  # (p,) held at a bound that the data push against, unless both bounds are one
    converged: bool
    reason: str
    iterations: tuple[Iteration, ...]

    @property
    def decrement(self) -> float:
        """√(2 · fall of the misfit that is still to be had) at the end: distance to the optimum in standard errors."""
        return self.iterations[-1].decrement if self.iterations else np.nan

    @property
    def failed(self) -> np.ndarray:
        """Records without a prediction at the end, (N,) bool: they took no part in the estimate."""
        return ~self.equations.ok


@dataclass(frozen=True)
class _Here:
    """Where the search stands: the misfit around it, what is held at bounds, and the distance to the optimum."""

    pieces: Pieces
    gradient: np.ndarray  # (p,) at the point itself
    held: np.ndarray
    offsets: float  # what the offsets alone add to the square of the distance
    decrement: float

    def step(self, boldness: float, x: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """The step (p,), as bold as asked (0 to 1)."""
        gradient, _ = self.pieces.combined(boldness)
        return _projected_step(self.pieces.S / boldness, gradient, self.held, x, low, high)


def solve(
    problem: Problem,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    max_iterations: int = 40,
    tolerance: float = 1e-3,
) -> Fit:
    """Most probable x and z from `start` (default: prior mean).

    Converged when the optimum is less than `tolerance` standard errors away, or less than `STALL` where no step lowers
    the misfit any more. Never raises for a model that does not converge: the reason is in the result.
    """
    p, shape = len(problem.parameters), (len(problem.labels), len(problem.offsets))
    low = (problem.lower - problem.prior_mean) / problem.prior_sigma
    high = (problem.upper - problem.prior_mean) / problem.prior_sigma
    x, z = (np.zeros(p), np.zeros(shape)) if start is None else (start[0].copy(), start[1].copy())
    x = np.clip(x, low, high)
    now = normal_equations(problem, x, z)
    if not now.ok.any():
        return Fit(x, z, now, np.zeros(p, bool), False, "no record converged at the starting point", ())
    kinks, boldness, rejected, walls = Kinks(), 1.0, 0, 0
    here = _stand(now, x, z, (low, high), kinks)
    history = [Iteration(_total(now, x, z), here.decrement, int((~now.ok).sum()), boldness, True)]
    for _ in each(range(max_iterations), "iterations of the fit"):
        if here.decrement < tolerance or rejected >= MAX_REJECTED:
            break
        dx = here.step(boldness, x, np.maximum(low, x - FARTHEST), np.minimum(high, x + FARTHEST))
        dz = offset_step(now, z, dx)
        trial = normal_equations(problem, x + dx, z + dz)
        lost = int(np.sum(now.ok & ~trial.ok)) > max(1, LOST_FRACTION * now.ok.sum())
        promised = here.pieces.fall(dx) + 0.5 * here.offsets
        gain = _gain(now, trial, x, z, dx, dz)
        floor = NEGLIGIBLE * max(_total(now, x, z), 1.0)
        accepted = bool(not lost and promised > 0 and (gain > ENOUGH * promised or abs(gain) + promised < floor))
        if not np.array_equal(now.ok, trial.ok):
            kinks.clear()
        elif accepted:
            kinks.add(Piece(x, here.gradient, _total(now, x, z)))
        else:
            kinks.add(Piece(x + dx, _reduced(trial, x + dx, z + dz).g, _total(trial, x + dx, z + dz)))
        if accepted:
            x, z, now = np.clip(x + dx, low, high), z + dz, trial
            rejected = 0
            boldness = min(1.0, boldness * (BOLDER if gain > 0.5 * promised else 1.0))
        else:
            rejected, walls = rejected + 1, walls + lost
            boldness *= SHORTENED if lost else SHORTER
        here = _stand(now, x, z, (low, high), kinks)
        history.append(Iteration(_total(now, x, z), here.decrement, int((~trial.ok).sum()), boldness, accepted))
    end = Fit(x, z, now, here.held & (low < high), False, "", tuple(history))
    return _ended(end, tolerance, rejected, walls)


def _ended(fit: Fit, tolerance: float, rejected: int, walls: int) -> Fit:
    """The fit with its verdict: converged or not, and why."""
    distance = f"{fit.decrement:.1e} standard errors"
    if fit.decrement < tolerance:
        return replace(fit, converged=True, reason=f"the distance to the optimum is {distance}")
    if rejected >= MAX_REJECTED:
        if fit.decrement < STALL:
            reason = f"no step lowers the misfit any more; the distance to the optimum is at most {distance}"
            return replace(fit, converged=True, reason=reason)
        reason = f"{rejected} steps in a row did not lower the misfit, {distance} from the optimum"
    else:
        reason = f"after {len(fit.iterations) - 1} iterations the optimum is {distance} away"
    return replace(fit, reason=reason + _walls(walls))


def _walls(count: int) -> str:
    """What stood in the way, when steps were refused because records stopped converging."""
    return f"; {count} steps lost too many converged records" if count else ""


def _stand(
    now: NormalEquations, x: np.ndarray, z: np.ndarray, box: tuple[np.ndarray, np.ndarray], kinks: Kinks
) -> _Here:
    """What is known at one point."""
    arrow = _reduced(now, x, z)
    held = ((x <= box[0]) & (arrow.g > 0)) | ((x >= box[1]) & (arrow.g < 0))
    pieces = kinks.about(Piece(x, arrow.g, _total(now, x, z)), arrow.S, ~held)
    # z moves with x: what is left of its own gradient is part of the distance to the optimum
    offsets = _offset_squared(now, z)
    return _Here(pieces, arrow.g, held, offsets, float(np.sqrt(pieces.combined()[1] + offsets)))


def _reduced(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> Arrow:
    return eliminate(n.H_xx, n.H_xz, n.H_zz, n.g_x, n.g_z, x, z)


def _projected_step(
    S: np.ndarray, g: np.ndarray, held: np.ndarray, x: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """Newton step of the free parameters; one that would cross its bound stops there, the rest re-solve."""
    fixed, dx = held.copy(), np.zeros_like(x)
    while not fixed.all():
        free = ~fixed
        dx[free] = np.linalg.solve(S[np.ix_(free, free)], -(g[free] + S[np.ix_(free, fixed)] @ dx[fixed]))
        target = np.clip(x + dx, low, high) - x
        crossed = free & (target != dx) & (np.abs(target - dx) > 1e-12 * (1 + np.abs(dx)))
        dx = np.where(crossed, target, dx)
        if not crossed.any():
            break
        fixed |= crossed
    return np.clip(x + dx, low, high) - x


def _offset_squared(n: NormalEquations, z: np.ndarray) -> float:
    """The offsets' share of the decrement at fixed x, Σ_r (g_z + z)ᵀ(H_zz + 1)⁻¹(g_z + z)."""
    g = n.g_z + z
    return float(np.sum(g * np.linalg.solve(n.H_zz + np.eye(z.shape[1]), g[:, :, None])[:, :, 0]))


def _total(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> float:
    return float(n.record_cost[n.ok].sum() + 0.5 * x @ x + 0.5 * np.sum(z**2))


def _gain(
    now: NormalEquations, trial: NormalEquations, x: np.ndarray, z: np.ndarray, dx: np.ndarray, dz: np.ndarray
) -> float:
    """Actual fall of the cost, on the records that both points have: a record that fails must not pass for one that
    fits."""
    both = now.ok & trial.ok
    prior = x @ dx + 0.5 * dx @ dx + np.sum(z * dz) + 0.5 * np.sum(dz**2)
    return float((now.record_cost[both] - trial.record_cost[both]).sum() - prior)
