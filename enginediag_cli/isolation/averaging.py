"""What the posterior over sets says of sizes: of one change, of all together, of those that are too small to matter.

A size is known as well as the set is. Given the set S and the slab w the changes, in widths of the prior, are Gaussian,

    x_S | S, w, data ~ N(P b_S, P),   P = (I_SS + w⁻² 1)⁻¹,     weight P(S | data) P(w | S, data)

and the size of a parameter that changed is the mixture of these over all sets that hold it (Bayesian model averaging:
Hoeting, J. A., Madigan, D., Raftery, A. E. and Volinsky, C. T. (1999) Statistical Science 14, 382–417). Its spread
holds that within the sets and that between them. In the sets without it, of probability 1 − q, it did not change, and
an interval of level c holds c of all of that: c/q of the mixture, or no change and what is then missing, 1 − (1 − c)/q
of the mixture, whichever is shorter.

An answer S says that these changed and that nothing else that matters did. It is right, too, where a set T ⊃ S is what
happened and all that T holds besides is below its `least_that_matters` ε. Sets are gone through by falling
probability; each takes from the sets T after it that hold it the part

    P(T | data) Π_{i ∈ T∖S} P(|x_i| < ε_i | T, widest slab, data)

that has not been taken by one before, so that all probabilities add to 1 as before. Under the widest slab it is the
data that say that a change is small: one that they do not show remains as large as it may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.detection.minimum_change import must_show
from enginediag_cli.isolation.posterior import SetPosterior
from enginediag_cli.isolation.prior import Instruments, SetPrior, are_sensors
from enginediag_cli.isolation.sizes import ParameterChange
from enginediag_cli.isolation.wear import log_mass, wear_signs
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score

LEFT_OUT = 1e-3
"""Share of a parameter's inclusion that the sets left out hold together: a 95 % interval does not feel it."""
MOST_SETS = 400
"""Sets averaged over at most, likeliest first."""
WIDE = 10.0
"""Standard deviations of the widest part beyond which nothing of a mixture lies."""
TINY = 1e-300
"""In place of a probability of zero, which has no logarithm."""
HALVINGS = 36
"""Of the interval that holds a quantile: to ten digits."""
MATTERS = 1 / 3
"""Share of what a shop acts on (`must_show`) from which a further change matters: 0.7 % of an efficiency, 1 % of a flow
capacity. With two such changes beside the named one nothing is to be done that was not to be done for it alone."""


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
        d, own_prior = float(unit[i]), [score.described[i]]
        low, high = (float((end / prior.widths(own_prior))[0]) for end in prior.bounds(own_prior))
        centre, ends = float(np.clip(centre, low, high)), tuple(np.clip(ends, low, high).tolist())
        upper = min(upper, high)
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


@dataclass(frozen=True)
class _Sets:
    """Sets of one size d: their `rows` (S,), `members` (S, d) and, for each slab and set, its share of the set (W, S),
    mean (W, S, d) and covariance (W, S, d, d) of the changes in widths of the prior."""

    rows: np.ndarray
    members: np.ndarray
    share: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray


def _gaussians(score: Score, masks: np.ndarray, prior: SetPrior, about: Mapping[bytes, Score]) -> Iterator[_Sets]:
    """The changes of every set of `masks` (S, p) that is not empty, those of a size together."""
    slabs, sizes = np.asarray(prior.slabs, float), masks.sum(axis=1)
    own = np.array([mask.tobytes() in about for mask in masks], bool)
    groups = [(np.flatnonzero(~own & (sizes == size)), score) for size in np.unique(sizes[~own]) if size]
    groups += [(np.array([k]), about[masks[k].tobytes()]) for k in np.flatnonzero(own) if sizes[k]]
    for rows, local in groups:
        b, information = prior.scaled(local)
        size = int(sizes[rows[0]])
        members = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        I = information[members[:, :, None], members[:, None, :]]
        P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))
        mean = np.einsum("wsij,sj->wsi", P, b[members])
        log = 0.5 * np.einsum("wsi,si->ws", mean, b[members]) + 0.5 * np.linalg.slogdet(P)[1]
        log -= size * np.log(slabs)[:, None]
        yield _Sets(rows, members, np.exp(log - np.logaddexp.reduce(log, axis=0)), mean, P)


def _mixture(
    score: Score,
    posterior: SetPosterior,
    sets: np.ndarray,
    i: int,
    prior: SetPrior,
    about: Mapping[bytes, Score],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, means and standard deviations (K,) of parameter i, in widths of `prior`, one for each set and slab."""
    weights, means, spreads = [], [], []
    for found in _gaussians(score, posterior.masks[sets], prior, about):
        at, pick = np.argmax(found.members == i, axis=1), np.arange(len(found.rows))
        weights.append((found.share * posterior.probabilities[sets[found.rows]]).ravel())
        means.append(found.mean[:, pick, at].ravel())
        spreads.append(np.sqrt(found.covariance[:, pick, at, at]).ravel())
    weight = np.concatenate(weights)
    return weight / weight.sum(), np.concatenate(means), np.concatenate(spreads)


def moments(
    score: Score, posterior: SetPosterior, prior: SetPrior, about: Mapping[bytes, Score] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of the changes of the score's parameters, in their units, whatever changed."""
    masks, weights = _likeliest(posterior)
    weights, p = weights / weights.sum(), len(score.parameters)
    first, second = np.zeros(p), np.zeros((p, p))
    for found in _gaussians(score, masks, prior, about or {}):
        share = found.share * weights[found.rows]
        np.add.at(first, found.members, np.einsum("ws,wsi->si", share, found.mean))
        square = found.covariance + found.mean[..., :, None] * found.mean[..., None, :]
        at = (found.members[:, :, None], found.members[:, None, :])
        np.add.at(second, at, np.einsum("ws,wsij->sij", share, square))
    D = score.prior_sigma * prior.widths(score.described)
    return D * first, D[:, None] * (second - np.outer(first, first)) * D


def _likeliest(posterior: SetPosterior) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest sets (S, p), which hold nearly all, with their probabilities (S,)."""
    count = int(np.searchsorted(np.cumsum(posterior.probabilities), 1 - LEFT_OUT)) + 1
    return posterior.masks[: min(count, MOST_SETS)], posterior.probabilities[: min(count, MOST_SETS)]


def least_that_matters(described: Sequence[Parameter], prior_sigma: np.ndarray) -> np.ndarray:
    """Change (p,) below which a further parameter does not matter, in its unit; 0 of instruments."""
    return np.where(are_sensors(described), 0.0, MATTERS * must_show(described, prior_sigma))


def absorb_small_changes(
    score: Score, posterior: SetPosterior, prior: SetPrior, about: Mapping[bytes, Score] | None = None
) -> SetPosterior:
    """The posterior over answers: of each set the probability that these changed and nothing else that matters.

    The set that was likeliest stays the first; the others follow by falling probability.
    """
    masks, left = _likeliest(posterior)
    small = log_too_small(score, masks, prior, about or {})
    left, taken = left.copy(), left.copy()
    for r in range(len(masks) - 1):
        donors = r + 1 + np.flatnonzero(~(masks[r] & ~masks[r + 1 :]).any(axis=1))
        if not len(donors):
            continue
        moved = left[donors] * np.exp(np.sum(small[donors] * ~masks[r], axis=1))
        left[donors] -= moved
        taken[donors] -= moved
        taken[r] += float(moved.sum())
    probabilities = posterior.probabilities.copy()
    probabilities[: len(masks)] = np.maximum(taken, 0.0)
    order = np.concatenate([[0], 1 + np.argsort(-probabilities[1:], kind="stable")])
    return replace(posterior, masks=posterior.masks[order], probabilities=probabilities[order])


def log_too_small(score: Score, masks: np.ndarray, prior: SetPrior, about: Mapping[bytes, Score]) -> np.ndarray:
    """log P(|change| < `least_that_matters`) (S, p) of each member of sets (S, p) under the widest slab, 0 else."""
    signs, widths = wear_signs(score, prior), prior.widths(score.described)
    low, high = (end / widths for end in prior.bounds(score.described))
    least = least_that_matters(score.described, score.prior_sigma) / (score.prior_sigma * widths)
    up = np.where(signs > 0, 1 - prior.rises, np.where(signs < 0, prior.rises, 0.5))
    found = np.zeros(masks.shape)
    for sets in _gaussians(score, masks, replace(prior, slabs=(max(prior.slabs),)), about):
        mean, spread = sets.mean[0], np.sqrt(np.einsum("sii->si", sets.covariance[0]))
        z = [(x[sets.members] - mean) / spread for x in (low, -least, np.zeros(len(low)), least, high)]
        mass, rise = [np.exp(log_mass(z[k], z[k + 1])) for k in range(4)], up[sets.members]
        small = (1 - rise) * mass[1] + rise * mass[2]
        whole = small + (1 - rise) * mass[0] + rise * mass[3]
        found[sets.rows[:, None], sets.members] = np.log(np.maximum(small / np.maximum(whole, TINY), TINY))
    return found


def _quantile(weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float) -> float:
    """Where the distribution function of the mixture is `level`, by bisection."""
    from scipy.special import ndtr

    wide = WIDE * float(spread.max())
    low, high = float(mean.min()) - wide, float(mean.max()) + wide
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if float(weight @ ndtr((middle - mean) / spread)) < level else (low, middle)
    return 0.5 * (low + high)
