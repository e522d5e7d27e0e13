"""Local statistics about the re-estimated point: the remedy for changes that are not small.

With hundreds of records a change of 1 % moves the outputs by more than the noise in second order, and tests
linear in θ0 isolate the wrong parameters with confidence. So θ̂ is estimated by a few Gauss–Newton steps held
by the prior, and every test reads the residuals carried back linearly from there,

    ẽ_k = y_k − Φ(u_k, θ̂) + Ĵ_k (θ̂ − θ0),      which gives      F̂ = F(θ̂),   s̃ = F̂ (θ̂ − θ0) + s(θ̂).

Parameters that only make nominal uncertain (map shapes, sensor offsets) do not move: their part stays linear
with the sensitivities at nominal, where identification left them, and is eliminated at every step.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.residuals.local import whiten, whitened
from enginediag_cli.residuals.noise import NoiseModel

Predict = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""predict(theta (n, p), rows (n,)) -> y (n, m), J (n, m, p), ok (n,): one parameter vector per record. Except
at nominal, J may hold only the columns of the parameters that move."""
LeftOut = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""left_out(steps (w, q), records (w,)) -> (w,): what steps from nominal add beyond first order, in standard errors."""

NEGLIGIBLE = 0.1
"""Standard errors that a window may leave out by staying at nominal."""
MAX_DAMPING = 1e4
"""Levenberg–Marquardt damping at which a step is a ten-thousandth of the undamped one: the window has given up."""
KEPT_WELL, KEPT_BADLY = 0.75, 0.4
"""Share of the promised fall of the cost above which a step says that the model is nearly linear there, and below which
that it is not. Judgement: the usual gain ratios of a trust region are 0.75 and 0.25, this asks for more."""
RELIEF, TIGHTER, FIRST_DAMPING = 0.2, 4.0, 0.2
"""Factors on the damping after a step that kept its promise and one that did not, and what the damping is then at
least. Judgement: two bad steps are undone by one or two good ones."""
STALLED = 0.01
"""Share of the fall of χ² since nominal that a window may still promise where no step lowers it any more, because the
model is bent there: what is told of the change is then right to a tenth of its distance from nominal, and the sets
that explain it are judged with the full model."""
MAX_LOST = 0.05
"""Share of a window's records that may be given up because the model fails on them away from nominal."""


@dataclass(frozen=True)
class Relinearised:
    """Residuals ẽ (N, m) and sensitivities Ĵ (N, m, p) at θ̂, carried back to θ0, for W windows.

    `theta` (W, p); `converged` (W,); `decrement` (W,): size of the last step in standard errors; `ok` (N,):
    records that the model can compute; `iterations` of the longest window; `information` (W, p, p): ĴᵀR⁻¹Ĵ, summed.
    """

    theta: np.ndarray
    e: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    converged: np.ndarray
    decrement: np.ndarray
    iterations: int
    information: np.ndarray


@dataclass
class _State:
    """Working point of w windows: theta (w, p), residuals and sensitivities of their records (of a trial only to what
    moves, where the others are those at nominal), and per window the sums z·z (w,), s = Gᵀz (w, p) and F = GᵀG
    (w, p, p) of whitened residuals and sensitivities."""

    theta: np.ndarray
    e: np.ndarray
    J: np.ndarray
    zz: np.ndarray
    s: np.ndarray
    F: np.ndarray


@dataclass(frozen=True)
class Hold:
    """Where the estimate of every window begins, and what holds it there.

    theta0 (p,); precision (p, p): inverse prior covariance of θ − θ0; moving: number of leading parameters that are
    re-estimated (None: all), the others being linear nuisance; bounds: lowest and highest θ (p,) each (None: none).
    """

    theta0: np.ndarray
    precision: np.ndarray
    moving: int | None = None
    bounds: tuple[np.ndarray, np.ndarray] | None = None


@dataclass(frozen=True)
class Stop:
    """A window has converged when its last step was below `tolerance` standard errors in total, or when all that its
    first step leaves out, by `left_out`, is: such a window stays at θ0. None goes beyond `max_iterations`."""

    tolerance: float = 0.05
    max_iterations: int = 20
    left_out: LeftOut | None = None


def relinearise(
    predict: Predict,
    y: np.ndarray,
    hold: Hold,
    noise: NoiseModel,
    *,
    window: np.ndarray | None = None,
    nominal: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    stop: Stop | None = None,
) -> Relinearised:
    """Estimate θ̂ of every window together and linearise there.

    y (N, m) measurements, NaN where missing; window (N,): window number of each record, ascending 0…W−1 (default: one
    window); nominal: y, J, ok at θ0 when already known, else `predict` is asked. Records that fail at θ0 are left out,
    as are few (MAX_LOST) that fail on the way; a step after which more fail is shortened. Raises ValueError for
    windows that descend.
    """
    window = np.zeros(len(y), int) if window is None else window
    if np.any(np.diff(window) < 0):
        raise ValueError("`window` must not descend")
    loop = _Loop(predict, y, hold, noise, window, nominal)
    loop.run(stop or Stop())
    return loop.carried_back()


@dataclass(frozen=True)
class _Steps:
    """Steps of the windows `chosen` (w,): where they lead (w, p), by how much they should lower the cost (w,), and how
    long they are in standard errors (w,)."""

    chosen: np.ndarray
    target: np.ndarray
    taken: np.ndarray
    promised: np.ndarray
    length: np.ndarray

    def of(self, some: np.ndarray) -> _Steps:
        """Those of some (w,) of the windows."""
        return _Steps(self.chosen[some], self.target[some], self.taken[some], self.promised[some], self.length[some])


class _Loop:
    """Damped Gauss–Newton steps of W windows at once; each has its own damping and stops by itself."""

    def __init__(
        self,
        predict: Predict,
        y: np.ndarray,
        hold: Hold,
        noise: NoiseModel,
        window: np.ndarray,
        nominal: tuple[np.ndarray, np.ndarray, np.ndarray] | None,
    ) -> None:
        self.predict, self.y, self.noise, self.window = predict, y, noise, window
        self.theta0, self.precision = np.asarray(hold.theta0, float), hold.precision
        N, p = len(y), len(self.theta0)
        self.q = p if hold.moving is None else hold.moving
        self.lower, self.upper = hold.bounds or (np.full(p, -np.inf), np.full(p, np.inf))
        W = int(window[-1]) + 1 if N else 0
        start = np.tile(self.theta0, (W, 1))
        y0, self.J0, ok = nominal if nominal is not None else predict(start[window], np.arange(N))
        self.ok = np.asarray(ok).copy()
        e0 = np.where(self.ok[:, None], y - y0, np.nan)
        z0, self.G0, self.present = whitened(e0, self.J0, noise)
        self.state = _State(start, e0, self.J0, *_sums(z0, self.G0, window, W))
        self.cost = self._cost(self.state)
        self.at_nominal = self.cost.copy()
        self.damping, self.decrement, self.active = np.zeros(W), np.full(W, np.inf), np.ones(W, bool)
        self.iteration = 0
        self.tolerance = 0.0

    def run(self, stop: Stop) -> None:
        """Step until every window has converged or given up."""
        self.tolerance = stop.tolerance
        while self.iteration < stop.max_iterations and self.active.any():
            self.iteration += 1
            steps = self._steps()
            length = steps.length
            if stop.left_out is not None and self.iteration == 1:
                missed = stop.left_out(steps.taken, np.bincount(self.window, self.ok, minlength=len(self.cost)))
                length = np.where(missed < NEGLIGIBLE, np.minimum(length, missed), length)
            settled = length < stop.tolerance  # so short a step changes nothing that is carried back: it is not taken
            self.decrement[steps.chosen[settled]] = length[settled]
            self.active[steps.chosen[settled]] = False
            remaining = replace(steps, length=length).of(~settled)
            if not remaining.chosen.size:
                break
            self._try(remaining)

    def carried_back(self) -> Relinearised:
        """Residuals and sensitivities where the loop stands, carried back to θ0."""
        state, q = self.state, self.q
        back = np.einsum("kjp,kp->kj", state.J[:, :, :q], (state.theta - self.theta0)[self.window, :q])
        return Relinearised(
            theta=state.theta,
            e=state.e + back,
            J=state.J,
            ok=self.ok,
            converged=(self.decrement < self.tolerance) | self._stalled(),
            decrement=self.decrement,
            iterations=self.iteration,
            information=state.F,
        )

    def _stalled(self) -> np.ndarray:
        """Windows (w,) that are near enough to the least cost, although no step reaches it."""
        fallen = np.maximum(self.at_nominal - self.cost, 0.0)
        return np.asarray(self.decrement**2 < STALLED * fallen)

    def _steps(self) -> _Steps:
        """The next step of every active window, within the bounds."""
        chosen, q = np.flatnonzero(self.active), self.q
        gradient, hessian = self._normal_equations(chosen)
        diagonal = self.damping[chosen, None] * np.einsum("wii->wi", hessian)
        step = np.linalg.solve(hessian + diagonal[:, :, None] * np.eye(q), gradient[:, :, None])[:, :, 0]
        target = self.state.theta[chosen]
        target[:, :q] = np.clip(target[:, :q] + step, self.lower[:q], self.upper[:q])
        taken = (target - self.state.theta[chosen])[:, :q]
        squared = np.einsum("wi,wij,wj->w", taken, hessian, taken)
        promised = 2 * np.sum(taken * gradient, axis=1) - squared
        length = np.sqrt(squared) * (1 + self.damping[chosen])  # as long as the step would be without damping
        return _Steps(chosen, target, taken, promised, length)

    def _try(self, steps: _Steps) -> None:
        """Take the steps that lower the cost, and damp the next ones by how well they kept their promise."""
        chosen, q = steps.chosen, self.q
        rows = np.flatnonzero(self.active[self.window])
        slot = np.searchsorted(chosen, self.window[rows])
        predicted, J, fine = self.predict(steps.target[slot], rows)
        lost = self._drop_failing(fine, chosen, rows, slot)
        e = np.where((self.ok[rows] & fine)[:, None], self.y[rows] - predicted, np.nan)
        trial = self._trial(steps, e, J[:, :, :q], rows, slot)
        trial_cost = self._cost(trial)
        before = self.cost[chosen]
        accepted = ~lost & (trial_cost <= before)
        self._accept(trial, chosen, rows, slot, accepted)
        self._across_kinks(trial, chosen, rows, slot, ~lost & ~accepted & (self.damping[chosen] >= FIRST_DAMPING))
        self.cost[chosen[accepted]] = trial_cost[accepted]
        kept = np.where(accepted, before - trial_cost, 0.0) / np.maximum(steps.promised, 1e-300)
        damping = self.damping[chosen] * np.where(kept > KEPT_WELL, RELIEF, 1.0)
        self.damping[chosen] = np.where(kept < KEPT_BADLY, np.maximum(TIGHTER * damping, FIRST_DAMPING), damping)
        # of a refused step, too: it is how far the least cost seems to be from here
        self.decrement[chosen] = steps.length
        self.active[chosen[self.damping[chosen] > MAX_DAMPING]] = False

    def _trial(self, steps: _Steps, e: np.ndarray, J: np.ndarray, rows: np.ndarray, slot: np.ndarray) -> _State:
        """Where the steps lead, with residuals e (n, m) and sensitivities J (n, m, q) there. The other parameters keep
        their sensitivities, and the sums over them, as long as the same measurements count."""
        q, chosen = self.q, steps.chosen
        z, G, present = whitened(e, J, self.noise)
        if not np.array_equal(present, self.present[rows]):
            return _summed(steps.target, e, np.concatenate([J, self.J0[rows, :, q:]], axis=2), slot, self.noise)
        zz = np.bincount(slot, np.sum(z**2, axis=1), minlength=len(chosen))
        s, F = np.empty_like(self.state.s[chosen]), self.state.F[chosen]
        for i, (first, stop) in enumerate(_runs(slot, len(chosen))):
            part = slice(rows[first], rows[stop - 1] + 1)  # the records of a window follow each other
            moved, whole = G[first:stop].reshape(-1, q), self.G0[part].reshape(-1, self.G0.shape[2])
            residual = z[first:stop].ravel()
            s[i, :q], s[i, q:] = moved.T @ residual, (residual @ whole)[q:]
            F[i, :q, q:] = (moved.T @ whole)[:, q:]
            F[i, q:, :q], F[i, :q, :q] = F[i, :q, q:].T, moved.T @ moved
        return _State(steps.target, e, J, zz, s, F)

    def _across_kinks(
        self, trial: _State, chosen: np.ndarray, rows: np.ndarray, slot: np.ndarray, refused: np.ndarray
    ) -> None:
        """Windows (w,) whose shortened step was refused again: the model is bent between here and there, as maps read
        linearly are, and the mean of the sensitivities on both sides tells its course better than either."""
        if not refused.any():
            return
        bent = refused[slot]
        J, width = self.state.J[rows], trial.J.shape[2]
        mean = 0.5 * (J[:, :, :width] + trial.J)
        J[:, :, :width] = np.where(np.isfinite(trial.J) & bent[:, None, None], mean, J[:, :, :width])
        again = _summed(self.state.theta[chosen], self.state.e[rows], J, slot, self.noise)
        self._accept(again, chosen, rows, slot, refused)

    def _drop_failing(self, fine: np.ndarray, chosen: np.ndarray, rows: np.ndarray, slot: np.ndarray) -> np.ndarray:
        """Leave failing records out of windows that lose few, for good; which windows lose too many (w,)."""
        state, ok = self.state, self.ok
        failing = ok[rows] & ~fine
        if not failing.any():
            return np.zeros(len(chosen), bool)
        share = np.bincount(slot, failing) / np.maximum(np.bincount(slot, ok[rows]), 1)
        dropped = failing & (share <= MAX_LOST)[slot]
        ok[rows[dropped]] = False
        state.e[rows[dropped]] = np.nan
        again = _summed(state.theta[chosen], state.e[rows], state.J[rows], slot, self.noise)
        self._accept(again, chosen, rows, slot, share > 0)
        self.cost[chosen] = self._cost(again)
        return np.asarray(share > MAX_LOST)

    def _accept(
        self, trial: _State, chosen: np.ndarray, rows: np.ndarray, slot: np.ndarray, accepted: np.ndarray
    ) -> None:
        """Take over the accepted (w,) of the chosen windows."""
        moved = accepted[slot]
        if self.state.J is self.J0:  # which is the caller's, and has what is not re-estimated
            self.state.J = self.J0.copy()
        self.state.e[rows[moved]] = trial.e[moved]
        self.state.J[rows[moved], :, : trial.J.shape[2]] = trial.J[moved]
        for name in ("theta", "zz", "s", "F"):
            getattr(self.state, name)[chosen[accepted]] = getattr(trial, name)[accepted]

    def _normal_equations(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (w, q) and Gauss–Newton matrix (w, q, q) of half the least cost, nuisance eliminated."""
        state, q = self.state, self.q
        g = state.s[chosen] - (state.theta[chosen] - self.theta0) @ self.precision
        H = state.F[chosen] + self.precision
        if q == g.shape[1]:
            return g, H
        inner = np.linalg.solve(H[:, q:, q:], np.concatenate([g[:, q:, None], H[:, q:, :q]], axis=2))
        gradient = g[:, :q] - np.einsum("wij,wj->wi", H[:, :q, q:], inner[:, :, 0])
        return gradient, H[:, :q, :q] - H[:, :q, q:] @ inner[:, :, 1:]

    def _cost(self, state: _State) -> np.ndarray:
        """Σ z² + δᵀPδ of every window (w,), δ = θ − θ0, least over the linear nuisance parameters q, q+1, …

        With g = s − Pδ:  least cost = cost − g_bᵀ (F_bb + P_bb)⁻¹ g_b.
        """
        q, precision = self.q, self.precision
        delta = state.theta - self.theta0
        pulled = delta @ precision
        cost = state.zz + np.sum(pulled * delta, axis=1)
        g = (state.s - pulled)[:, q:, None]
        if g.shape[1]:
            gained = np.linalg.solve(state.F[:, q:, q:] + precision[q:, q:], g)
            cost = cost - np.sum(g * gained, axis=(1, 2))
        return np.asarray(cost)


def _summed(theta: np.ndarray, e: np.ndarray, J: np.ndarray, slot: np.ndarray, noise: NoiseModel) -> _State:
    """Working point at theta (w, p) with the sums over the records (n,) of each window `slot` (n,)."""
    return _State(theta, e, J, *_sums(*whiten(e, J, noise), slot, len(theta)))


def _sums(z: np.ndarray, G: np.ndarray, slot: np.ndarray, w: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z·z (w,), Gᵀz (w, p) and GᵀG (w, p, p) of whitened residuals (n, m) and sensitivities (n, m, p)."""
    p = G.shape[2]
    zz = np.bincount(slot, np.sum(z**2, axis=1), minlength=w)
    s, F = np.zeros((w, p)), np.zeros((w, p, p))
    for i, (first, stop) in enumerate(_runs(slot, w)):
        columns = G[first:stop].reshape(-1, p)
        s[i], F[i] = columns.T @ z[first:stop].ravel(), columns.T @ columns
    return zz, s, F


def _runs(slot: np.ndarray, w: int) -> Iterator[tuple[int, int]]:
    """First record of each window, and the one after its last."""
    starts, stops = (np.searchsorted(slot, np.arange(w), side=side) for side in ("left", "right"))
    return zip(starts.tolist(), stops.tolist(), strict=True)
