"""Large changes: sets compared by the likelihood of the full nonlinear model where the quadratic one fails.

The quadratic posterior reads one linearisation, at the re-estimate of all parameters together. After a change of
several per cent that point is far from the truth in the directions that the data hardly show, and curvature is
taken for a change of further parameters. Here every leading set is fitted with the full model, all sets in one
call of the engine, within what components and instruments can do, and expanded about its own estimate δ̂_S (Laplace):

    log p(data | S) = ℓ(δ̂_S) − β·δ̂_S + ½ δ̂_Sᵀ I δ̂_S + log ∫ exp(β·δ − ½ δᵀ I δ) p(δ) dδ,    β = I δ̂_S + ∇ℓ(δ̂_S)

with a slab prior p(δ). The sets that lead follow from the quadratic posterior about the estimate of the best
set so far, which is repeated until it names no better one: with a few sets as long as the best one is sought, and with
all that matter about the one that was found.

Likelihood of the records of one window with the full model, and its expansion. Readings are weighed by their long-run
noise as everywhere, and what is uncertain about nominal and the sensors, x ~ N(0, C), acts linearly with the
sensitivities J₀ at nominal, where identification left it. With z the whitened residuals at the change δ, G and G₀ the
whitened sensitivities of the monitored and of all parameters, C = R Rᵀ,

    ℓ(δ) = −½ [zᵀz − sᵀ K⁻¹ s],   s = Rᵀ G₀ᵀ z,   K = 1 + Rᵀ G₀ᵀ G₀ R

What a change does to record k is J₀ₖ δ, exactly known, and a remainder of second order that changes slowly over
operating points: it is computed at R records c and interpolated between them,

    Φ(u_k, θ₀ + δ) = Φ(u_k, θ₀) + J₀ₖ δ + Σ_c A_kc r_c(δ),     r_c(δ) = Φ(u_c, θ₀ + δ) − Φ(u_c, θ₀) − J₀_c δ

and so is J. With W_k the whitening of record k (z_k = W_k e_k), the likelihood needs of all records no more than the
sums over k of A_kc A_ke W_kᵀW_k, A_kc W_kᵀz_k and A_kc W_kᵀG_k: its cost does not depend on their number.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.isolation.posterior import SetPosterior, reweight, set_posterior
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior
from enginediag_cli.isolation.subsets import log_bound_factors
from enginediag_cli.probability import log_mean
from enginediag_cli.residuals.instruments import apply_weights
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score
from enginediag_cli.residuals.statistics import covariance_root, whiten

MAX_POINTS = 20_000
"""Records times sets computed in one call of the engine."""
TOGETHER = 1_500
"""Records that are compared with nominal together: sensitivities to two hundred parameters of each take 100 MB."""
COMPUTED = 40
"""Records at which changes are computed."""


@dataclass(frozen=True)
class LikelihoodExpansion:
    """ℓ relative to no change, its gradient (p,) and information (p, p) at one change of monitored parameters."""

    log_likelihood: float
    gradient: np.ndarray
    information: np.ndarray

    def expand_score(self, template: Score, change: np.ndarray) -> tuple[Score, float]:
        """The expansion at `change` (p,) carried back to nominal: a score, and ℓ of it at nominal.

        ℓ(δ) ≈ offset + β·δ − ½ δᵀ I δ.
        """
        b = self.gradient + self.information @ change
        offset = self.log_likelihood - float(b @ change) + 0.5 * float(change @ self.information @ change)
        d = template.prior_sigma
        scaled, rhs = d[:, None] * self.information * d, d * b
        eigenvalues, vectors = np.linalg.eigh(scaled)
        kept = eigenvalues > 1e-9 * max(float(eigenvalues[-1]), 1e-300)
        glr = float(np.sum((rhs @ vectors[:, kept]) ** 2 / eigenvalues[kept]))
        rank = int(np.count_nonzero(kept))
        local = Score(template.parameters, template.theta0, d, b, self.information, glr, rank, meaning=template.meaning)
        return local, offset


class WindowModel:
    """Likelihood of one window's records; inputs: column -> (N,), y (N, m) with NaN where missing; start: unknowns
    (nx, N) of the engine at nominal, where they are known; weights (N, m, m): what multiplies readings and predictions
    where an instrument scatters.

    Records that the engine cannot compute at nominal are excluded; a change at which it cannot compute one of those
    that stand for the others has log likelihood −inf.
    """

    def __init__(
        self,
        monitor: Monitor,
        inputs: Mapping[str, np.ndarray],
        y: np.ndarray,
        start: np.ndarray | None = None,
        weights: np.ndarray | None = None,
    ):
        self.monitor = monitor
        self.p = p = len(monitor.monitored)
        root, one = covariance_root(monitor.uncertainty, monitor.prior_sigma), np.eye(y.shape[1])
        parts = []
        for first in range(0, max(len(y), 1), TOGETHER):
            rows = slice(first, first + TOGETHER)
            here = {column: np.asarray(values)[rows] for column, values in inputs.items()}
            near = None if start is None else start[:, rows]
            predicted, J, ok, found = monitor.predict(here, monitor.theta0, start=near)
            # errors of the maps stay where nominal has the machines, whatever fault is tried
            known = {**here, **getattr(found, "frozen", {})}
            x = getattr(found, "x", None)  # unknowns of the engine, from which the solutions of changes are near
            predicted, J = predicted[ok], J[ok]
            weight = None if weights is None else weights[rows][ok]
            e = y[rows][ok] - predicted
            columns = np.concatenate([J, np.tile(one, (len(J), 1, 1))], 2) * np.isfinite(e)[:, :, None]
            z, G = whiten(apply_weights(weight, e), apply_weights(weight, columns), monitor.noise)
            parts.append(
                (
                    {column: np.asarray(values)[ok] for column, values in known.items()},
                    None if x is None else np.asarray(x)[:, ok],
                    predicted,
                    J[:, :, :p],
                    z,
                    G[:, :, :p],
                    G[:, :, : J.shape[2]] @ root,
                    G[:, :, J.shape[2] :],
                )
            )
        of_inputs, starts, *arrays = zip(*parts, strict=True)
        self.inputs = {column: np.concatenate([part[column] for part in of_inputs]) for column in of_inputs[0]}
        predicted, J, z, G, doubt, W = (np.concatenate(each) for each in arrays)
        self.records = len(z)
        chosen, shares = spread_records({c: v for c, v in self.inputs.items() if c in monitor.engine.inputs}, len(z))
        self._points = {column: values[chosen] for column, values in self.inputs.items()}
        self._start = None if starts[0] is None else np.concatenate(starts, axis=1)[:, chosen]
        self._sums = _RecordSums.from_records(predicted[chosen], J[chosen], z, G, doubt, W, shares)
        self._inner = np.eye(root.shape[1]) + np.einsum("kmd,kme->de", doubt, doubt, optimize=True)
        self._noise = 1.0
        self._at_nominal = 0.0
        nothing = np.zeros((1, p))
        self._at_nominal = float(self._log_likelihood(*self._sums.residuals(nothing, predicted[chosen][None]))[0])

    def scale_noise(self, factor: float) -> WindowModel:
        """The same where the variance of the noise is larger by this factor."""
        found = copy(self)
        found._noise = self._noise * factor
        return found

    @property
    def prior_sigma(self) -> np.ndarray:
        return self.monitor.prior_sigma[: self.p]

    def log_likelihood(self, changes: np.ndarray) -> np.ndarray:
        """ℓ(δ) − ℓ(0) (w,) of changes (w, p); −inf where the engine cannot compute a record."""
        found = []
        values = replace(self.monitor, monitored=())  # whose predictions come without sensitivities
        for part, predicted, _, ok in self._predictions(values, changes):
            computed = ok.all(axis=1) & np.isfinite(predicted[:, :, self._sums.read]).all(axis=(1, 2))
            ell = self._log_likelihood(*self._sums.residuals(part, np.nan_to_num(predicted)))
            found.append(np.where(computed, ell, -np.inf))
        return np.concatenate(found) if found else np.zeros(0)

    def _log_likelihood(self, square: np.ndarray, s: np.ndarray) -> np.ndarray:
        """ℓ − ℓ(0) (w,) by zᵀz (w,) and s (w, d)."""
        known = np.sum(s * np.linalg.solve(self._inner, s.T).T, axis=1)
        return np.asarray(-0.5 * (square - known) - self._at_nominal) / self._noise

    def expand(self, changes: np.ndarray) -> list[LikelihoodExpansion]:
        """Expansion about each of w changes (w, p)."""
        found: list[LikelihoodExpansion] = []
        for part, predicted, J, ok in self._predictions(self.monitor, changes):
            for k in range(len(part)):
                computed = np.isfinite(predicted[k]) & np.all(np.isfinite(J[k]), axis=2)
                if not np.all(ok[k]) or not computed[:, self._sums.read].all():  # fewer readings would fit better
                    nothing = np.full((self.p, self.p), np.nan)
                    found.append(LikelihoodExpansion(-np.inf, nothing[0], nothing))
                    continue
                here = np.where(computed, predicted[k], 0.0), np.where(computed[:, :, None], J[k], 0.0)
                found.append(self._expansion(part[k], *here))
        return found

    def _predictions(
        self, monitor: Monitor, changes: np.ndarray
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Changes (w, p), as many at a time as one call of the engine takes; predictions (w, R, m) at the R points that
        are computed, sensitivities (w, R, m, q) to the q that `monitor` watches, and whether they could be computed
        (w, R)."""
        R = len(self._sums.predicted)
        at_once = max(1, MAX_POINTS // max(R, 1))
        for first in range(0, len(changes), at_once):
            part = changes[first : first + at_once]
            theta = np.tile(self.monitor.theta0, (len(part), 1))
            theta[:, : self.p] += part
            inputs = {c: np.tile(values, len(part)) for c, values in self._points.items()}
            start = None if self._start is None else np.tile(self._start, len(part))
            predicted, J, ok, _ = monitor.predict(inputs, np.repeat(theta, R, axis=0), nuisance=False, start=start)
            q = len(monitor.monitored)
            shape = (len(part), R, predicted.shape[1])
            yield part, predicted.reshape(shape), J[:, :, :q].reshape(*shape, q), ok.reshape(len(part), R)

    def _expansion(self, change: np.ndarray, predicted: np.ndarray, J: np.ndarray) -> LikelihoodExpansion:
        square, s = (each[0] for each in self._sums.residuals(change[None], predicted[None]))
        gradient, information, cross = self._sums.slopes(change, predicted, J)
        solved = np.linalg.solve(self._inner, np.column_stack([s, cross]))
        log_likelihood = -0.5 * float(square - s @ solved[:, 0]) - self._at_nominal
        gradient = gradient - cross.T @ solved[:, 0]
        information = information - cross.T @ solved[:, 1:]
        return LikelihoodExpansion(log_likelihood / self._noise, gradient / self._noise, information / self._noise)


@dataclass(frozen=True)
class _RecordSums:
    """What the likelihood needs of all records. At the R points that are computed: `predicted` (R, m) and `J` (R, m, p)
    at nominal, and the sums of their shares times WᵀW (R, m, R, m), Wᵀz (R, m), WᵀG (R, m, p) and WᵀG₀R (R, m, d);
    read (m,): sensors with readings. Of all records: zᵀz, Gᵀz (p,), GᵀG (p, p), RᵀG₀ᵀz (d,) and RᵀG₀ᵀG (d, p)."""

    predicted: np.ndarray
    J: np.ndarray
    read: np.ndarray
    WW: np.ndarray
    Wz: np.ndarray
    WG: np.ndarray
    WD: np.ndarray
    zz: float
    Gz: np.ndarray
    GG: np.ndarray
    Dz: np.ndarray
    DG: np.ndarray

    @staticmethod
    def from_records(
        predicted: np.ndarray,
        J: np.ndarray,
        z: np.ndarray,
        G: np.ndarray,
        doubt: np.ndarray,
        W: np.ndarray,
        shares: np.ndarray,
    ) -> _RecordSums:
        """Of records with whitened residuals z (N, m), sensitivities G (N, m, p), doubt G₀R (N, m, d), whitening W
        (N, m, m) and `shares` A (N, R) of the points."""
        (N, R), (m, p) = shares.shape, G.shape[1:]
        own = np.einsum("kij,kil->kjl", W, W)
        WW = np.zeros((R, m, R, m))
        for i, j in np.argwhere(np.any(own != 0.0, axis=0)).tolist():  # of independent sensors the diagonal
            WW[:, i, :, j] = shares.T @ (own[:, i, j, None] * shares)
        columns = np.einsum("kij,kiq->kjq", W, np.concatenate([z[:, :, None], G, doubt], axis=2), optimize=True)
        near = (shares.T @ columns.reshape(N, -1)).reshape(R, *columns.shape[1:])
        residual, slopes, doubts = z.ravel(), G.reshape(-1, p), doubt.reshape(N * m, -1)
        return _RecordSums(
            predicted,
            J,
            np.einsum("kmm->m", own) > 0.0,
            WW,
            near[:, :, 0],
            near[:, :, 1 : 1 + p],
            near[:, :, 1 + p :],
            float(residual @ residual),
            slopes.T @ residual,
            slopes.T @ slopes,
            doubts.T @ residual,
            doubts.T @ slopes,
        )

    def remainders(self, change: np.ndarray, predicted: np.ndarray) -> np.ndarray:
        """r (w, R, m) of changes (w, p) with these predictions; 0 where there are no readings."""
        r = predicted - self.predicted - np.einsum("kmp,wp->wkm", self.J, change)
        return np.where(self.read, r, 0.0)

    def residuals(self, changes: np.ndarray, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """zᵀz (w,) and s (w, d) at changes (w, p) with predictions (w, R, m): z = z₀ − G δ − W A r."""
        r = self.remainders(changes, predicted)
        square = self.zz - 2 * changes @ self.Gz + np.einsum("wp,pq,wq->w", changes, self.GG, changes)
        square -= 2 * (np.einsum("wkm,km->w", r, self.Wz) - np.einsum("wkm,kmp,wp->w", r, self.WG, changes))
        square += np.einsum("wkm,wkm->w", r, np.tensordot(r, self.WW, 2))
        return square, self.Dz - changes @ self.DG.T - np.einsum("wkm,kmd->wd", r, self.WD)

    def slopes(
        self, change: np.ndarray, predicted: np.ndarray, J: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gᵀz (p,), GᵀG (p, p) and RᵀG₀ᵀG (d, p) at one change (p,), with prediction (R, m) and sensitivities
        (R, m, p) there."""
        (r,) = self.remainders(change[None], predicted[None])
        K = np.where(self.read[:, None], J - self.J, 0.0)
        half = np.tensordot(self.WG, K, ((0, 1), (0, 1)))
        WWK = np.tensordot(self.WW, K, 2)
        gradient = self.Gz - self.GG @ change - np.tensordot(r, self.WG, 2)
        gradient += np.tensordot(self.Wz - self.WG @ change, K, 2) - np.tensordot(r, WWK, 2)
        information = self.GG + half + half.T + np.tensordot(K, WWK, ((0, 1), (0, 1)))
        return gradient, information, self.DG + np.tensordot(self.WD, K, ((0, 1), (0, 1)))


def spread_records(inputs: Mapping[str, np.ndarray], size: int) -> tuple[np.ndarray, np.ndarray]:
    """COMPUTED of `size` records, all where they are no more, that cover their operating points (farthest-point
    sampling, T. F. Gonzalez, Theoret. Comput. Sci. 38 (1985) 293–306), and the shares (size, R) by which what is known
    there is interpolated to all records.

    The interpolant is the smoothest that takes the values, ∫|∇²f|² least in one dimension: cubic radial functions and
    a linear part (J. Duchon, Lecture Notes in Math. 571 (1977) 85–100).
    """
    if size <= COMPUTED:
        return np.arange(size), np.eye(size)
    u = np.column_stack([np.broadcast_to(np.asarray(v, float), size) for v in inputs.values()])
    spread = u.std(axis=0)
    v = (u - u.mean(axis=0))[:, spread > 0] / spread[spread > 0]
    chosen = [int(np.argmin(np.sum(v**2, axis=1)))]
    distance = np.sum((v - v[chosen[0]]) ** 2, axis=1)
    while len(chosen) < COMPUTED and distance.max() > 0.0:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.sum((v - v[chosen[-1]]) ** 2, axis=1))
    centres = v[chosen]
    apart = np.sqrt(np.maximum(np.sum(v**2, 1)[:, None] - 2 * v @ centres.T + np.sum(centres**2, 1), 0.0)) ** 3
    linear = np.column_stack([np.ones(size), v])
    R, q = len(chosen), linear.shape[1]
    of_points = np.zeros((R + q, R + q))
    of_points[:R, :R], of_points[:R, R:], of_points[R:, :R] = apart[chosen], linear[chosen], linear[chosen].T
    # where points lie in a plane the linear part is not unique, its values at the records are
    return np.array(chosen), (np.column_stack([apart, linear]) @ np.linalg.pinv(of_points, rcond=1e-10))[:, :R]


SOUGHT, LEADING = 5, 20
"""Sets that are fitted by the full model in a round, while the best is sought and about the best: the cost."""
CHECKED = 5
"""Leading sets at which the quadratic is compared with the full model."""
ROUNDS = 6
"""Rounds of fits and new leading sets at most. Judgement."""
FITTED_SHARE = 1e-3
"""Sets of a smaller share of the quadratic posterior are not worth a fit."""
NATS = 0.5
"""Error of a log likelihood ratio between leading sets above which the quadratic has failed."""
WIDE_SLAB = 5.0
"""Changes of several per cent must be plausible: 10 % where prior_sigma is 2 %."""
MAX_ITERATIONS = 25
"""Of the fit of one set; what has not settled by then has not converged."""
TOLERANCE = 0.02
"""Length of the last step in standard errors: it changes a log likelihood by 2·10⁻⁴."""


@dataclass(frozen=True)
class NonlinearPosterior:
    """Posterior over sets with the leading ones fitted by the full model, and the score about the best one.

    own_scores: of each set that was fitted, by the bytes of its mask, the score about its own estimate;
    prior: the one used, with a wide slab; fitted: how many sets; converged: every fit among the sets that matter
    settled; error: nats by which the quadratic misjudged the leading sets; offset: log likelihood of `score` at no
    change, that of the full model being 0.
    """

    posterior: SetPosterior
    score: Score
    own_scores: Mapping[bytes, Score]
    prior: SetPrior
    fitted: int
    converged: bool
    error: float
    offset: float = 0.0


@dataclass(frozen=True)
class SetFit:
    """Estimate of the changes of one set: `change` (p,), and the expansion of the likelihood there."""

    change: np.ndarray
    expansion: LikelihoodExpansion
    converged: bool


def restricted_changes(score: Score, masks: np.ndarray) -> np.ndarray:
    """Changes (w, p), in parameter units, by which each set (w, p) bool explains the score best."""
    b, information = score.scaled()
    diagonal = np.where(masks, 1e-9 * np.max(np.diag(information), initial=1.0), 1.0)
    A = np.where(masks[:, :, None] & masks[:, None, :], information, 0.0)
    A = A + diagonal[:, :, None] * np.eye(len(b))
    return np.asarray(np.linalg.solve(A, np.where(masks, b, 0.0)[:, :, None])[:, :, 0] * score.prior_sigma)


def quadratic_error(model: WindowModel, score: Score, masks: np.ndarray) -> float:
    """Largest error of the quadratic's log likelihood ratios between sets (w, p), in nats.

    Every set is judged at its own quadratic estimate, by the score and by the full model.
    """
    changes = restricted_changes(score, masks)
    promised = changes @ score.b - 0.5 * np.einsum("wi,ij,wj->w", changes, score.information, changes)
    error = model.log_likelihood(changes) - promised
    return float(np.ptp(error)) if np.all(np.isfinite(error)) else np.inf


def fit_sets(
    model: WindowModel, masks: np.ndarray, start: np.ndarray, bounds: tuple[np.ndarray, np.ndarray]
) -> list[SetFit]:
    """Estimate of the changes of each set (w, p) by damped Gauss–Newton steps from `start` (w, p), within the lowest
    and highest changes `bounds` (p,).

    The likelihood is held by the widest slab, N(0, WIDE_SLAB² prior_sigma²), so that what the data do not show
    stays where it is. A parameter at a bound that the data pull beyond it stays there, and the others settle without
    it. All sets are computed in one call of the engine per step. A set whose start the model cannot compute begins
    with no change.
    """
    w = len(masks)
    sigma, hold, (low, high) = model.prior_sigma, WIDE_SLAB**-2, bounds
    delta = np.where(masks, np.clip(start, low, high), 0.0)
    now = model.expand(delta)
    lost = [k for k in range(w) if not np.isfinite(now[k].log_likelihood)]
    if lost:
        delta[lost] = 0.0
        for k, expansion in zip(lost, model.expand(delta[lost]), strict=True):
            now[k] = expansion
    damping = np.zeros(w)
    settled: np.ndarray = np.asarray(~masks.any(axis=1))
    active: np.ndarray = ~settled
    for _ in range(MAX_ITERATIONS):
        chosen = np.flatnonzero(active).tolist()
        if not chosen:
            break
        trial, length = delta.copy(), np.zeros(w)
        for k in chosen:
            pull = now[k].gradient - hold * delta[k] / sigma**2
            s = masks[k] & ~((delta[k] >= high) & (pull > 0)) & ~((delta[k] <= low) & (pull < 0))
            H = now[k].information[np.ix_(s, s)] * sigma[s, None] * sigma[s] + hold * np.eye(int(s.sum()))
            step = np.linalg.solve(H + damping[k] * np.diag(np.diag(H)), pull[s] * sigma[s])
            trial[k, s] = np.clip(delta[k, s] + step * sigma[s], low[s], high[s])
            step = (trial[k, s] - delta[k, s]) / sigma[s]
            length[k] = np.sqrt(step @ H @ step) * (1 + damping[k])
        for k, expansion in zip(chosen, model.expand(trial[chosen]), strict=True):
            gained = expansion.log_likelihood - now[k].log_likelihood
            gained -= 0.5 * hold * float(np.sum((trial[k] / sigma) ** 2 - (delta[k] / sigma) ** 2))
            if gained >= -1e-9:
                delta[k], now[k] = trial[k], expansion
                damping[k] *= 0.2
            elif length[k] > TOLERANCE:
                damping[k] = max(4 * damping[k], 0.5)
        settled[chosen] = length[chosen] <= TOLERANCE
        active = ~settled & (damping < 1e4)
    return [SetFit(delta[k], now[k], bool(settled[k])) for k in range(w)]


def nonlinear_posterior(
    model: WindowModel,
    score: Score,
    prior: SetPrior | None = None,
    *,
    largest: int | None = None,
    faults: int | None = None,
) -> NonlinearPosterior:
    """Posterior over sets from the full model; `score` is where the search begins."""
    prior = prior or SetPrior()
    prior = replace(prior, slabs=(*prior.slabs, *((WIDE_SLAB,) if max(prior.slabs) < WIDE_SLAB else ())))
    fits: dict[bytes, SetFit] = {}
    logs: dict[bytes, float] = {}
    instruments = InstrumentForms.from_parameters(score.described)
    low, high = (end * score.prior_sigma for end in prior.bounds(score.described))
    about, offset, centre, most = score, 0.0, b"", SOUGHT
    posterior = set_posterior(about, prior, largest=largest, faults=faults)
    error = quadratic_error(model, score, posterior.masks[: min(CHECKED, len(posterior.masks))])
    for _ in range(ROUNDS):
        enough = posterior.probabilities > FITTED_SHARE * posterior.probabilities[0]
        leading = posterior.masks[: min(most, int(enough.sum()))]
        new = np.array([mask for mask in leading if mask.tobytes() not in fits], bool).reshape(-1, leading.shape[1])
        if len(new):
            start = restricted_changes(about, new)
            for mask, fit in zip(new, fit_sets(model, new, start, (low, high)), strict=True):
                key = mask.tobytes()
                fits[key] = fit
                logs[key] = log_laplace_evidence(score, fit, mask, prior) + float(
                    prior.log_probability(mask[None], instruments)[0]
                )
        best = max(logs, key=lambda key: logs[key])
        if best != centre:
            centre = best
            about, offset = fits[best].expansion.expand_score(score, fits[best].change)
            posterior = set_posterior(about, prior, largest=largest, faults=faults)
        elif most == LEADING:
            break
        else:
            most = LEADING
    log_weights = _combine_log_weights(posterior, about, offset, prior, logs)
    weights, top = np.exp(log_weights - log_weights.max()), float(log_weights.max())
    combined = replace(reweight(posterior, weights), log_total=top + float(np.log(weights.sum())))
    decisive = [k for k, log in logs.items() if log > logs[centre] + np.log(FITTED_SHARE)]
    own = {key: fit.expansion.expand_score(score, fit.change)[0] for key, fit in fits.items() if np.isfinite(logs[key])}
    converged = all(fits[k].converged for k in decisive)
    return NonlinearPosterior(combined, about, own, prior, len(fits), converged, error, offset)


def log_laplace_evidence(score: Score, fit: SetFit, mask: np.ndarray, prior: SetPrior) -> float:
    """log p(data | S) − log p(data | no change) by the expansion at the fit of the set `mask` (p,)."""
    local, offset = fit.expansion.expand_score(score, fit.change)
    return offset + _log_slab_evidence(local, mask, prior)


def _log_slab_evidence(score: Score, mask: np.ndarray, prior: SetPrior) -> float:
    """log of the mean over slabs of ∫ exp(β·δ − ½ δᵀ I δ) p(δ; slab) dδ over the parameters of a set."""
    b, information = prior.scaled(score)
    s = np.flatnonzero(mask)
    each = []
    for slab in prior.slabs:
        A = np.eye(len(s)) + slab**2 * information[np.ix_(s, s)]
        right = slab * b[s]
        each.append(0.5 * float(right @ np.linalg.solve(A, right)) - 0.5 * float(np.linalg.slogdet(A)[1]))
    wear = float(log_bound_factors(score, mask[None], prior)[0])
    return float(log_mean(np.array(each)) + wear)


def _combine_log_weights(
    posterior: SetPosterior, about: Score, offset: float, prior: SetPrior, logs: dict[bytes, float]
) -> np.ndarray:
    """Log weights (M,) of all sets of `posterior`, that of the score `about`, against no change: those fitted by their
    fits, the others by that score."""
    anchor = posterior.masks[0]
    log_prior = float(prior.log_probability(anchor[None], InstrumentForms.from_parameters(about.described))[0])
    level = offset + _log_slab_evidence(about, anchor, prior) + log_prior
    with np.errstate(divide="ignore"):
        known = level + np.log(posterior.probabilities) - np.log(posterior.probabilities[0])
    return np.array([logs.get(mask.tobytes(), log) for mask, log in zip(posterior.masks, known, strict=True)])
