"""Local statistics about the re-estimated point: the remedy for changes that are not small.

With hundreds of records a change of 1 % moves the outputs by more than the noise in second order, and tests
linear in θ0 isolate the wrong parameters with confidence. So θ̂ is estimated by a few Gauss–Newton steps with
the prior, and every test reads the residuals carried back linearly from there,

    ẽ_k = y_k − Φ(u_k, θ̂) + Ĵ_k (θ̂ − θ0),      which gives      F̂ = F(θ̂),   s̃ = F̂ (θ̂ − θ0) + s(θ̂).

Parameters that only make nominal uncertain (map shapes, sensor offsets) do not move: their part stays linear
with the sensitivities at nominal, where identification left them, and is eliminated at every step.

The steps need nothing of the records but sums over them (`Sums`), which `Records` hands over: from memory here, from a
file, a stretch at a time, in `long_windows.py`.

**Errors of operating points.** An error δ_c ~ N(0, diag v) of k of the parameters at operating point c, independent of
that at any other, adds to s

    Σ_c F_c δ_c        of covariance        M = Σ_q v_q Q_q,    Q_q = Σ_c f_cq f_cqᵀ,

F_c being the information of the records at point c and f_cq its column of parameter q. With nuisance of covariance C
counted as noise, s becomes (1 + F C)⁻¹ s, and M with it. In units of a change of the parameters that is

    (F + S⁻²)⁻¹ M (F + S⁻²)⁻¹,     S = diag(prior_sigma):

in directions of which the records contain less than is known beforehand, such as a bias and a scale of one instrument
against each other, F⁺ M F⁺ would be huge changes that cancel at the point where F was computed, and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from enginediag_cli.identification.map_error import OperatingPointCells
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.statistics import LocalStatistics, covariance_root, range_space, whiten, whitened

Predict = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""predict(theta (n, p), rows (n,)) -> y (n, m), J (n, m, p), ok (n,): one parameter vector per record. Except
at nominal, J may hold only the columns of the parameters that move."""
NeglectedError = Callable[[np.ndarray, np.ndarray], np.ndarray]
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
ROUNDS = 5
"""Times that parameters which a step takes beyond their bounds are put there and the others solved again: more than
that many by turns are seldom met, and what is then left is found by the next step."""
STALLED = 0.01
"""Share of the fall of χ² since nominal that a window may still promise where no step lowers it any more, because the
model is bent there: what is concluded about the change is then right to a tenth of its distance from nominal, and the
sets that explain it are judged with the full model."""
MAX_LOST_SHARE = 0.05
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
class LinearisedSums:
    """Of w windows at theta (w, p): z·z (w,), s = Gᵀz (w, p) and F = GᵀG (w, p, p) of whitened residuals and
    sensitivities."""

    theta: np.ndarray
    zz: np.ndarray
    s: np.ndarray
    F: np.ndarray

    def take(self, other: LinearisedSums, into: np.ndarray, some: np.ndarray) -> None:
        """Take over `some` (v,) of the windows of another, which are those `into` (v,) of these."""
        for name in ("theta", "zz", "s", "F"):
            getattr(self, name)[into[some]] = getattr(other, name)[some]


@dataclass(frozen=True)
class EstimatePrior:
    """Where the estimate of every window begins, and what holds it there.

    theta0 (p,); precision (p, p): inverse prior covariance of θ − θ0; moving: number of leading parameters that are
    re-estimated (None: all), the others being linear nuisance; bounds: lowest and highest θ (p,) each (None: none).
    """

    theta0: np.ndarray
    precision: np.ndarray
    moving: int | None = None
    bounds: tuple[np.ndarray, np.ndarray] | None = None

    @property
    def q(self) -> int:
        """How many parameters move."""
        return len(self.theta0) if self.moving is None else self.moving


@dataclass(frozen=True)
class Stop:
    """A window has converged when its last step was below `tolerance` standard errors in total, or when all that its
    first step leaves out, by `left_out`, is: such a window stays where it began. None goes beyond `max_iterations`."""

    tolerance: float = 0.05
    max_iterations: int = 20
    neglected: NeglectedError | None = None


@dataclass(frozen=True)
class TrialSums:
    """Sums at a trial point of some windows (w,): `lost`, which of them lose too many records there; `again`: sums
    where these windows stand now, if some lost records for good, and `fewer`, which did."""

    sums: LinearisedSums
    lost_too_many: np.ndarray
    current: LinearisedSums | None = None
    lost_some: np.ndarray | None = None


class RecordSums(Protocol):
    """The records of W windows, as sums over them where the windows stand and at a trial point."""

    @property
    def used(self) -> np.ndarray:
        """Records of each window (W,) that the model can compute."""

    def begin(self) -> tuple[LinearisedSums, LinearisedSums]:
        """Where the windows begin, and at nominal."""

    def trial(self, chosen: np.ndarray, target: np.ndarray, here: LinearisedSums) -> TrialSums:
        """At target (w, p), of the windows `chosen` (w,), which stand where `here` says."""

    def move(self, accepted: np.ndarray) -> None:
        """The chosen windows that are accepted (w,) are at the trial point from now on."""

    def bend(self, refused: np.ndarray) -> LinearisedSums:
        """The chosen windows that are refused (w,) have the mean of the sensitivities where they stand and at the trial
        point from now on: their sums where they stand."""


def relinearise(
    predict: Predict,
    y: np.ndarray,
    hold: EstimatePrior,
    noise: NoiseModel,
    *,
    window: np.ndarray | None = None,
    nominal: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    stop: Stop | None = None,
) -> Relinearised:
    """Estimate θ̂ of every window together and linearise there.

    y (N, m) measurements, NaN where missing; window (N,): window number of each record, ascending 0…W−1 (default: one
    window); nominal: y, J, ok at θ0 when already known, else `predict` computes them. Records that fail at θ0 are
    excluded, as are few (MAX_LOST) that fail on the way; a step after which more fail is shortened. Raises ValueError
    for windows that descend.
    """
    window = np.zeros(len(y), int) if window is None else window
    if np.any(np.diff(window) < 0):
        raise ValueError("`window` must not descend")
    records = _RecordsInMemory(predict, y, hold, noise, window, nominal)
    loop = GaussNewton(records, hold)
    loop.run(stop or Stop())
    e, J = records.carry_to_nominal(loop.sums.theta)
    return Relinearised(
        theta=loop.sums.theta,
        e=e,
        J=J,
        ok=records.ok,
        converged=loop.converged,
        decrement=loop.decrement,
        iterations=loop.iteration,
        information=loop.sums.F,
    )


@dataclass(frozen=True)
class _WindowSteps:
    """Steps of the windows `chosen` (w,): where they lead (w, p), by how much they should lower the cost (w,), and how
    long they are in standard errors (w,)."""

    chosen: np.ndarray
    target: np.ndarray
    change: np.ndarray
    promised: np.ndarray
    length: np.ndarray

    def select(self, some: np.ndarray) -> _WindowSteps:
        """Those of some (w,) of the windows."""
        return _WindowSteps(
            self.chosen[some], self.target[some], self.change[some], self.promised[some], self.length[some]
        )


def bounded_steps(gradient: np.ndarray, hessian: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Steps (w, q) that maximise gᵀx − ½ xᵀHx with g (w, q) and H (w, q, q), from low to high (w, q): what would go
    beyond a bound stays at it, and the others follow without it (D. P. Bertsekas, SIAM J. Control Optim. 20 (1982) 221:
    projected Newton steps)."""
    step, fixed = np.zeros_like(gradient), np.zeros(gradient.shape, bool)
    for _ in range(ROUNDS):
        right = np.where(fixed, step, gradient - np.einsum("wij,wj->wi", hessian, np.where(fixed, step, 0.0)))
        free = ~fixed[:, :, None] & ~fixed[:, None, :]
        own = fixed[:, :, None] & np.eye(gradient.shape[1], dtype=bool)
        step = np.linalg.solve(np.where(free, hessian, own), right[:, :, None])[:, :, 0]
        beyond = ~fixed & ((step < low) | (step > high))
        step = np.clip(step, low, high)
        if not beyond.any():
            break
        fixed |= beyond
    return step


class GaussNewton:
    """Damped Gauss–Newton steps of W windows at once; each has its own damping and stops by itself."""

    def __init__(self, records: RecordSums, hold: EstimatePrior) -> None:
        self.records = records
        self.theta0, self.precision, self.q = np.asarray(hold.theta0, float), hold.precision, hold.q
        p = len(self.theta0)
        self.lower, self.upper = hold.bounds or (np.full(p, -np.inf), np.full(p, np.inf))
        self.sums, nominal = records.begin()
        W = len(self.sums.zz)
        self.cost, self.at_nominal = self._cost(self.sums), self._cost(nominal)
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
            if stop.neglected is not None and self.iteration == 1:
                missed = stop.neglected(steps.change, self.records.used)
                length = np.where(missed < NEGLIGIBLE, np.minimum(length, missed), length)
            settled = length < stop.tolerance  # so short a step changes nothing that is carried back: it is not taken
            self.decrement[steps.chosen[settled]] = length[settled]
            self.active[steps.chosen[settled]] = False
            remaining = replace(steps, length=length).select(~settled)
            if not remaining.chosen.size:
                break
            self._try(remaining)

    @property
    def converged(self) -> np.ndarray:
        """Windows (W,) whose last step was short, or that are near enough to the least cost although no step reaches
        it."""
        fallen = np.maximum(self.at_nominal - self.cost, 0.0)
        return np.asarray((self.decrement < self.tolerance) | (self.decrement**2 < STALLED * fallen))

    @property
    def next_points(self) -> np.ndarray:
        """Where the next step leads (w, p), of the windows that still move, without asking whether it should."""
        return self._steps().target

    def _steps(self) -> _WindowSteps:
        """The next step of every active window, within the bounds."""
        chosen, q = np.flatnonzero(self.active), self.q
        gradient, hessian = self._normal_equations(chosen)
        diagonal = self.damping[chosen, None] * np.einsum("wii->wi", hessian)
        target = self.sums.theta[chosen]
        low, high = self.lower[:q] - target[:, :q], self.upper[:q] - target[:, :q]
        taken = bounded_steps(gradient, hessian + diagonal[:, :, None] * np.eye(q), low, high)
        target[:, :q] += taken
        squared = np.einsum("wi,wij,wj->w", taken, hessian, taken)
        promised = 2 * np.sum(taken * gradient, axis=1) - squared
        length = np.sqrt(squared) * (1 + self.damping[chosen])  # as long as the step would be without damping
        return _WindowSteps(chosen, target, taken, promised, length)

    def _try(self, steps: _WindowSteps) -> None:
        """Take the steps that lower the cost, and damp the next ones by how well they kept their promise."""
        chosen = steps.chosen
        trial = self.records.trial(chosen, steps.target, self.sums)
        if trial.current is not None and trial.lost_some is not None:
            self.sums.take(trial.current, chosen, trial.lost_some)
            self.cost[chosen] = self._cost(trial.current)
        trial_cost = self._cost(trial.sums)
        before = self.cost[chosen]
        accepted = ~trial.lost_too_many & (trial_cost <= before)
        self.records.move(accepted)
        self.sums.take(trial.sums, chosen, accepted)
        # shortened and refused again: the model is bent between here and there, as maps read linearly are, and the mean
        # of the sensitivities on both sides tells its course better than either
        bent = ~trial.lost_too_many & ~accepted & (self.damping[chosen] >= FIRST_DAMPING)
        if bent.any():
            self.sums.take(self.records.bend(bent), chosen, bent)
        self.cost[chosen[accepted]] = trial_cost[accepted]
        kept = np.where(accepted, before - trial_cost, 0.0) / np.maximum(steps.promised, 1e-300)
        damping = self.damping[chosen] * np.where(kept > KEPT_WELL, RELIEF, 1.0)
        self.damping[chosen] = np.where(kept < KEPT_BADLY, np.maximum(TIGHTER * damping, FIRST_DAMPING), damping)
        # of a refused step, too: it is how far the least cost seems to be from here
        self.decrement[chosen] = steps.length
        self.active[chosen[self.damping[chosen] > MAX_DAMPING]] = False

    def _normal_equations(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (w, q) and Gauss–Newton matrix (w, q, q) of half the least cost, nuisance eliminated."""
        sums, q = self.sums, self.q
        g = sums.s[chosen] - (sums.theta[chosen] - self.theta0) @ self.precision
        H = sums.F[chosen] + self.precision
        if q == g.shape[1]:
            return g, H
        inner = np.linalg.solve(H[:, q:, q:], np.concatenate([g[:, q:, None], H[:, q:, :q]], axis=2))
        gradient = g[:, :q] - np.einsum("wij,wj->wi", H[:, :q, q:], inner[:, :, 0])
        return gradient, H[:, :q, :q] - H[:, :q, q:] @ inner[:, :, 1:]

    def _cost(self, sums: LinearisedSums) -> np.ndarray:
        """Σ z² + δᵀPδ of every window (w,), δ = θ − θ0, least over the linear nuisance parameters q, q+1, …

        With g = s − Pδ:  least cost = cost − g_bᵀ (F_bb + P_bb)⁻¹ g_b.
        """
        q, precision = self.q, self.precision
        delta = sums.theta - self.theta0
        pulled = delta @ precision
        cost = sums.zz + np.sum(pulled * delta, axis=1)
        g = (sums.s - pulled)[:, q:, None]
        if g.shape[1]:
            gained = np.linalg.solve(sums.F[:, q:, q:] + precision[q:, q:], g)
            cost = cost - np.sum(g * gained, axis=(1, 2))
        return np.asarray(cost)


class _RecordsInMemory:
    """Records (N,) of W windows with residuals e (N, m) and sensitivities J (N, m, p) where their windows stand, and
    of a trial, to what moves alone: the others keep their sensitivities at nominal."""

    def __init__(
        self,
        predict: Predict,
        y: np.ndarray,
        hold: EstimatePrior,
        noise: NoiseModel,
        window: np.ndarray,
        nominal: tuple[np.ndarray, np.ndarray, np.ndarray] | None,
    ) -> None:
        self.predict, self.y, self.noise, self.window = predict, y, noise, window
        self.theta0, self.q = np.asarray(hold.theta0, float), hold.q
        self.W = int(window[-1]) + 1 if len(y) else 0
        y0, self.J0, ok = nominal if nominal is not None else predict(self._start[window], np.arange(len(y)))
        self.ok = np.asarray(ok).copy()
        self.e, self.J = np.where(self.ok[:, None], y - y0, np.nan), self.J0
        self.trial_e, self.trial_J = self.e[:0], self.J[:0]
        self.here = self._start
        self.rows = self.slot = np.zeros(0, int)

    @property
    def _start(self) -> np.ndarray:
        return np.tile(self.theta0, (self.W, 1))

    @property
    def used(self) -> np.ndarray:
        return np.bincount(self.window, self.ok, minlength=self.W)

    def begin(self) -> tuple[LinearisedSums, LinearisedSums]:
        z, self.G0, self.present = whitened(self.e, self.J0, self.noise)
        nominal = LinearisedSums(self._start, *_sums(z, self.G0, self.window, self.W))
        return replace(nominal, **{n: getattr(nominal, n).copy() for n in ("zz", "s", "F")}), nominal

    def carry_to_nominal(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals and sensitivities where the windows stand, at theta (W, p), carried back to θ0."""
        q = self.q
        back = np.einsum("kjp,kp->kj", self.J[:, :, :q], (theta - self.theta0)[self.window, :q])
        return self.e + back, self.J

    def trial(self, chosen: np.ndarray, target: np.ndarray, here: LinearisedSums) -> TrialSums:
        active = np.zeros(self.W, bool)
        active[chosen] = True
        rows = self.rows = np.flatnonzero(active[self.window])
        slot = self.slot = np.searchsorted(chosen, self.window[rows])
        self.here = here.theta[chosen]
        predicted, J, fine = self.predict(target[slot], rows)
        again, lost, fewer = self._drop_failing(fine, self.here)
        self.trial_e = np.where((self.ok[rows] & fine)[:, None], self.y[rows] - predicted, np.nan)
        self.trial_J = J[:, :, : self.q]
        unmoved = again.F if again is not None else here.F[chosen]
        return TrialSums(self._trial_sums(target, unmoved), lost, again, fewer)

    def _trial_sums(self, target: np.ndarray, unmoved: np.ndarray) -> LinearisedSums:
        """Sums at target (w, p); unmoved (w, p, p): F where the windows stand, whose part that does not move stays as
        long as the same measurements count."""
        q, rows, slot, w = self.q, self.rows, self.slot, len(target)
        z, G, present = whitened(self.trial_e, self.trial_J, self.noise)
        if not np.array_equal(present, self.present[rows]):
            J = np.concatenate([self.trial_J, self.J0[rows, :, q:]], axis=2)
            return _summed(target, self.trial_e, J, slot, self.noise)
        zz = np.bincount(slot, np.sum(z**2, axis=1), minlength=w)
        s, F = np.empty(target.shape), unmoved.copy()
        for i, (first, stop) in enumerate(_runs(slot, w)):
            part = slice(rows[first], rows[stop - 1] + 1)  # the records of a window follow each other
            moved, whole = G[first:stop].reshape(-1, q), self.G0[part].reshape(-1, self.G0.shape[2])
            residual = z[first:stop].ravel()
            s[i, :q], s[i, q:] = moved.T @ residual, (residual @ whole)[q:]
            F[i, :q, q:] = (moved.T @ whole)[:, q:]
            F[i, q:, :q], F[i, :q, :q] = F[i, :q, q:].T, moved.T @ moved
        return LinearisedSums(target, zz, s, F)

    def _drop_failing(
        self, fine: np.ndarray, theta: np.ndarray
    ) -> tuple[LinearisedSums | None, np.ndarray, np.ndarray | None]:
        """Leave failing records out of windows that lose few, for good: the sums of the chosen windows then, which lose
        too many (w,), and which lose any (w,)."""
        rows, slot = self.rows, self.slot
        failing = self.ok[rows] & ~fine
        if not failing.any():
            return None, np.zeros(len(theta), bool), None
        share = np.bincount(slot, failing) / np.maximum(np.bincount(slot, self.ok[rows]), 1)
        dropped = failing & (share <= MAX_LOST_SHARE)[slot]
        self.ok[rows[dropped]] = False
        self.e[rows[dropped]] = np.nan
        again = _summed(theta, self.e[rows], self.J[rows], slot, self.noise)
        return again, np.asarray(share > MAX_LOST_SHARE), np.asarray(share > 0)

    def move(self, accepted: np.ndarray) -> None:
        moved = accepted[self.slot]
        self._take(self.trial_e[moved], self.trial_J[moved], self.rows[moved])

    def bend(self, refused: np.ndarray) -> LinearisedSums:
        bent, q = refused[self.slot], self.q
        J = self.J[self.rows]
        mean = 0.5 * (J[:, :, :q] + self.trial_J)
        J[:, :, :q] = np.where(np.isfinite(self.trial_J) & bent[:, None, None], mean, J[:, :, :q])
        self._take(self.e[self.rows[bent]], J[bent], self.rows[bent])
        return _summed(self.here, self.e[self.rows], J, self.slot, self.noise)

    def _take(self, e: np.ndarray, J: np.ndarray, rows: np.ndarray) -> None:
        if self.J is self.J0:  # which is the caller's, and has what is not re-estimated
            self.J = self.J0.copy()
        self.e[rows] = e
        self.J[rows, :, : J.shape[2]] = J


def _summed(theta: np.ndarray, e: np.ndarray, J: np.ndarray, slot: np.ndarray, noise: NoiseModel) -> LinearisedSums:
    """Sums at theta (w, p) over the records (n,) of each window `slot` (n,)."""
    return LinearisedSums(theta, *_sums(*whiten(e, J, noise), slot, len(theta)))


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


class PointSums:
    """f_cq of the parameters at `columns` (k,), record by record, in operating points that `laid_by` (N, m)
    distinguishes: predictions of all of the records, or of some that lie everywhere among them."""

    def __init__(self, noise: NoiseModel, columns: np.ndarray, laid_by: np.ndarray):
        self._noise, self._columns = noise, columns
        computed = laid_by[np.isfinite(laid_by).all(axis=1)]
        self._cells = OperatingPointCells(computed) if len(computed) else None
        self._sums: dict[tuple[int, ...], np.ndarray] = {}

    def add(self, predicted: np.ndarray, e: np.ndarray, J: np.ndarray) -> None:
        """Records with predictions and residuals (N, m) and sensitivities (N, m, p); those without a residual are at no
        point."""
        there = np.isfinite(e).any(axis=1) & np.isfinite(predicted).all(axis=1)
        if self._cells is None or not there.any():
            return
        _, G = whiten(e[there], J[there], self._noise)
        places, cell = np.unique(self._cells.places(predicted[there]), axis=0, return_inverse=True)
        order = np.argsort(cell.reshape(-1), kind="stable")
        groups = np.split(order, np.cumsum(np.bincount(cell.reshape(-1)))[:-1])
        for place, rows in zip(places.tolist(), groups, strict=True):
            flat = G[rows].reshape(-1, G.shape[2])
            self._sums[tuple(place)] = self._sums.get(tuple(place), 0.0) + flat.T @ flat[:, self._columns]

    def squared(self, p: int) -> np.ndarray:
        """Q (k, p, p)."""
        found = np.zeros((len(self._columns), p, p))
        for f in self._sums.values():
            found += f.T[:, :, None] * f.T[:, None, :]
        return found


def point_sums(
    predicted: np.ndarray, e: np.ndarray, J: np.ndarray, noise: NoiseModel, columns: np.ndarray
) -> np.ndarray:
    """Q (k, p, p) for the parameters at `columns` (k,), from predictions and residuals (N, m) and sensitivities
    (N, m, p)."""
    there = np.isfinite(e).any(axis=1)
    sums = PointSums(noise, columns, predicted[there])
    sums.add(predicted, e, J)
    return sums.squared(J.shape[2])


def covariance_of_change(
    statistics: LocalStatistics, kept: LocalStatistics, uncertainty: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """(F + S⁻²)⁻¹ M (F + S⁻²)⁻¹ (a, a) of the parameters of `kept`, which `statistics` become with `uncertainty` (p, p)
    as noise.

    variance (k,): of the error of each parameter at one point, in the order of `statistics.points`.
    """
    assert statistics.points is not None
    D = statistics.prior_sigma  # units apart by 10⁸ would drown the small eigenvalues in rounding
    root = covariance_root(uncertainty, D) / D[:, None]
    F = D[:, None] * statistics.F * D
    inner = np.eye(root.shape[1]) + root.T @ F @ root
    through = np.eye(len(D)) - F @ root @ np.linalg.solve(inner, root.T)
    through = through[statistics.indices(kept.parameters)]
    M = D[:, None] * np.einsum("q,qij->ij", variance, statistics.points) * D
    space = range_space(kept.F, kept.prior_sigma)
    inverse = (space.basis / (space.eigenvalues + 1.0)) @ space.basis.T
    half = inverse @ through
    found = half @ M @ half.T
    return np.asarray(kept.prior_sigma[:, None] * (found + found.T) / 2 * kept.prior_sigma)
