"""Sizes of the changes of a set: Gaussians, one for each slab, and what bounds and wear make of them.

Given the set S and the slab w the changes, in widths of the prior, are Gaussian,

    x_S | S, w, data ~ N(P b_S, P),    P = (I_SS + w⁻² 1)⁻¹
    ln p(data | S, w) − ln p(data | no change) = ½ b_Sᵀ P b_S + ½ ln det P − |S| ln w

The slab prior of a change lies within what a component or an instrument can do (`SetPrior.bounds`). Of a parameter that
wear changes one way only, 1 − ρ of the mass lies on that side and ρ, for replaced and repaired modules, on the other.
Relative to the unbounded symmetric prior the marginal likelihood of a set changes by the factor

    E[Π_i h_i(x_i) | S, slab, data],     h_i = (1 − ρ)/P(0 < s x < bound) in the direction of wear,
                                              ρ/P(0 < −s x < bound) in the other, 0 beyond either bound

over the parameters i of S that have bounds, with the sign s of their wear (ρ = ½ where both directions are equally
probable), averaged over slabs by their posterior. The expectation is taken parameter by parameter: the others keep the
first two moments that each step leaves, as if they were still Gaussian (Mendell, N. R. and Elston, R. C. (1974)
Biometrics 30, 41–57). That is exact for one parameter and for independent ones, and costs no integral.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.log_weights import normalized_weights
from enginediag_cli.residuals.score import Score

NO_SCORES: Mapping[bytes, Score] = {}
"""Where no set has a score about its own estimate."""


def score_groups(masks: np.ndarray, score: Score, about: Mapping[bytes, Score]) -> Iterator[tuple[np.ndarray, Score]]:
    """Rows of the sets `masks` (M, p) with the score that describes them: the common one, then for each set in `about`
    (by the bytes of its mask) the score about its own estimate."""
    own = np.array([mask.tobytes() in about for mask in masks], bool)
    if not own.all():
        yield np.flatnonzero(~own), score
    for k in np.flatnonzero(own):
        yield np.array([k]), about[masks[k].tobytes()]


def sets_by_size(masks: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (S,) and members (S, d) of the sets `masks` (M, p) of each size d from 1 on."""
    sizes = masks.sum(axis=1)
    for size in np.unique(sizes[sizes > 0]):
        rows = np.flatnonzero(sizes == size)
        yield rows, np.nonzero(masks[rows])[1].reshape(len(rows), size)


@dataclass(frozen=True)
class SlabGaussians:
    """Changes of S sets of one size d, in widths of the prior: their `rows` (S,) and `members` (S, d); for each of W
    slabs and set the `log` (W, S) of the marginal likelihood relative to no change, mean (W, S, d) and covariance
    (W, S, d, d)."""

    rows: np.ndarray
    members: np.ndarray
    log: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """Posterior probability (W, S) of each slab, given the set."""
        return normalized_weights(self.log)


def slab_gaussians(
    score: Score, masks: np.ndarray, prior: SetPrior, about: Mapping[bytes, Score] = NO_SCORES
) -> Iterator[SlabGaussians]:
    """The changes of every set of `masks` (M, p) that is not empty, those of a size and a score together."""
    slabs = np.asarray(prior.slabs, float)
    for group, local in score_groups(masks, score, about):
        b, information = prior.scaled(local)
        for rows, members in sets_by_size(masks[group]):
            size = members.shape[1]
            I = information[members[:, :, None], members[:, None, :]]
            P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))
            mean = np.einsum("wsij,sj->wsi", P, b[members])
            log = 0.5 * np.einsum("wsi,si->ws", mean, b[members]) + 0.5 * np.linalg.slogdet(P)[1]
            yield SlabGaussians(group[rows], members, log - size * np.log(slabs)[:, None], mean, P)


WEIGHED = 300
"""Sets that are weighed at once, those first that could be likeliest: in the others signs and bounds are as right as
before the data."""


BATCHES = 10
"""Times so many are weighed: where the likeliest are all beyond what is possible, others lead."""


FAINT = 1e-4
"""Of what the likeliest could weigh; sets that could weigh less are not weighed. All that changes no stated probability
by more than 0.002."""


def log_leading_factors(score: Score, masks: np.ndarray, logs: np.ndarray, prior: SetPrior) -> np.ndarray:
    """Log factors (M,) of sets (M, p) whose log weights without them are `logs` (M,); 0 of what is not weighed, and of
    what is left when BATCHES were weighed no more than of those."""
    bounded = np.isfinite(prior.bounds(score.described)[1])
    found = np.zeros(len(masks))
    if not bounded.any() or not len(masks):
        return found
    most = np.log(2 * max(prior.p_recovery, 1 - prior.p_recovery))
    ceiling = logs + most * (masks & (wear_signs(score, prior) != 0)).sum(axis=1)
    order = np.argsort(-ceiling, kind="stable")
    best, weighed = -np.inf, 0
    for _ in range(BATCHES):
        top = order[weighed : weighed + WEIGHED]
        top = top[ceiling[top] > max(best, ceiling[order[0]] + np.log(FAINT) if weighed == 0 else best + np.log(FAINT))]
        if not len(top):
            return found
        found[top] = log_bound_factors(score, masks[top], prior)
        best = max(best, float((logs + found)[top].max()))
        weighed += len(top)
        if weighed >= len(order) or ceiling[order[weighed]] <= best + np.log(FAINT):
            return found
    found[order[weighed:]] = min(float(found[order[:weighed]].min()), 0.0)
    return found


def wear_signs(score: Score, prior: SetPrior) -> np.ndarray:
    """Way (p,) on which wear takes each parameter, −1 or +1, 0 where both are as probable."""
    known = prior.p_recovery != 0.5
    return np.array([p.wear if known else 0 for p in score.described], float)


def log_bound_factors(
    score: Score,
    masks: np.ndarray,
    prior: SetPrior,
    moved: np.ndarray | None = None,
    of: np.ndarray | None = None,
) -> np.ndarray:
    """Log factor (w,) by which wear and bounds change the marginal likelihood of each set (w, p) bool.

    moved (r, p): what is added to the score, in widths of the prior, and of (r,): to which of the sets; the factors are
    then (r,), one for each.
    """
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)[:, None]
    which = np.arange(len(masks)) if of is None else of
    pulls = np.broadcast_to(b, masks.shape) if moved is None else b + moved
    factors = np.zeros(len(which))
    signs, widths = wear_signs(score, prior), prior.widths(score.described)
    low, high = (end / widths for end in prior.bounds(score.described))
    bounded = np.isfinite(high)
    sizes, counts = masks.sum(axis=1), (masks & bounded).sum(axis=1)
    for size, count in np.unique(np.column_stack([sizes, counts])[counts > 0], axis=0):
        rows = np.flatnonzero((sizes == size) & (counts == count))
        sets = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        sets = np.take_along_axis(sets, np.argsort(~bounded[sets], axis=1, kind="stable"), 1)  # bounded ones first
        A = np.eye(size) + slabs[..., None, None] ** 2 * information[sets[:, :, None], sets[:, None, :]]
        covariance = np.linalg.inv(A)
        log_det = 0.5 * np.linalg.slogdet(covariance)[1]
        place = np.full(len(masks), -1)
        place[rows] = np.arange(len(rows))
        told = np.flatnonzero(place[which] >= 0)
        at = place[which[told]]
        members, covariance = sets[at], covariance[:, at]
        right = slabs[..., None] * np.take_along_axis(pulls[told], members, 1)
        mean = np.einsum("wsij,wsj->wsi", covariance, right)
        log = 0.5 * np.sum(mean * right, axis=2) + log_det[:, at]
        share = log - np.logaddexp.reduce(log, axis=0)
        cut = [np.broadcast_to(x[members], mean.shape).reshape(-1, size)[:, :count] for x in (signs, low, high)]
        unit = np.broadcast_to(slabs[..., None], mean.shape).reshape(-1, size)[:, :count]
        each = _log_expected(
            mean.reshape(-1, size),
            covariance.reshape(-1, size, size),
            cut[0],
            cut[1] / unit,
            cut[2] / unit,
            prior.p_recovery,
        )
        factors[told] = np.logaddexp.reduce(share + each.reshape(share.shape), axis=0)
    return factors


def _log_expected(
    mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray, low: np.ndarray, high: np.ndarray, rises: float
) -> np.ndarray:
    """Log of the expectation (w,) of Gaussians, mean (w, d), covariance (w, d, d), over the first k of their variables,
    whose signs, lowest and highest values are (w, k)."""
    from scipy.special import ndtr

    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(len(mean))
    for i in range(signs.shape[1]):
        sign = signs[:, i]
        up = np.where(sign > 0, 1 - rises, np.where(sign < 0, rises, 0.5)) / (ndtr(high[:, i]) - 0.5)
        down = np.where(sign < 0, 1 - rises, np.where(sign > 0, rises, 0.5)) / (0.5 - ndtr(low[:, i]))
        spread = np.sqrt(covariance[:, i, i])
        a, c, z = ((x - mean[:, i]) / spread for x in (low[:, i], np.zeros(len(mean)), high[:, i]))
        log, moved, square = piecewise_normal_moments(a, c, z, down, up)
        total += log
        along = covariance[:, :, i] / spread[:, None]
        mean += along * moved[:, None]
        covariance += (square - moved**2 - 1.0)[:, None, None] * along[:, :, None] * along[:, None, :]
        # of the variable itself nothing but what is within the bounds is left: keep the matrix definite
        covariance[:, i, i] = np.maximum(covariance[:, i, i], 1e-12 * spread**2)
    return total


def piecewise_normal_moments(
    a: np.ndarray, c: np.ndarray, z: np.ndarray, down: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log of the mass, mean and mean square (w,) of a standard normal variable with the weight `down` from a to c and
    `up` from c to z, 0 beyond."""
    below, above = np.log(down) + log_normal_mass(a, c), np.log(up) + log_normal_mass(c, z)
    total = np.logaddexp(below, above)
    density = [-0.5 * x**2 - 0.5 * np.log(2 * np.pi) for x in (a, c, z)]
    at_a, at_c = (np.exp(np.log(down) + density[k] - total) for k in (0, 1))
    to_c, to_z = (np.exp(np.log(up) + density[k] - total) for k in (1, 2))
    mean = at_a - at_c + to_c - to_z
    low, high = np.where(np.isfinite(a), a, 0.0), np.where(np.isfinite(z), z, 0.0)  # no density so far out
    square = 1.0 + low * at_a - c * at_c + c * to_c - high * to_z
    # far beyond a bound rounding decides: all of the mass lies at it
    at = np.where(a > FAR, a, np.where(z < -FAR, z, np.nan))
    mean = np.where(np.isfinite(at), at, mean)
    square = np.where(np.isfinite(at), at**2, np.maximum(square, mean**2))
    return total, mean, square


FAR = 30.0
"""Standard deviations beyond a bound from which what is left of the normal law is a point there."""


def log_normal_mass(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """log of the mass (w,) of the standard normal law between `low` and `high`, however far out."""
    from scipy.special import log_ndtr

    flip = low > 0
    one, other = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(other), log_ndtr(one)
    return np.asarray(upper + np.log(np.maximum(-np.expm1(np.minimum(lower - upper, -1e-300)), 1e-300)))
