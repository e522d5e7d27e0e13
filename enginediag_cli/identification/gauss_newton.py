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

from enginediag_cli.identification.kinks import NEAR, Kinks, Piece, Pieces
from enginediag_cli.identification.normal_equations import NormalEquations, normal_equations, offset_step
from enginediag_cli.identification.problem import Problem
from enginediag_cli.identification.steps import (
    FARTHEST,
    STALL,
    Derivatives,
    corrected,
    exact,
    offset_squared,
    projected_step,
    reduced,
    served,
    taken_at,
    total,
    tried,
)
from enginediag_cli.progress import each

SHORTENED, SHORTER, BOLDER = 0.25, 0.5, 4.0
"""Factors of the length of the next step after one that lost records, after one that lowered the misfit too little, and
after one that kept its promise. Judgement: back at full length in one or two steps."""
MAX_REJECTED = 24
"""Rejected steps in a row after which nothing is expected of another."""
CREEPING = 1e-3
"""Share of a full step: where one so short still loses records there is a wall, before which a search would creep."""
LOOKED, HOPE = 4, 10.0
"""Iterations before a search may be given up as hopeless, and how many times what the next step promises may still be
gained in all. Judgement: far from the optimum promises are of the right size, in a bent valley several times too
small."""


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
    def steps(self) -> int:
        """Steps that were tried."""
        return max(len(self.iterations) - 1, 0)

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
        return projected_step(self.pieces.S / boldness, gradient, self.held, x, low, high)


def solve(
    problem: Problem,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    max_iterations: int = 40,
    tolerance: float = 1e-3,
    derivatives: Derivatives = Derivatives.EACH,
    begin: NormalEquations | None = None,
    hopeless: float = np.inf,
) -> Fit:
    """Most probable x and z from `start` (default: prior mean); `begin`: the equations there, where they are known;
    `hopeless`: χ² of readings and priors (twice the cost) above which nobody is interested in the optimum: the search
    is given up, not converged, where HOPE times what is promised does not lead below it.

    Converged when the optimum is less than `tolerance` standard errors away, or less than `STALL` where no step lowers
    the misfit any more. Never raises for a model that does not converge: the reason is in the result. Derivatives that
    are kept take the memory of all records.
    """
    p, shape = len(problem.parameters), (len(problem.labels), len(problem.offsets))
    low = (problem.lower - problem.prior_mean) / problem.prior_sigma
    high = (problem.upper - problem.prior_mean) / problem.prior_sigma
    x, z = (np.zeros(p), np.zeros(shape)) if start is None else (start[0].copy(), start[1].copy())
    inside, each_point = np.clip(x, low, high), derivatives is Derivatives.EACH
    if begin is None or not np.array_equal(inside, x):
        begin = normal_equations(problem, inside, z) if each_point else taken_at(problem, inside, z)
    x, now = inside, begin
    del begin
    if not now.ok.any():
        return Fit(x, z, now, np.zeros(p, bool), False, "no record converged at the starting point", ())
    kinks, boldness, rejected, walls, walled = Kinks(), 1.0, 0, 0, False
    now, here = _confirmed(problem, now, (x, z), (low, high), kinks, derivatives, tolerance)
    history = [Iteration(total(now, x, z), here.decrement, int((~now.ok).sum()), boldness, True)]
    for _ in each(range(max_iterations), "iterations of the fit"):
        if here.decrement < tolerance or rejected >= MAX_REJECTED or walled:
            break
        if len(history) > LOOKED and 2.0 * total(now, x, z) - HOPE * here.decrement**2 > hopeless:
            break
        dx = here.step(boldness, x, np.maximum(low, x - FARTHEST), np.minimum(high, x + FARTHEST))
        dz = offset_step(now, z, dx)
        step = tried(problem, now, (x, z), (dx, dz), (here.pieces, here.offsets), each_point)
        if not step.accepted and not exact(now):
            # no judgement of the step: the derivatives may be what misleads
            now = taken_at(problem, x, z)
            here = _stand(now, x, z, (low, high), kinks)
            history.append(Iteration(total(now, x, z), here.decrement, int((~now.ok).sum()), boldness, False))
            continue
        if not step.accepted and not step.lost and not each_point:
            step = corrected(problem, now, (x, z), step, (low, high))
        trial, (dx, dz) = step.trial, step.change
        near = each_point or dx @ here.pieces.S @ dx <= NEAR**2
        if not each_point and step.accepted:
            trial = served(problem, np.clip(x + dx, low, high), z + dz, step, exact(now))
        elif not each_point and near:
            trial = normal_equations(problem, x + dx, z + dz)
        if not np.array_equal(now.ok, trial.ok):
            kinks.clear()
        elif step.accepted and exact(now):
            kinks.add(Piece(x, here.gradient, total(now, x, z)))
        elif near and not step.accepted:
            kinks.add(Piece(x + dx, reduced(trial, x + dx, z + dz).g, total(trial, x + dx, z + dz)))
        if step.accepted:
            x, z, now = np.clip(x + dx, low, high), z + dz, trial
            rejected = 0
            boldness = min(1.0, boldness * (BOLDER if step.gain > 0.5 * step.promised else 1.0))
        else:
            rejected, walls, walled = rejected + 1, walls + step.lost, step.lost and boldness < CREEPING
            boldness *= SHORTENED if step.lost else SHORTER
        now, here = _confirmed(problem, now, (x, z), (low, high), kinks, derivatives, tolerance)
        history.append(Iteration(total(now, x, z), here.decrement, int((~trial.ok).sum()), boldness, step.accepted))
    end = Fit(x, z, now, here.held & (low < high), False, "", tuple(history))
    return _ended(end, tolerance, rejected if rejected >= MAX_REJECTED or walled else 0, walls)


def resumed(
    problem: Problem, start: tuple[np.ndarray, np.ndarray], fit: Fit | None, *, taken: bool = False
) -> NormalEquations | None:
    """Equations of a problem at the place where a fit of the same records to other noise and sizes has ended, (x, z) in
    the problem's own units, by derivatives that were kept; None where none were, and where they are not those of that
    very place although they are to be `taken` there."""
    at = None if fit is None else fit.equations.at
    if at is None or not at.fits(problem) or (taken and not at.taken):
        return None
    return normal_equations(problem, *start, at)


def _confirmed(
    problem: Problem,
    now: NormalEquations,
    point: tuple[np.ndarray, np.ndarray],
    box: tuple[np.ndarray, np.ndarray],
    kinks: Kinks,
    derivatives: Derivatives,
    tolerance: float,
) -> tuple[NormalEquations, _Here]:
    """Where the search stands; with derivatives of this point where it would be over and they are asked for."""
    here = _stand(now, *point, box, kinks)
    if derivatives is Derivatives.KEPT and not exact(now) and here.decrement < tolerance:
        now = taken_at(problem, *point)
        here = _stand(now, *point, box, kinks)
    return now, here


def _ended(fit: Fit, tolerance: float, in_vain: int, walls: int) -> Fit:
    """The fit with its verdict: converged or not, and why. `in_vain`: rejected steps in a row after which nothing was
    expected of another; 0 where the search ended otherwise."""
    distance = f"{fit.decrement:.1e} standard errors"
    if fit.decrement < tolerance:
        return replace(fit, converged=True, reason=f"the distance to the optimum is {distance}")
    if in_vain:
        if fit.decrement < STALL:
            reason = f"no step lowers the misfit any more; the distance to the optimum is at most {distance}"
            return replace(fit, converged=True, reason=reason)
        reason = f"{in_vain} steps in a row did not lower the misfit, {distance} from the optimum"
    else:
        reason = f"after {fit.steps} iterations the optimum is {distance} away"
    return replace(fit, reason=reason + _walls(walls))


def _walls(count: int) -> str:
    """What stood in the way, when steps were refused because records stopped converging."""
    return f"; {count} steps lost too many converged records" if count else ""


def _stand(
    now: NormalEquations, x: np.ndarray, z: np.ndarray, box: tuple[np.ndarray, np.ndarray], kinks: Kinks
) -> _Here:
    """What is known at one point."""
    arrow = reduced(now, x, z)
    held = ((x <= box[0]) & (arrow.g > 0)) | ((x >= box[1]) & (arrow.g < 0))
    pieces = kinks.about(Piece(x, arrow.g, total(now, x, z)), arrow.S, ~held)
    # z moves with x: what is left of its own gradient is part of the distance to the optimum
    offsets = offset_squared(now, z)
    return _Here(pieces, arrow.g, held, offsets, float(np.sqrt(pieces.combined()[1] + offsets)))
