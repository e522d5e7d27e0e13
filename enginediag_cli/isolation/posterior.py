"""Posterior probability of every set of changed parameters, exactly.

A set S has the prior probability of `SetPrior`; a change has the slab prior N(0, slab²·prior_sigma²), of an
instrument's error a wider one (`SetPrior.widths`). Then

    P(S | data) ∝ P(S) · mean over slabs of exp(½ β_Sᵀ A_S⁻¹ β_S − ½ log det A_S)
    with A_S = 1 + D I_SS D,  β = D b,  D = slab · diag(prior_sigma).

Of the leading sets the slab prior is cut to the way on which wear goes, all but a doubt (see `wear`).

All sets up to a size limit are visited, not sampled. The model is that of George, E. I. and McCulloch, R. E.
(1997) Statistica Sinica 7, 339–373.

Sizes. A size is known as well as the set is. Given the set S and the slab w the changes, in widths of the prior, are
Gaussian,

    x_S | S, w, data ~ N(P b_S, P),   P = (I_SS + w⁻² 1)⁻¹,     weight P(S | data) P(w | S, data)

and the size of a parameter that changed is the mixture of these over all sets that hold it (Bayesian model averaging:
Hoeting, J. A., Madigan, D., Raftery, A. E. and Volinsky, C. T. (1999) Statistical Science 14, 382–417). Its spread
holds that within the sets and that between them. In the sets without it, of probability 1 − q, it did not change, and
an interval of level c holds c of all of that: c/q of the mixture, or no change and what is then missing, 1 − (1 − c)/q
of the mixture, whichever is shorter.

An answer S says that these changed and that nothing else that matters did. It is right, too, where a set T ⊃ S is what
happened and all that T holds besides is below its `least_relevant_change` ε. Sets are gone through by falling
probability; each takes from the sets T after it that hold it the part

    P(T | data) Π_{i ∈ T∖S} P(|x_i| < ε_i | T, widest slab, data)

that has not been taken by one before, so that all probabilities add to 1 as before. Under the widest slab it is the
data that say that a change is small: one that they do not show remains as large as it may be.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from enginediag_cli.detection.verdict import required_changes
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior, are_sensors
from enginediag_cli.isolation.results import ParameterChange
from enginediag_cli.isolation.subsets import (
    MAX_SETS,
    enumerate_sets,
    enumeration_masks,
    log_leading_factors,
    log_normal_mass,
    size_limit,
    slab_gaussians,
    wear_signs,
)
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score

ALL_LISTED = 5000
"""Up to so many sets all are listed."""
NEGLIGIBLE = 1e-5
"""Of more, those sets are not listed that would hold less than this share even if all sets were as probable as they."""


@dataclass(frozen=True)
class SetPosterior:
    """Sets by falling probability: `masks` (M, p) bool, `probabilities` (M,), summing to 1; `inclusion` (p,). All sets
    were compared; of many, those that are NEGLIGIBLE are not among them, but for that of no change.

    `log_evidence`: log of the marginal likelihood ratio of "something changed" to "nothing changed" times the
    prior odds; `log_total`: that of all sets, with their prior, to "nothing changed" without it. `largest`: size limit
    that was used; `max_sensor_faults`: largest number of sensors in a set.
    """

    parameters: tuple[str, ...]
    masks: np.ndarray
    probabilities: np.ndarray
    inclusion: np.ndarray
    log_evidence: float
    largest: int
    max_sensor_faults: int = 0
    log_total: float = 0.0

    def names(self, i: int) -> tuple[str, ...]:
        """Parameters of the i-th most probable set."""
        return tuple(name for name, member in zip(self.parameters, self.masks[i], strict=True) if member)

    def merge_forms(self, instruments: InstrumentForms) -> SetPosterior:
        """The same with sets that differ by forms of instruments' errors as one, each instrument in its likeliest
        form."""
        if instruments.count == len(self.parameters) - int(np.sum(~instruments.is_form)):
            return self
        masks = instruments.merge_forms(self.masks, self.inclusion)
        packed = np.packbits(masks, axis=1)
        keys = np.ascontiguousarray(packed).view(np.dtype((np.void, packed.shape[1]))).ravel()
        _, first, where = np.unique(keys, return_index=True, return_inverse=True)
        weights = np.bincount(where.reshape(-1), weights=self.probabilities)
        order = np.lexsort((first, -weights))
        return replace(self, masks=masks[first[order]], probabilities=weights[order])

    def credible_count(self, coverage: float = 0.95) -> int:
        """How many of the first sets are needed to hold probability `coverage`."""
        return min(int(np.searchsorted(np.cumsum(self.probabilities), coverage - 1e-12)) + 1, len(self.probabilities))


def set_posterior(
    score: Score,
    prior: SetPrior | None = None,
    *,
    largest: int | None = None,
    faults: int | None = None,
    max_sets: int = MAX_SETS,
) -> SetPosterior:
    """Posterior probability of all sets of changed parameters.

    Parameters
    ----------
    score : Score
        Score b (p,) and information (p, p) of p parameters.
    prior : SetPrior, optional
        Of sets and of sizes of changes.
    largest : int, optional
        Most parameters of a set; by default as many as `max_sets` allows.
    faults : int, optional
        Only sets of exactly so many parameters.
    max_sets : int
        Most sets that are visited.

    Returns
    -------
    SetPosterior
        Sets (M, p) bool by falling probability.

    Raises
    ------
    ValueError
        When `faults` leaves more than `max_sets` sets to visit.

    References
    ----------
    George, E. I. and McCulloch, R. E. (1997) Statistica Sinica 7, 339–373.
    """
    prior = prior or SetPrior()
    p, instruments = len(score.parameters), InstrumentForms.from_parameters(score.described)
    forms, few = instruments.is_form, prior.max_sensor_faults
    limit = size_limit(p, faults if faults is not None else largest, max_sets, int(forms.sum()), few)
    if faults is not None and limit < min(faults, p):
        raise ValueError(f"{faults} faults among {p} parameters are more sets than can be visited ({max_sets})")
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)
    A = np.eye(p) + slabs[:, None, None] ** 2 * information
    masks, quadratic, log_det = enumerate_sets(slabs[:, None] * b, A, limit, forms, few)
    each = quadratic
    each -= log_det
    each *= 0.5
    wrong, healthy, log_forms = _count_forms(
        tuple(instruments.owner.tolist()), tuple(prior.log_fault_odds(instruments).tolist()), limit, few
    )
    top = np.maximum.reduce(list(each))  # with the prior, a bound of the weight that is no more than ln(slabs) off
    of_size = prior.log_size_probability(p - int(forms.sum())) + prior.log_no_instrument_fault(instruments)
    logs = top + of_size.take(healthy) + log_forms
    sizes = healthy + wrong
    none = int(np.flatnonzero(sizes == 0)[0])
    asked = np.isfinite(log_forms) & ((sizes == faults) if faults is not None else True)
    if len(logs) > ALL_LISTED:
        asked &= logs >= logs[asked].max() + np.log(NEGLIGIBLE / len(logs))
        asked[none] |= faults is None
    kept = np.flatnonzero(asked)
    spread = np.log(np.exp(each[:, kept] - top[kept]).mean(axis=0))
    empty = float(logs[none] + np.logaddexp.reduce(each[:, none] - top[none]) - np.log(len(each)))
    listed = _credible_rows(logs[kept] + spread, kept == none)
    logs, masks = (logs[kept] + spread)[listed], masks[kept[listed]]
    logs = logs + log_leading_factors(score, masks, logs, prior)
    order = np.argsort(-logs, kind="stable")
    masks, logs = masks[order], logs[order]
    weights = np.exp(logs - logs[0])
    probabilities = weights / weights.sum()
    changed = masks.any(axis=1)
    evidence = float(logs[0] + np.log(weights[changed].sum()) - empty) if weights[changed].sum() > 0 else -np.inf
    total = float(logs[0] + np.log(weights.sum()))
    return SetPosterior(
        score.parameters, masks, probabilities, probabilities @ masks, evidence, limit, prior.max_sensor_faults, total
    )


@lru_cache(maxsize=8)
def _count_forms(
    owner: tuple[int, ...], log_odds: tuple[float, ...], limit: int, few: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each set of `enumerate_sets`, in its order (M,): the number of errors of instruments and valves, the number of
    engine parameters, and the log prior odds of its forms, of which each has log_odds (p,)."""
    instruments = InstrumentForms(np.array(owner, int))
    masks = enumeration_masks(len(owner), limit, tuple((instruments.is_form).tolist()), few)
    wrong = masks[:, instruments.is_form].sum(axis=1)
    return wrong, masks[:, ~instruments.is_form].sum(axis=1), instruments.log_forms(masks, np.array(log_odds))


def _credible_rows(logs: np.ndarray, none: np.ndarray) -> np.ndarray:
    """Positions of the sets that hold all but NEGLIGIBLE of the weight exp(logs) (M,), and of the one of no change."""
    weights = np.exp(logs - logs.max())
    count, enough = ALL_LISTED, (1 - NEGLIGIBLE) * float(weights.sum())
    while count < len(logs):
        top = np.argpartition(-weights, count)[:count]
        if float(weights[top].sum()) >= enough:
            kept = none.copy()
            kept[top] = True
            return np.flatnonzero(kept)
        count *= 2
    return np.arange(len(logs))


def reweight(posterior: SetPosterior, weights: np.ndarray) -> SetPosterior:
    """The posterior with new weights (M,) ≥ 0 of its sets, sorted and normalised again."""
    order = np.argsort(-weights, kind="stable")
    probabilities = weights[order] / weights.sum()
    masks = posterior.masks[order]
    empty = ~masks.any(axis=1)
    healthy = float(probabilities[empty].sum())
    evidence = float(np.log1p(-healthy) - np.log(healthy)) if 0 < healthy < 1 else posterior.log_evidence
    return replace(
        posterior,
        masks=masks,
        probabilities=probabilities,
        inclusion=probabilities @ masks,
        log_evidence=evidence,
    )


LEFT_OUT = 1e-3
"""Share of a parameter's inclusion that the excluded sets hold together: a 95 % interval does not feel it."""


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


def average_sizes(
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
    inclusion = InstrumentForms.from_parameters(score.described).inclusion(posterior.inclusion)
    for i in score.indices(names).tolist():
        sets = _rows_with_parameter(posterior, i)
        weight, mean, spread = _size_mixture(score, posterior, sets, i, prior, about or {})
        centre = float(weight @ mean)
        error = float(np.sqrt(weight @ (spread**2 + (mean - centre) ** 2)))
        upper = _central_interval(weight, mean, spread, confidence)[1]
        ends = _interval_including_no_change(weight, mean, spread, confidence, min(float(inclusion[i]), 1.0))
        d, own_prior = float(unit[i]), [score.described[i]]
        low, high = (float((end / prior.widths(own_prior))[0]) for end in prior.bounds(own_prior))
        centre, ends = float(np.clip(centre, low, high)), tuple(np.clip(ends, low, high).tolist())
        upper = min(upper, high)
        own = (centre * d, error * d, ends[0] * d, ends[1] * d)
        found.append(ParameterChange(score.parameters[i], float(score.theta0[i]), *own, (upper - centre) * d))
    return tuple(found)


def _interval_including_no_change(
    weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float, inclusion: float
) -> tuple[float, float]:
    """Interval that holds `level` of the mixture, of probability `inclusion`, and of no change together."""
    share = max(1 - (1 - level) / inclusion, 0.0)
    low, high = _central_interval(weight, mean, spread, share)
    wide = min(low, 0.0), max(high, 0.0)
    if inclusion <= level:
        return wide
    narrow = _central_interval(weight, mean, spread, level / inclusion)
    return min(narrow, wide, key=lambda ends: ends[1] - ends[0])


def _central_interval(weight: np.ndarray, mean: np.ndarray, spread: np.ndarray, level: float) -> tuple[float, float]:
    """Quantiles of the mixture that hold `level` of it between them, as much below as above."""
    tail = (1 - level) / 2
    return _quantile(weight, mean, spread, tail), _quantile(weight, mean, spread, 1 - tail)


def _rows_with_parameter(posterior: SetPosterior, i: int) -> np.ndarray:
    """Positions of the likeliest sets that hold parameter i and, together, nearly all of its inclusion."""
    holding = np.flatnonzero(posterior.masks[:, i])
    held = np.cumsum(posterior.probabilities[holding])
    count = int(np.searchsorted(held, (1 - LEFT_OUT) * held[-1])) + 1
    return holding[: min(count, MOST_SETS)]


def _size_mixture(
    score: Score,
    posterior: SetPosterior,
    sets: np.ndarray,
    i: int,
    prior: SetPrior,
    about: Mapping[bytes, Score],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights, means and standard deviations (K,) of parameter i, in widths of `prior`, one for each set and slab."""
    weights, means, spreads = [], [], []
    for found in slab_gaussians(score, posterior.masks[sets], prior, about):
        at, pick = np.argmax(found.members == i, axis=1), np.arange(len(found.rows))
        weights.append((found.share * posterior.probabilities[sets[found.rows]]).ravel())
        means.append(found.mean[:, pick, at].ravel())
        spreads.append(np.sqrt(found.covariance[:, pick, at, at]).ravel())
    weight = np.concatenate(weights)
    return weight / weight.sum(), np.concatenate(means), np.concatenate(spreads)


def change_moments(
    score: Score, posterior: SetPosterior, prior: SetPrior, about: Mapping[bytes, Score] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Mean (p,) and covariance (p, p) of the changes of the score's parameters, in their units, whatever changed."""
    masks, weights = _leading_sets(posterior)
    weights, p = weights / weights.sum(), len(score.parameters)
    first, second = np.zeros(p), np.zeros((p, p))
    for found in slab_gaussians(score, masks, prior, about or {}):
        share = found.share * weights[found.rows]
        np.add.at(first, found.members, np.einsum("ws,wsi->si", share, found.mean))
        square = found.covariance + found.mean[..., :, None] * found.mean[..., None, :]
        at = (found.members[:, :, None], found.members[:, None, :])
        np.add.at(second, at, np.einsum("ws,wsij->sij", share, square))
    D = score.prior_sigma * prior.widths(score.described)
    return D * first, D[:, None] * (second - np.outer(first, first)) * D


def _leading_sets(posterior: SetPosterior) -> tuple[np.ndarray, np.ndarray]:
    """The likeliest sets (S, p), which hold nearly all, with their probabilities (S,)."""
    count = int(np.searchsorted(np.cumsum(posterior.probabilities), 1 - LEFT_OUT)) + 1
    return posterior.masks[: min(count, MOST_SETS)], posterior.probabilities[: min(count, MOST_SETS)]


def least_relevant_change(described: Sequence[Parameter], prior_sigma: np.ndarray) -> np.ndarray:
    """Change (p,) below which a further parameter does not matter, in its unit; 0 of instruments."""
    return np.where(are_sensors(described), 0.0, MATTERS * required_changes(described, prior_sigma))


def absorb_small_changes(
    score: Score, posterior: SetPosterior, prior: SetPrior, about: Mapping[bytes, Score] | None = None
) -> SetPosterior:
    """The posterior over answers: of each set the probability that these changed and nothing else that matters.

    The set that was likeliest stays the first; the others follow by falling probability.
    """
    masks, left = _leading_sets(posterior)
    small = log_negligible_probability(score, masks, prior, about or {})
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


def log_negligible_probability(
    score: Score, masks: np.ndarray, prior: SetPrior, about: Mapping[bytes, Score]
) -> np.ndarray:
    """log P(|change| < `least_relevant_change`) (S, p) of each member of sets (S, p) under the widest slab, 0 else."""
    signs, widths = wear_signs(score, prior), prior.widths(score.described)
    low, high = (end / widths for end in prior.bounds(score.described))
    least = least_relevant_change(score.described, score.prior_sigma) / (score.prior_sigma * widths)
    up = np.where(signs > 0, 1 - prior.p_recovery, np.where(signs < 0, prior.p_recovery, 0.5))
    found = np.zeros(masks.shape)
    for sets in slab_gaussians(score, masks, replace(prior, slabs=(max(prior.slabs),)), about):
        mean, spread = sets.mean[0], np.sqrt(np.einsum("sii->si", sets.covariance[0]))
        z = [(x[sets.members] - mean) / spread for x in (low, -least, np.zeros(len(low)), least, high)]
        mass, rise = [np.exp(log_normal_mass(z[k], z[k + 1])) for k in range(4)], up[sets.members]
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


@dataclass(frozen=True)
class SetInference:
    """The posterior over sets with the score and the prior from which it follows.

    Attributes
    ----------
    score : Score
        Of p parameters.
    posterior : SetPosterior
        Probabilities of sets.
    prior : SetPrior
        Prior of sets and sizes.
    own_scores : mapping of bytes to Score
        For sets that the full model was fitted to, by the bytes of their masks: scores about their own estimates.
    """

    score: Score
    posterior: SetPosterior
    prior: SetPrior
    own_scores: Mapping[bytes, Score] = field(default_factory=dict)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean (p,) and covariance (p, p) of the changes of the score's parameters, in their units."""
        return change_moments(self.score, self.posterior, self.prior, self.own_scores)
