"""Local statistics about the re-estimated point: the remedy for changes that are not small.

With hundreds of records a change of 1 % moves the outputs by more than the noise in second order, and tests
linear in θ0 isolate the wrong parameters with confidence. So θ̂ is estimated by a few Gauss–Newton steps held
by the prior, and every test reads the residuals carried back linearly from there,

    ẽ_k = y_k − Φ(u_k, θ̂) + Ĵ_k (θ̂ − θ0),      which gives      F̂ = F(θ̂),   s̃ = F̂ (θ̂ − θ0) + s(θ̂).

Parameters that only make nominal uncertain (map shapes, sensor offsets) do not move: their part stays linear
with the sensitivities at nominal, where identification left them, and is eliminated at every step.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.noise import NoiseModel

Predict = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""predict(theta (n, p), rows (n,)) -> y (n, m), J (n, m, p), ok (n,): one parameter vector per record. Except
at nominal, J may hold only the columns of the parameters that move."""
LeftOut = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""left_out(steps (w, q), records (w,)) -> (w,): what steps from nominal add beyond first order, in standard errors."""

NEGLIGIBLE = 0.1
"""Standard errors that a window may leave out by staying at nominal."""
MAX_DAMPING = 1e4
MAX_LOST = 0.05
"""Share of a window's records that may be given up because the model fails on them away from nominal."""


@dataclass(frozen=True)
class Relinearised:
    """Residuals ẽ (N, m) and sensitivities Ĵ (N, m, p) at θ̂, carried back to θ0, for W windows.

    `theta` (W, p); `converged` (W,); `decrement` (W,): size of the last step in standard errors; `ok` (N,):
    records that the model can compute; `iterations` of the longest window.
    """

    theta: np.ndarray
    e: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    converged: np.ndarray
    decrement: np.ndarray
    iterations: int


@dataclass
class _State:
    """Working point of w windows: theta (w, p), residuals and sensitivities of their records, and per window
    the sums z·z (w,), s = Gᵀz (w, p) and F = GᵀG (w, p, p) of whitened residuals and sensitivities."""

    theta: np.ndarray
    e: np.ndarray
    J: np.ndarray
    zz: np.ndarray
    s: np.ndarray
    F: np.ndarray


def relinearise(
    predict: Predict,
    y: np.ndarray,
    theta0: np.ndarray,
    precision: np.ndarray,
    noise: NoiseModel,
    *,
    window: np.ndarray | None = None,
    moving: int | None = None,
    nominal: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    left_out: LeftOut | None = None,
    max_iterations: int = 20,
    tolerance: float = 0.05,
) -> Relinearised:
    """Estimate θ̂ of every window together and linearise there.

    y (N, m) measurements, NaN where missing; theta0 (p,); precision (p, p): inverse prior covariance of
    θ − θ0; window (N,): window number of each record, ascending 0…W−1 (default: one window); moving: number
    of leading parameters that are re-estimated (default: all), the others being linear nuisance; nominal:
    y, J, ok at θ0 when already known, else `predict` is asked. A window has converged when its last step was
    below `tolerance` standard errors in total, or when all that its first step leaves out, by `left_out`, is: such a
    window stays at θ0. Records that fail at θ0 are left out, as are few (MAX_LOST)
    that fail on the way; a step after which more fail is shortened.
    """
    N, p = len(y), len(theta0)
    q = p if moving is None else moving
    window = np.zeros(N, int) if window is None else window
    if np.any(np.diff(window) < 0):
        raise ValueError("`window` must not descend")
    W = int(window[-1]) + 1 if N else 0
    lower, upper = bounds if bounds is not None else (np.full(p, -np.inf), np.full(p, np.inf))
    theta0 = np.asarray(theta0, float)
    start, every = np.tile(theta0, (W, 1)), np.arange(N)
    y0, J0, ok = nominal if nominal is not None else predict(start[window], every)
    ok = np.asarray(ok).copy()
    state = _summed(start, np.where(ok[:, None], y - y0, np.nan), J0.copy(), window, noise)
    cost = _cost(state, theta0, precision, q)
    damping, decrement, active = np.zeros(W), np.full(W, np.inf), np.ones(W, bool)
    iteration = 0
    while iteration < max_iterations and active.any():
        iteration += 1
        chosen = np.flatnonzero(active)
        gradient, hessian = _normal_equations(state, chosen, theta0, precision, q)
        diagonal = damping[chosen, None] * np.einsum("wii->wi", hessian)
        step = np.linalg.solve(hessian + diagonal[:, :, None] * np.eye(q), gradient[:, :, None])[:, :, 0]
        target = state.theta[chosen]
        target[:, :q] = np.clip(target[:, :q] + step, lower[:q], upper[:q])
        taken = (target - state.theta[chosen])[:, :q]
        squared = np.einsum("wi,wij,wj->w", taken, hessian, taken)
        promised = 2 * np.sum(taken * gradient, axis=1) - squared
        length = np.sqrt(squared) * (1 + damping[chosen])  # as long as the step would be without damping
        if left_out is not None and iteration == 1:
            missed = left_out(taken, np.bincount(window, ok, minlength=W))
            length = np.where(missed < NEGLIGIBLE, np.minimum(length, missed), length)
        settled = length < tolerance  # so short a step changes nothing that is carried back: it is not taken
        decrement[chosen[settled]] = length[settled]
        active[chosen[settled]] = False
        chosen, target, squared, promised, length = (x[~settled] for x in (chosen, target, squared, promised, length))
        if not chosen.size:
            break
        rows = np.flatnonzero(active[window])
        slot = np.searchsorted(chosen, window[rows])
        predicted, J, fine = predict(target[slot], rows)
        lost = _drop_failing(state, cost, ok, fine, chosen, rows, slot, theta0, precision, q, noise)
        e = np.where((ok[rows] & fine)[:, None], y[rows] - predicted, np.nan)
        trial = _summed(target, e, np.concatenate([J[:, :, :q], J0[rows, :, q:]], axis=2), slot, noise)
        trial_cost = _cost(trial, theta0, precision, q)
        cost_before = cost[chosen]
        accepted = ~lost & (trial_cost <= cost_before)
        _accept(state, trial, chosen, rows, slot, accepted)
        cost[chosen[accepted]] = trial_cost[accepted]
        kept = np.where(accepted, cost_before - trial_cost, 0.0) / np.maximum(promised, 1e-300)
        damping[chosen] *= np.where(kept > 0.75, 0.2, 1.0)
        damping[chosen] = np.where(kept < 0.4, np.maximum(4 * damping[chosen], 0.2), damping[chosen])
        decrement[chosen[accepted]] = length[accepted]
        active[chosen[damping[chosen] > MAX_DAMPING]] = False
    back = np.einsum("kjp,kp->kj", state.J, (state.theta - theta0)[window])
    return Relinearised(state.theta, state.e + back, state.J, ok, decrement < tolerance, decrement, iteration)


def _summed(theta: np.ndarray, e: np.ndarray, J: np.ndarray, slot: np.ndarray, noise: NoiseModel) -> _State:
    """Working point at theta (w, p) with the sums over the records (n,) of each window `slot` (n,)."""
    w, p = theta.shape
    z, G = whiten(e, J, noise)
    zz = np.bincount(slot, np.sum(z**2, axis=1), minlength=w)
    s, F = np.zeros((w, p)), np.zeros((w, p, p))
    starts, stops = (np.searchsorted(slot, np.arange(w), side=side) for side in ("left", "right"))
    for i, (first, stop) in enumerate(zip(starts, stops, strict=True)):
        columns = G[first:stop].reshape(-1, p)
        s[i], F[i] = columns.T @ z[first:stop].ravel(), columns.T @ columns
    return _State(theta, e, J, zz, s, F)


def _drop_failing(
    state: _State,
    cost: np.ndarray,
    ok: np.ndarray,
    fine: np.ndarray,
    chosen: np.ndarray,
    rows: np.ndarray,
    slot: np.ndarray,
    theta0: np.ndarray,
    precision: np.ndarray,
    q: int,
    noise: NoiseModel,
) -> np.ndarray:
    """Leave failing records out of windows that lose few, for good; which windows lose too many (w,)."""
    failing = ok[rows] & ~fine
    if not failing.any():
        return np.zeros(len(chosen), bool)
    share = np.bincount(slot, failing) / np.maximum(np.bincount(slot, ok[rows]), 1)
    dropped = failing & (share <= MAX_LOST)[slot]
    ok[rows[dropped]] = False
    state.e[rows[dropped]] = np.nan
    again = _summed(state.theta[chosen], state.e[rows], state.J[rows], slot, noise)
    _accept(state, again, chosen, rows, slot, share > 0)
    cost[chosen] = _cost(again, theta0, precision, q)
    return np.asarray(share > MAX_LOST)


def _normal_equations(
    state: _State, chosen: np.ndarray, theta0: np.ndarray, precision: np.ndarray, q: int
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (w, q) and Gauss–Newton matrix (w, q, q) of half the least cost, nuisance eliminated."""
    g = state.s[chosen] - (state.theta[chosen] - theta0) @ precision
    H = state.F[chosen] + precision
    if q == g.shape[1]:
        return g, H
    inner = np.linalg.solve(H[:, q:, q:], np.concatenate([g[:, q:, None], H[:, q:, :q]], axis=2))
    gradient = g[:, :q] - np.einsum("wij,wj->wi", H[:, :q, q:], inner[:, :, 0])
    return gradient, H[:, :q, :q] - H[:, :q, q:] @ inner[:, :, 1:]


def _cost(state: _State, theta0: np.ndarray, precision: np.ndarray, q: int) -> np.ndarray:
    """Σ z² + δᵀPδ of every window (w,), δ = θ − θ0, least over the linear nuisance parameters q, q+1, …

    With g = s − Pδ:  least cost = cost − g_bᵀ (F_bb + P_bb)⁻¹ g_b.
    """
    delta = state.theta - theta0
    pulled = delta @ precision
    cost = state.zz + np.sum(pulled * delta, axis=1)
    g = (state.s - pulled)[:, q:, None]
    if g.shape[1]:
        gained = np.linalg.solve(state.F[:, q:, q:] + precision[q:, q:], g)
        cost = cost - np.sum(g * gained, axis=(1, 2))
    return np.asarray(cost)


def _accept(
    state: _State, trial: _State, chosen: np.ndarray, rows: np.ndarray, slot: np.ndarray, accepted: np.ndarray
) -> None:
    """Take over the accepted (w,) of the chosen windows."""
    moved = accepted[slot]
    state.e[rows[moved]], state.J[rows[moved]] = trial.e[moved], trial.J[moved]
    for name in ("theta", "zz", "s", "F"):
        getattr(state, name)[chosen[accepted]] = getattr(trial, name)[accepted]
