"""How large a named change is, averaged over everything that the posterior holds possible.

A size is known as well as the set is. Given the set S and the slab w the changes, in widths of the prior, are Gaussian,

    x_S | S, w, data ~ N(P b_S, P),   P = (I_SS + w⁻² 1)⁻¹,     weight P(S | data) P(w | S, data)

and the size of a parameter that changed is the mixture of these over all sets that hold it (Bayesian model averaging:
Hoeting, J. A., Madigan, D., Raftery, A. E. and Volinsky, C. T. (1999) Statistical Science 14, 382–417). Its spread
holds that within the sets and that between them. In the sets without it, of probability 1 − q, it did not change, and
an interval of level c holds c of all of that: c/q of the mixture, or no change and what is then missing, 1 − (1 − c)/q
of the mixture, whichever is shorter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.isolation.posterior import SetPosterior
from enginediag_cli.isolation.prior import Instruments, SetPrior
from enginediag_cli.isolation.sizes import ParameterChange
from enginediag_cli.residuals.score import Score

LEFT_OUT = 1e-3
"""Share of a parameter's inclusion that the sets left out hold together: a 95 % interval does not feel it."""
MOST_SETS = 400
"""Sets averaged over at most, likeliest first."""
WIDE = 10.0
"""Standard deviations of the widest part beyond which nothing of a mixture lies."""
HALVINGS = 36
"""Of the interval that holds a quantile: to ten digits."""


def averaged_sizes(
    score: Score,
    posterior: SetPosterior,
    names: Sequence[str],
    prior: SetPrior,
    confidence: float = 0.95,
    about: Mapping[bytes, Score] | None = None,
) -> tuple[ParameterChange, ...]:
    """Changes of `names`, given that they changed, with intervals of level `confidence` whether they did or not.

    score, prior: those of `posterior`; about: scores of single sets about their own estimates, by the bytes of their
    masks, where the full model was fitted.
    """
    if not names:
        return ()
    found = []
    unit = score.prior_sigma * prior.widths(score.described)
    inclusion = Instruments.from_parameters(score.described).inclusion(posterior.inclusion)
    for i in score.indices(names).tolist():
        sets = _sets_with(posterior, i)
        weight, mean, spread = _mixture(score, posterior, sets, i, prior, about or {})
        centre = float(weight @ mean)
        error = float(np.sqrt(weight @ (spread**2 + (mean - centre) ** 2)))
        upper = _between(weight, mean, spread, confidence)[1]
        ends = _held(weight, mean, spread, confidence, min(float(inclusion[i]), 1.0))
        d, (low, high) = float(unit[i]), prior.bounds([score.described[i]])
        centre, ends = float(np.clip(centre, low[0], high[0])), tuple(np.clip(ends, low[0], high[0]).tolist())
        upper = min(upper, float(high[0]))
        own = (centre * d, error * d, ends[0] * d, ends[1] * d)
        found.append(ParameterChange(score.parameters[i], float(score.theta0[i]), *own, (upper - centre) * d))
    return tuple(found)


def _held(
    weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float, inclusion: float
) -> tuple[float, float]:
    """Interval that holds `level` of the mixture, of probability `inclusion`, and of no change together."""
    share = max(1 - (1 - level) / inclusion, 0.0)
    low, high = _between(weight, mean, spread, share)
    wide = min(low, 0.0), max(high, 0.0)
    if inclusion <= level:
        return wide
    narrow = _between(weight, mean, spread, level / inclusion)
    return min(narrow, wide, key=lambda ends: ends[1] - ends[0])


def _between(weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float) -> tuple[float, float]:
    """Quantiles of the mixture that hold `level` of it between them, as much below as above."""
    tail = (1 - level) / 2
    return _quantile(weight, mean, spread, tail), _quantile(weight, mean, spread, 1 - tail)


def _sets_with(posterior: SetPosterior, i: int) -> np.ndarray:
    """Positions of the likeliest sets that hold parameter i and, together, nearly all of its inclusion."""
    holding = np.flatnonzero(posterior.masks[:, i])
    held = np.cumsum(posterior.probabilities[holding])
    count = int(np.searchsorted(held, (1 - LEFT_OUT) * held[-1])) + 1
    return holding[: min(count, MOST_SETS)]


def _mixture(
    score: Score,
    posterior: SetPosterior,
    sets: np.ndarray,
    i: int,
    prior: SetPrior,
    about: Mapping[bytes, Score],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, means and standard deviations (K,) of parameter i, in widths of `prior`, one for each set and slab."""
    slabs = np.asarray(prior.slabs, float)
    weights, means, spreads = [], [], []
    masks, sizes = posterior.masks[sets], posterior.masks[sets].sum(axis=1)
    own = np.array([mask.tobytes() in about for mask in masks], bool)
    groups = [(np.flatnonzero(~own & (sizes == size)), score) for size in np.unique(sizes[~own])]
    groups += [(np.array([k]), about[masks[k].tobytes()]) for k in np.flatnonzero(own)]
    for rows, local in groups:
        b, information = prior.scaled(local)
        size = int(sizes[rows[0]])
        members = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        at = np.argmax(members == i, axis=1)
        I = information[members[:, :, None], members[:, None, :]]
        P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))  # (slabs, sets, size, size)
        mean = np.einsum("wsij,sj->wsi", P, b[members])
        log = 0.5 * np.einsum("wsi,si->ws", mean, b[members]) + 0.5 * np.linalg.slogdet(P)[1]
        log -= size * np.log(slabs)[:, None]
        share = np.exp(log - np.logaddexp.reduce(log, axis=0))
        pick = np.arange(len(rows))
        weights.append((share * posterior.probabilities[sets[rows]]).ravel())
        means.append(mean[:, pick, at].ravel())
        spreads.append(np.sqrt(P[:, pick, at, at]).ravel())
    weight = np.concatenate(weights)
    return weight / weight.sum(), np.concatenate(means), np.concatenate(spreads)


def _quantile(weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float) -> float:
    """Where the distribution function of the mixture is `level`, by bisection."""
    from scipy.special import ndtr

    wide = WIDE * float(spread.max())
    low, high = float(mean.min()) - wide, float(mean.max()) + wide
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(weight @ ndtr((middle - mean) / spread)) < level else (low, middle)
    return 0.5 * (low + high)
