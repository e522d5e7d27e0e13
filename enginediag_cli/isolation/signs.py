"""What is known of the sign of a change: efficiencies fall, a catalogue says which way capacities go.

With the slab prior cut to the known side of the parameters Z of a set S, its marginal likelihood is

    p₊(data | S) = p(data | S) · P(right signs | data, S) / P(right signs | S),     P(right signs | S) = 2^−|Z|

(what is left of a Gaussian after a cut, before and after the data). The signs may be wrong altogether with the
probability `doubt`, so that an efficiency that does rise is not excluded:

    p(data | S, signs) = (1 − doubt) p₊(data | S) + doubt p(data | S).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.isolation.posterior import SetPosterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score

if TYPE_CHECKING:
    from enginediag_cli.faults.component_faults import ComponentFault

POINTS = 256
"""Points of the orthant integral: error below 0.002 up to five dimensions."""
BATCH = 100
"""Sets whose orthant integrals are computed at once."""
NEGLIGIBLE = 1e-4
"""Sets are weighed until all others, even with every sign right, hold less than this share."""
MAX_WEIGHED = 3000
"""Sets that are weighed at most, a second's work; the likeliest come first."""


def known_signs(parameters: Sequence[Parameter], faults: Iterable[ComponentFault] = ()) -> np.ndarray:
    """Sign of a change of each parameter (p,): −1, +1, or 0 where it is not known.

    Wear says which way: efficiencies fall. Of others the sign is that of the catalogue's `faults`, where those agree.
    """
    seen: dict[str, set[float]] = {}
    for fault in faults:
        for name, change in fault.changes.items():
            seen.setdefault(name, set()).add(float(np.sign(change * fault.severity)))
    signs = np.zeros(len(parameters))
    for i, p in enumerate(parameters):
        if p.wear:
            signs[i] = p.wear
        elif len(seen.get(p.name, ())) == 1:
            signs[i] = next(iter(seen[p.name]))
    return signs


def orthant_probability(mean: np.ndarray, covariance: np.ndarray, points: int = POINTS) -> np.ndarray:
    """P(x > 0) (w,) of w Gaussians of d dimensions, mean (w, d), covariance (w, d, d) positive definite.

    Separation of variables with fixed quasi-random points, all w at once, which scipy's integral does not
    offer: Genz, A. (1992) J. Computational and Graphical Statistics 1, 141–149.
    """
    if mean.shape[1] == 0:
        return np.ones(len(mean))
    return np.asarray(_separated(mean, covariance, points)[0].mean(axis=1))


def orthant_moments(
    mean: np.ndarray, covariance: np.ndarray, points: int = POINTS
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P(x > 0) (w,), and mean (w, d) and covariance (w, d, d) of w Gaussians cut to x > 0, by the same points."""
    weight, y, L = _separated(mean, covariance, points)
    x = np.maximum(mean[:, None, :] + np.einsum("wij,wnj->wni", L, y), 0.0)
    weight = np.maximum(weight, 1e-300)  # an orthant as improbable as that has no moments worth having
    share = weight / weight.sum(axis=1, keepdims=True)
    centre = np.einsum("wn,wni->wi", share, x)
    away = x - centre[:, None, :]
    return weight.mean(axis=1), centre, np.einsum("wn,wni,wnj->wij", share, away, away)


def _separated(mean: np.ndarray, covariance: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Weights (w, n) of points x = mean + L y in the positive orthant, y (w, n, d), and L (w, d, d)."""
    from scipy.special import ndtr, ndtri

    w, d = mean.shape
    L = np.linalg.cholesky(covariance)
    lattice = np.arange(1, points + 1)[:, None] * np.sqrt(_PRIMES[:d])
    uniform = np.abs(2 * np.mod(lattice, 1.0) - 1)  # Richtmyer's points, folded to be smooth at the edges
    y = np.zeros((w, points, d))
    weight = np.ones((w, points))
    for i in range(d):
        centre = mean[:, i, None] + np.einsum("wnj,wj->wn", y[:, :, :i], L[:, i, :i])
        inside = np.maximum(ndtr(centre / L[:, i, i, None]), 1e-300)
        weight *= inside
        # of the standard normal beyond −centre/L_ii, the quantile of each point
        y[:, :, i] = -ndtri(np.maximum(inside * uniform[:, i], 1e-300))
    return weight, y, L


_PRIMES = np.array(
    [2, 3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59, 61, 67, 71, 73, 79, 83, 89, 97], float
)


def one_sided_posterior(
    score: Score,
    posterior: SetPosterior,
    signs: np.ndarray,
    prior: SetPrior | None = None,
    *,
    doubt: float = 0.05,
) -> SetPosterior:
    """The posterior over sets when the signs (p,) of changes are known, 0 where not.

    `posterior` must come from the same score and prior. Sets are weighed in the order of the most that signs
    could make of them; those left, together below NEGLIGIBLE, are taken as having all signs right as often as
    before the data.
    """
    prior = prior or SetPrior()
    if not 0 <= doubt <= 1:
        raise ValueError("`doubt` must lie in [0, 1]")
    if len(signs) != len(score.parameters):
        raise ValueError("`signs` must give one sign per parameter")
    # a set has at most as many informative signs as integration points have dimensions
    signed = (posterior.masks & (signs != 0)).sum(axis=1)
    ceiling = posterior.probabilities * ((1 - doubt) * 2.0 ** np.minimum(signed, len(_PRIMES)) + doubt)
    order = np.argsort(-ceiling, kind="stable")
    left = ceiling.sum() - np.cumsum(ceiling[order])
    weights = posterior.probabilities.copy()
    total, first = 0.0, 0
    while first < min(len(order), MAX_WEIGHED):
        chosen = order[first : first + BATCH]
        weights[chosen] *= sign_factors(score, posterior.masks[chosen], signs, prior, doubt)
        total += float(weights[chosen].sum())
        first += len(chosen)
        if left[first - 1] <= NEGLIGIBLE * total:
            break
    return reweighed(posterior, weights)


def sign_factors(score: Score, masks: np.ndarray, signs: np.ndarray, prior: SetPrior, doubt: float = 0.0) -> np.ndarray:
    """Factor (w,) by which knowing the signs (p,) changes the marginal likelihood of each set (w, p)."""
    b, information = prior.scaled(score)
    factors = np.ones(len(masks))
    sizes = masks.sum(axis=1)
    for size in np.unique(sizes[sizes > 0]):
        rows = np.flatnonzero(sizes == size)
        sets = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        each, log_each = [], []
        for slab in prior.slabs:
            A = np.eye(size) + slab**2 * information[sets[:, :, None], sets[:, None, :]]
            right = slab * b[sets]
            covariance = np.linalg.inv(A)
            mean = np.einsum("wij,wj->wi", covariance, right)
            log_each.append(0.5 * np.sum(mean * right, axis=1) - 0.5 * np.linalg.slogdet(A)[1])
            each.append(_right_signs(mean, covariance, signs[sets]))
        share = np.exp(np.array(log_each) - np.logaddexp.reduce(log_each, axis=0))
        count = (signs[sets] != 0).sum(axis=1)
        factors[rows] = (1 - doubt) * 2.0**count * np.sum(share * np.array(each), axis=0) + doubt
    return factors


def _right_signs(mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray) -> np.ndarray:
    """P(all known signs right) (w,) for posteriors of w sets of one size, signs (w, size)."""
    probability = np.ones(len(mean))
    counts = (signs != 0).sum(axis=1)
    for count in np.unique(counts[counts > 0]):
        rows = np.flatnonzero(counts == count)
        at = np.nonzero(signs[rows])[1].reshape(len(rows), count)[:, : len(_PRIMES)]
        turn = np.take_along_axis(signs[rows], at, 1)
        m = turn * np.take_along_axis(mean[rows], at, 1)
        C = covariance[rows[:, None, None], at[:, :, None], at[:, None, :]] * turn[:, :, None] * turn[:, None, :]
        probability[rows] = orthant_probability(m, C)
    return probability


def reweighed(posterior: SetPosterior, weights: np.ndarray) -> SetPosterior:
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
