"""What wear does to the probability of a set: efficiencies fall, and seldom rise.

The slab prior of a change that wear can only make one way has 1 − ρ of its mass there and ρ, for exchanged and repaired
modules, on the other side. Relative to the symmetric prior the marginal likelihood of a set changes by the factor

    E[Π_i 2 ((1 − ρ) 1{s_i x_i > 0} + ρ 1{s_i x_i < 0}) | S, slab, data],     x | S, slab, data ~ N(P β, P),

over the parameters i of S with a known sign s_i, averaged over slabs by their posterior. The expectation is taken
parameter by parameter: the others are carried on with the first two moments of the one that was weighed, as if they
were Gaussian still (Mendell, N. R. and Elston, R. C. (1974) Biometrics 30, 41–57). That is exact for one sign and for
independent ones, and costs no integral.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.residuals.score import Score

if TYPE_CHECKING:
    from enginediag_cli.isolation.prior import SetPrior

WEIGHED = 300
"""Sets that are weighed at most, those that could be likeliest: in the others the signs are as right as before the
data."""
FAINT = 1e-4
"""Of what the likeliest could weigh; sets that could weigh less are not weighed. All that changes no stated probability
by more than 0.002."""


def wear_signs(score: Score, prior: SetPrior) -> np.ndarray:
    """Way (p,) on which wear takes each parameter, −1 or +1, 0 where both are as probable."""
    known = prior.rises != 0.5
    return np.array([p.wear if known else 0 for p in score.described], float)


def log_wear(score: Score, masks: np.ndarray, logs: np.ndarray, prior: SetPrior) -> np.ndarray:
    """Log factors (M,) of sets (M, p) whose log weights without them are `logs` (M,); 0 of what is not weighed."""
    signs = wear_signs(score, prior)
    found = np.zeros(len(masks))
    if not signs.any():
        return found
    most = np.log(2 * max(prior.rises, 1 - prior.rises))
    ceiling = logs + most * (masks & (signs != 0)).sum(axis=1)
    top = np.argpartition(-ceiling, WEIGHED)[:WEIGHED] if len(masks) > WEIGHED else np.arange(len(masks))
    top = top[ceiling[top] > ceiling.max() + np.log(FAINT)]
    found[top] = np.log(wear_factors(score, masks[top], signs, prior))
    return found


def wear_factors(
    score: Score,
    masks: np.ndarray,
    signs: np.ndarray,
    prior: SetPrior,
    moved: np.ndarray | None = None,
    of: np.ndarray | None = None,
) -> np.ndarray:
    """Factor (w,) by which the signs (p,) of wear change the marginal likelihood of each set (w, p) bool.

    moved (r, p): what is added to the score, in widths of the prior, and of (r,): to which of the sets; the factors are
    then (r,), one for each.
    """
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)[:, None]
    which = np.arange(len(masks)) if of is None else of
    pulls = np.broadcast_to(b, masks.shape) if moved is None else b + moved
    factors = np.ones(len(which))
    sizes, signed = masks.sum(axis=1), (masks & (signs != 0)).sum(axis=1)
    for size in np.unique(sizes[signed > 0]):
        rows = np.flatnonzero((sizes == size) & (signed > 0))
        sets = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        sets = np.take_along_axis(sets, np.argsort(signs[sets] == 0, axis=1, kind="stable"), 1)  # signed ones first
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
        share = np.exp(log - np.logaddexp.reduce(log, axis=0))
        way = np.broadcast_to(signs[members], mean.shape).reshape(-1, size)
        each = _expected(mean.reshape(-1, size), covariance.reshape(-1, size, size), way, prior.rises)
        factors[told] = np.sum(share * each.reshape(share.shape), axis=0)
    return factors


def _expected(mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray, rises: float) -> np.ndarray:
    """The expectation (w,) of Gaussians, mean (w, d), covariance (w, d, d), whose signed variables (w, d) are first."""
    from scipy.special import ndtr

    mean, covariance = mean.copy(), covariance.copy()
    factor = np.ones(len(mean))
    for i in range(int((signs != 0).sum(axis=1).max())):
        known = signs[:, i] != 0
        spread = np.sqrt(covariance[:, i, i])
        a = signs[:, i] * mean[:, i] / spread
        here = 2 * (rises + (1 - 2 * rises) * ndtr(a))
        # of the variable in its own standard deviations, weighed: ∂ln(here)/∂a, and the variance less one
        moved = 2 * (1 - 2 * rises) * np.exp(-0.5 * a**2) / np.sqrt(2 * np.pi) / here
        narrowed = np.where(known, -moved * (a + moved), 0.0)
        moved = np.where(known, signs[:, i] * moved, 0.0)
        factor *= np.where(known, here, 1.0)
        along = covariance[:, :, i] / spread[:, None]
        mean += along * moved[:, None]
        covariance += narrowed[:, None, None] * along[:, :, None] * along[:, None, :]
    return factor
