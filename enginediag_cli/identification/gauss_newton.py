"""Regularised Gauss–Newton with a robust loss, bounds and records that may fail to converge.

Minimises  Q(x, z) = Σ_ks ρ(e_ks/σ_s)/κ_s + ½|x|² + ½|z|²  with x and z in prior standard deviations, by

    (S + μ diag S) dx = −g     on the parameters that are not held at a bound,

S being the reweighted normal matrix with priors after elimination of the offsets, μ the damping of
Levenberg and Marquardt chosen by the gain ratio of Nielsen (1999), and the step projected on the bounds
(D. P. Bertsekas, "Projected Newton Methods", SIAM J. Control Optim. 20 (1982) 221–246).

Why not `scipy.optimize.least_squares`: it needs residuals that are all finite (a record that does not
converge would have to count as a perfect fit), calls the model for the Jacobian apart from the residuals, and
builds the (N·m, p + R·q) Jacobian that the elimination of the offsets avoids.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.identification.normal_equations import (
    NormalEquations,
    eliminate,
    normal_equations,
    offset_step,
)
from enginediag_cli.identification.problem import Problem
from enginediag_cli.progress import each

LOST_FRACTION = 0.02
"""A step may lose this share of the converged records; one that loses more is rejected as too long."""

MAX_REJECTED = 12
"""Rejected steps in a row after which the damping is so large that nothing moves any more."""
NEGLIGIBLE = 1e-9  # relative change of cost that is the solver's own rounding


@dataclass(frozen=True)
class Iteration:
    """One model evaluation: cost on all converged records, records lost, and whether the step was taken."""

    cost: float
    decrement: float
    failed: int
    damping: float
    accepted: bool


@dataclass(frozen=True)
class Fit:
    """Where the search ended and why; `converged` must be looked at before anything else."""

    x: np.ndarray  # (p,) in prior standard deviations from the prior mean
    z: np.ndarray  # (R, q) offsets in prior standard deviations
    equations: NormalEquations
    at_bound: np.ndarray  # (p,) held at a bound that the data push against
    converged: bool
    reason: str
    iterations: tuple[Iteration, ...]

    @property
    def decrement(self) -> float:
        """√(gᵀS⁻¹g) at the end: distance to the optimum in standard errors."""
        return self.iterations[-1].decrement if self.iterations else np.nan

    @property
    def failed(self) -> np.ndarray:
        """Records without a prediction at the end, (N,) bool: they took no part in the estimate."""
        return ~self.equations.ok


def solve(
    problem: Problem,
    start: tuple[np.ndarray, np.ndarray] | None = None,
    *,
    max_iterations: int = 40,
    tolerance: float = 1e-3,
) -> Fit:
    """Most probable x and z from `start` (default: prior mean).

    Converged when the Newton decrement is below `tolerance` standard errors. Never raises for a model that
    does not converge: the reason is in the result.
    """
    p, shape = len(problem.parameters), (len(problem.labels), len(problem.offsets))
    low = (problem.lower - problem.prior_mean) / problem.prior_sigma
    high = (problem.upper - problem.prior_mean) / problem.prior_sigma
    x, z = (np.zeros(p), np.zeros(shape)) if start is None else (start[0].copy(), start[1].copy())
    x = np.clip(x, low, high)
    now = normal_equations(problem, x, z)
    history: list[Iteration] = []
    mu, growth, rejected, walls = 1e-3, 2.0, 0, 0
    nothing = np.zeros(p, bool)
    if not now.ok.any():
        return Fit(x, z, now, nothing, False, "no record converged at the starting point", ())
    for _ in each(range(max_iterations), "iterations of the fit"):
        arrow = eliminate(now.H_xx, now.H_xz, now.H_zz, now.g_x, now.g_z, x, z)
        held = ((x <= low) & (arrow.g > 0)) | ((x >= high) & (arrow.g < 0))
        # z moves with x: what is left of its own gradient is part of the distance to the optimum
        decrement = float(np.sqrt(_squared(arrow.S, arrow.g, ~held) + _offset_squared(now, z)))
        if not history:
            history.append(Iteration(_total(now, x, z), decrement, int((~now.ok).sum()), mu, True))
        if decrement < tolerance:
            history[-1] = _with_decrement(history[-1], decrement)
            return Fit(
                x,
                z,
                now,
                held,
                True,
                f"the distance to the optimum is {decrement:.1e} standard errors",
                tuple(history),
            )
        dx = _projected_step(arrow.S, arrow.g, held, mu, x, low, high)
        dz = offset_step(now, z, dx)
        trial = normal_equations(problem, x + dx, z + dz)
        lost = int(np.sum(now.ok & ~trial.ok))
        gain, predicted = _reduction(now, trial, x, z, dx, dz)
        enough = lost <= max(1, LOST_FRACTION * now.ok.sum())
        noise_floor = NEGLIGIBLE * max(_total(now, x, z), 1.0)
        accepted = bool(enough and predicted > 0 and (gain > 1e-4 * predicted or abs(gain) + predicted < noise_floor))
        history.append(
            Iteration(
                _total(trial if accepted else now, x + dx if accepted else x, z + dz if accepted else z),
                decrement,
                int((~trial.ok).sum()),
                mu,
                accepted,
            )
        )
        if accepted:
            x, z, now = np.clip(x + dx, low, high), z + dz, trial
            mu, growth, rejected = mu * max(1 / 3, 1 - (2 * gain / predicted - 1) ** 3), 2.0, 0
            mu = max(mu, 1e-9)
        else:
            mu, growth, rejected, walls = mu * growth, growth * 2, rejected + 1, walls + (not enough)
            if rejected >= MAX_REJECTED:
                reason = f"{rejected} steps in a row did not lower the misfit{_walls(walls)}"
                return Fit(x, z, now, held, False, reason, tuple(history))
    arrow = eliminate(now.H_xx, now.H_xz, now.H_zz, now.g_x, now.g_z, x, z)
    held = ((x <= low) & (arrow.g > 0)) | ((x >= high) & (arrow.g < 0))
    decrement = float(np.sqrt(_squared(arrow.S, arrow.g, ~held) + _offset_squared(now, z)))
    history[-1] = _with_decrement(history[-1], decrement)
    done = bool(decrement < tolerance)
    distance = f"the optimum is {decrement:.1e} standard errors away"
    reason = f"after {max_iterations} iterations {distance}{_walls(walls)}"
    return Fit(x, z, now, held, done, reason, tuple(history))


def _walls(count: int) -> str:
    """What stood in the way, when steps were refused because records stopped converging."""
    return f"; {count} steps lost too many converged records" if count else ""


def _with_decrement(i: Iteration, decrement: float) -> Iteration:
    return Iteration(i.cost, decrement, i.failed, i.damping, i.accepted)


def _projected_step(
    S: np.ndarray,
    g: np.ndarray,
    held: np.ndarray,
    mu: float,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Damped step of the free parameters; one that would cross its bound stops there, the rest re-solve."""
    fixed, dx = held.copy(), np.zeros_like(x)
    while not fixed.all():
        free = ~fixed
        A = S[np.ix_(free, free)]
        A = A + mu * np.diag(np.diag(A))
        dx[free] = np.linalg.solve(A, -(g[free] + S[np.ix_(free, fixed)] @ dx[fixed]))
        target = np.clip(x + dx, low, high) - x
        crossed = free & (target != dx) & (np.abs(target - dx) > 1e-12 * (1 + np.abs(dx)))
        dx = np.where(crossed, target, dx)
        if not crossed.any():
            break
        fixed |= crossed
    return np.clip(x + dx, low, high) - x


def _squared(S: np.ndarray, g: np.ndarray, free: np.ndarray) -> float:
    """gᵀS⁻¹g on the free parameters."""
    if not free.any():
        return 0.0
    return float(g[free] @ np.linalg.solve(S[np.ix_(free, free)], g[free]))


def _offset_squared(n: NormalEquations, z: np.ndarray) -> float:
    """The offsets' share of the decrement at fixed x, Σ_r (g_z + z)ᵀ(H_zz + 1)⁻¹(g_z + z)."""
    g = n.g_z + z
    return float(np.sum(g * np.linalg.solve(n.H_zz + np.eye(z.shape[1]), g[:, :, None])[:, :, 0]))


def _total(n: NormalEquations, x: np.ndarray, z: np.ndarray) -> float:
    return float(n.record_cost[n.ok].sum() + 0.5 * x @ x + 0.5 * np.sum(z**2))


def _reduction(
    now: NormalEquations, trial: NormalEquations, x: np.ndarray, z: np.ndarray, dx: np.ndarray, dz: np.ndarray
) -> tuple[float, float]:
    """Actual and predicted fall of the cost. Compared on the records that both points have: a record that
    fails must not pass for one that fits."""
    both = now.ok & trial.ok
    prior = x @ dx + 0.5 * dx @ dx + np.sum(z * dz) + 0.5 * np.sum(dz**2)
    gain = float((now.record_cost[both] - trial.record_cost[both]).sum() - prior)
    slope = now.g_x @ dx + np.sum(now.g_z * dz)
    bend = (
        dx @ now.H_xx @ dx + 2 * np.einsum("p,rpq,rq->", dx, now.H_xz, dz) + np.einsum("rp,rpq,rq->", dz, now.H_zz, dz)
    )
    return gain, float(-(slope + 0.5 * bend + prior))
