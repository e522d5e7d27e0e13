"""Large changes: sets compared by the likelihood of the full nonlinear model where the quadratic one fails.

The quadratic posterior reads one linearisation, at the re-estimate of all parameters together. After a change of
several per cent that point is far from the truth in the directions that the data hardly show, and curvature is
taken for a change of further parameters. Here every leading set is fitted with the full model, all sets in one
call of the engine, within what components and instruments can do, and expanded about its own estimate δ̂_S (Laplace):

    log p(data | S) = ℓ(δ̂_S) − β·δ̂_S + ½ δ̂_Sᵀ I δ̂_S + log ∫ exp(β·δ − ½ δᵀ I δ) p(δ) dδ,    β = I δ̂_S + ∇ℓ(δ̂_S)

with a slab prior p(δ). The sets that lead follow from the quadratic posterior about the estimate of the best
set so far, which is repeated until it names no better one: with a few sets as long as the best one is sought, and with
all that matter about the one that was found.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.isolation.posterior import SetPosterior, set_posterior
from enginediag_cli.isolation.prior import Instruments, SetPrior
from enginediag_cli.isolation.signs import reweighed
from enginediag_cli.isolation.wear import log_factors
from enginediag_cli.isolation.window_model import Expansion, WindowModel
from enginediag_cli.residuals.score import Score

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
class LargeFaults:
    """Posterior over sets with the leading ones fitted by the full model, and the score about the best one.

    about: of each set that was fitted, by the bytes of its mask, the score about its own estimate;
    prior: the one used, with a wide slab; fitted: how many sets; converged: every fit among the sets that matter
    settled; error: nats by which the quadratic misjudged the leading sets; offset: log likelihood of `score` at no
    change, that of the full model being 0.
    """

    posterior: SetPosterior
    score: Score
    about: Mapping[bytes, Score]
    prior: SetPrior
    fitted: int
    converged: bool
    error: float
    offset: float = 0.0


@dataclass(frozen=True)
class SetFit:
    """Estimate of the changes of one set: `change` (p,), and the expansion of the likelihood there."""

    change: np.ndarray
    expansion: Expansion
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
) -> LargeFaults:
    """Posterior over sets from the full model; `score` is where the search begins."""
    prior = prior or SetPrior()
    prior = replace(prior, slabs=(*prior.slabs, *((WIDE_SLAB,) if max(prior.slabs) < WIDE_SLAB else ())))
    fits: dict[bytes, SetFit] = {}
    logs: dict[bytes, float] = {}
    instruments = Instruments.from_parameters(score.described)
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
                logs[key] = laplace(score, fit, mask, prior) + float(prior.log_of(mask[None], instruments)[0])
        best = max(logs, key=lambda key: logs[key])
        if best != centre:
            centre = best
            about, offset = fits[best].expansion.score_about(score, fits[best].change)
            posterior = set_posterior(about, prior, largest=largest, faults=faults)
        elif most == LEADING:
            break
        else:
            most = LEADING
    log_weights = _combined(posterior, about, offset, prior, logs)
    weights, top = np.exp(log_weights - log_weights.max()), float(log_weights.max())
    combined = replace(reweighed(posterior, weights), log_total=top + float(np.log(weights.sum())))
    decisive = [k for k, log in logs.items() if log > logs[centre] + np.log(FITTED_SHARE)]
    own = {key: fit.expansion.score_about(score, fit.change)[0] for key, fit in fits.items() if np.isfinite(logs[key])}
    converged = all(fits[k].converged for k in decisive)
    return LargeFaults(combined, about, own, prior, len(fits), converged, error, offset)


def laplace(score: Score, fit: SetFit, mask: np.ndarray, prior: SetPrior) -> float:
    """log p(data | S) − log p(data | no change) by the expansion at the fit of the set `mask` (p,)."""
    local, offset = fit.expansion.score_about(score, fit.change)
    return offset + _log_slabs(local, mask, prior)


def _log_slabs(score: Score, mask: np.ndarray, prior: SetPrior) -> float:
    """log of the mean over slabs of ∫ exp(β·δ − ½ δᵀ I δ) p(δ; slab) dδ over the parameters of a set."""
    b, information = prior.scaled(score)
    s = np.flatnonzero(mask)
    each = []
    for slab in prior.slabs:
        A = np.eye(len(s)) + slab**2 * information[np.ix_(s, s)]
        right = slab * b[s]
        each.append(0.5 * float(right @ np.linalg.solve(A, right)) - 0.5 * float(np.linalg.slogdet(A)[1]))
    wear = float(log_factors(score, mask[None], prior)[0])
    return float(np.logaddexp.reduce(each) - np.log(len(each)) + wear)


def _combined(
    posterior: SetPosterior, about: Score, offset: float, prior: SetPrior, logs: dict[bytes, float]
) -> np.ndarray:
    """Log weights (M,) of all sets of `posterior`, that of the score `about`, against no change: those fitted by their
    fits, the others by that score."""
    anchor = posterior.masks[0]
    log_prior = float(prior.log_of(anchor[None], Instruments.from_parameters(about.described))[0])
    level = offset + _log_slabs(about, anchor, prior) + log_prior
    with np.errstate(divide="ignore"):
        known = level + np.log(posterior.probabilities) - np.log(posterior.probabilities[0])
    return np.array([logs.get(mask.tobytes(), log) for mask, log in zip(posterior.masks, known, strict=True)])
