"""Noise of the sensors from the residuals of a fit: size, correlation, shape of its distribution.

**Size and shape.** The scale is the root mean square, which is right whatever the law of the noise, unless there are
gross outliers: then it is Huber's "proposal 2", σ for which the mean of min((e/σ)², c²) is what it is for Gaussian
noise. A gross outlier counts as c standard deviations, not as nothing: leaving the tails out would let σ, the weights
of the fit and the tails chase each other down. Readings beyond `OUTLIER` standard deviations are counted. The lag-1
correlation is taken without them between neighbours in time and operating point , and

    κ = (1 + ρ)/(1 − ρ),  n_effective = n/κ     where every record follows at the same step

is how many independent readings the n correlated ones are worth for a constant (G. V. Bayley and J. M. Hammersley, J.
R. Statist. Soc. Suppl. 8 (1946) 184–197). Scale: P. J. Huber, Ann. Math. Statist. 35 (1964) 73–101, §8. The shape of
the distribution is the excess kurtosis of what each reading adds to the one before it, e_k − ρ e_k−1.

**Distance of records.** Correlation decays with elapsed time and with the distance of operating points, not with the
count of records. Two records a usual step apart at the same operating point have correlation ρ, two that are g steps
apart ρ^g, records of different recordings none. g is the elapsed time over the recording's median step, and one step
more for each `FAR` of its range by which an input changed. A recording without time counts its records, and one that
moves on with every record counts time alone: it has no neighbours at one operating point that could say what ρ is,
those in time do, and by time alone the monitor's windows reckon, too.

**Resolution.** Noise is not known to be smaller than the step in which a sensor is recorded.

**Noise for monitoring.** Later stages must expect the residuals of records that the fit has not seen. A generic engine
model is wrong by more than its sensors scatter, differently from one stretch of a flight to the next. Cross-validation
shows by how much; a test that allows for the sensors' scatter alone gives false alarms.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

TIME = "time_s"
"""Column of the elapsed time."""

FAR = 0.1
"""Share of the range of an input beyond which the error of a model is another one, as in the residuals of two recorded
flights, where it changes with power and Mach number over a tenth of what was flown."""
NEAREST = 0.5
"""Steps: records that lie closer (an irregular clock, a time given twice) still have noise of their own."""
NEIGHBOURS = 1.5
"""Steps up to which two records are neighbours, from which ρ is estimated: judgement, one and no second."""
MOSTLY = 0.5
"""Share of the records of a recording that must lie as near to the one before as that: of fewer, chosen by how little
happened, ρ is not known, and would not be that of the others."""

FADED = 1e-9
"""Correlation below which records no longer know of each other."""


def record_positions(columns: Mapping[str, np.ndarray], inputs: Sequence[str], n: int) -> np.ndarray:
    """Steps since the first of n records of one recording, (n,), not decreasing."""
    time = columns.get(TIME)
    counted = np.arange(n, dtype=float)
    if time is None or n < 2 or not np.isfinite(time).all():
        return counted
    passed = np.abs(np.diff(np.asarray(time, float)))
    if not (passed > 0).any():
        return counted
    gap = passed / np.median(passed[passed > 0])
    moved = np.zeros(n - 1)
    for column in inputs:
        u = np.asarray(columns[column], float)
        span = np.ptp(u[np.isfinite(u)]) if np.isfinite(u).any() else 0.0
        if span > 0:
            moved = np.fmax(moved, np.abs(np.diff(u)) / span)
    steps = gap + moved / FAR
    if np.mean(steps <= NEIGHBOURS) < MOSTLY:
        steps = gap
    return np.concatenate([[0.0], np.cumsum(np.maximum(steps, NEAREST))])


def record_gaps(position: np.ndarray, recording: np.ndarray) -> np.ndarray:
    """Steps since the record before, (N,), infinite at the beginning of a recording; both arguments (N,)."""
    gap = np.diff(position, prepend=0.0)
    gap[np.diff(recording, prepend=-1) != 0] = np.inf
    return gap


def correlations(gap: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """Correlation of each record with the one before, (N, m), for neighbours' correlations `rho` (m,) and gaps (N,)."""
    # an even power of a negative correlation would be positive, which nobody has seen: it ends with the neighbour
    decay = np.abs(rho) ** np.where(np.isfinite(gap), gap, 0.0)[:, None]
    decay = np.where(rho >= 0, decay, np.where(gap[:, None] <= NEIGHBOURS, rho, 0.0))
    return np.where(np.isfinite(gap)[:, None], decay, 0.0)


def correlated_sum(g: np.ndarray, r: np.ndarray) -> np.ndarray:
    """f_k = Σ_l C_kl g_l for g (N, m, p), C_kl the product of the correlations r (N, m) of the records from l to k."""
    back = np.zeros_like(r)
    back[:-1] = r[1:]
    return linear_recursion(g, r, FADED) + linear_recursion(g[::-1], back[::-1], FADED)[::-1] - g


def linear_recursion(g: np.ndarray, r: np.ndarray, negligible: float) -> np.ndarray:
    """b_k = g_k + r_k b_k−1 with r_0 = 0 for g (N, m, p) and r (N, m), in O(N log memory) by doubling the reach.

    negligible: the correlation below which records no longer know of each other.
    """
    b, reach, r = g.copy(), 1, r.copy()
    r[:1] = 0.0
    while reach < len(b) and np.abs(r).max(initial=0.0) > negligible:
        b[reach:] += r[reach:, :, None] * b[:-reach]
        r[reach:] *= r[:-reach].copy()
        r[:reach] = 0.0
        reach *= 2
    return b


def inflation(gap: np.ndarray, rho: np.ndarray) -> np.ndarray:
    """κ (m,): readings per independent one, (1 + ρ)/(1 − ρ) where all records are a step apart, else the mean over the
    records of Σ_l C_kl."""
    inside = np.isfinite(gap)
    if np.all(gap[inside] == 1.0):
        return (1 + rho) / (1 - rho)
    r = correlations(gap, rho)
    found = correlated_sum(np.ones((*r.shape, 1)), r)[:, :, 0].mean(axis=0)
    return np.where(rho >= 0, np.maximum(found, 1.0), (1 + rho) / (1 - rho))


OUTLIER = 4.0
"""One Gaussian reading in 16,000 lies beyond four standard deviations."""
CLIP = 2.5
"""Squares of residuals count up to so many standard deviations, so that gross errors do not make the noise: 1 % of
Gaussian readings are clipped."""
GAUSSIAN_MEAN = 0.9775
"""E min(z², CLIP²) for a standard normal z: 1 − 2(cφ(c) + Q(c)) + 2c²Q(c)."""

MAX_RHO = 0.98
"""Beyond this the recording is one reading, not many, and κ says nothing any more."""

FEW_PAIRS = 50
"""Pairs of neighbours below which ρ is not taken to be negative."""

MAX_KURTOSIS = 6.0
"""Of an exponential law; tails that are heavier show as outliers."""

SIGMA_FROM = ("fit", "stated", "cross_validation")
"""Where σ comes from: the variance of what the fit leaves, known as well as its degrees of freedom make it; what the
sensor is said to have, taken for certain; or errors of prediction, that of the model included."""


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of m sensors; `sigma` in the column's unit."""

    sigma: np.ndarray  # (m,)
    rho1: np.ndarray  # (m,) up to MAX_RHO, and not lower than chance makes it for white noise
    inflation: np.ndarray  # (m,) κ
    n: np.ndarray  # (m,) readings
    n_effective: np.ndarray  # (m,)
    outliers: np.ndarray  # (m,) readings beyond OUTLIER standard deviations
    correlation: np.ndarray  # (m, m) between sensors in the same record
    degrees: np.ndarray  # (m,) readings less those that the fit used up
    used: np.ndarray  # (m,) variances that the fit took out of the sum of squares
    rho1_error: np.ndarray  # (m,) standard error of rho1, apart from what all sensors share
    rho1_common: np.ndarray  # (m,) standard error of rho1 that all sensors share, because ρ was drawn to their mean
    kurtosis: np.ndarray  # (m,) excess kurtosis, 0 for Gaussian noise
    sigma_from: str = "fit"  # one of SIGMA_FROM


def estimate_noise(residual: np.ndarray, gap: np.ndarray, lost: np.ndarray, floor: np.ndarray) -> NoiseEstimate:
    """Noise from residuals (N, m), NaN where missing, of records `gap` (N,) steps behind the one before (`noise.py`).

    `lost` (2, m): how many variances the fit took out of Σ e² and Σ e_k e_k−1 of each sensor (see `covariance.py`); one
    row (m,) where it took as many out of both, as a mean does. `floor` (m,) bounds sigma from below, in the column's
    unit: a sensor that the model can follow exactly must not get infinite weight.

    With n readings and n₁ pairs of neighbours, E Σ e² = σ² (n − lost₀) and E Σ e_k e_k−1 = σ² (n₁ ρ − lost₁) give each
    sensor its own σ² = C₀ and ρ = C₁/C₀. Where ρ is then shrunk, σ goes with it, or a sensor that happened to wander
    would be both large and quick: the variance of e_k − ρ e_k−1, by both ways C₀ (1 + ρ²) − 2ρ C₁ = σ² (1 − ρ²).
    """
    there = np.isfinite(residual)
    n = there.sum(axis=0)
    scale = np.maximum(huber_scale(residual), floor)
    with np.errstate(invalid="ignore"):
        inside = there & (np.abs(residual) <= OUTLIER * scale)
    kept = inside.sum(axis=0)
    e = np.where(inside, residual, 0.0)
    square = np.sum(e**2, axis=0) / np.maximum(kept, 1)
    # proposal 2 is consistent for Gaussian noise only: uniform noise, which never reaches the clip, gets 1 % more
    scale = np.where(kept == n, np.maximum(np.sqrt(square), floor), scale)
    pairs = inside[1:] & inside[:-1] & (gap[1:] <= NEIGHBOURS)[:, None]
    known = pairs.sum(axis=0) >= 10
    n0, n1 = np.maximum(kept, 1), np.maximum(pairs.sum(axis=0), 1)
    # more than half of the readings is never used up by a fit that means anything; far from there sums may say so
    lost = np.clip(np.broadcast_to(lost, (2, len(n))), -0.5 * n0, 0.5 * n0)
    # where few records have a neighbour, these may happen to scatter more than all: by their own square, no ρ exceeds 1
    paired = np.sum(np.where(pairs, e[1:] ** 2 + e[:-1] ** 2, 0.0), axis=0) / (2 * n1)
    neighbours = np.sum(np.where(pairs, e[1:] * e[:-1], 0.0), axis=0) / np.where(paired > 0, paired, 1.0)
    own = (neighbours * (n0 - lost[0]) / n0 + lost[1]) / n1
    # a little below 0 is sampling error; cutting it off would make white noise look correlated on average. Of a few
    # records, operating points taken in turn make neighbours differ, and that is no reason to trust their mean more
    lowest = np.where(n1 < FEW_PAIRS, 0.0, -2.0 / np.sqrt(np.maximum(kept, 4)))
    own = np.where(known, np.clip(own, lowest, MAX_RHO), 0.0)
    # of few pairs a correlation is believed as far as its square exceeds what chance gives white noise, 1/n (the
    # positive-part estimator of W. James and C. Stein, Proc. 4th Berkeley Symp. 1 (1961) 361–379)
    believed = np.maximum(1.0 - 1.0 / (n1 * np.maximum(own**2, 1e-12)), 0.0)
    own = np.where(n1 < FEW_PAIRS, own * believed, own)
    # F. H. C. Marriott and J. A. Pope, Biometrika 41 (1954) 390–402, for a known mean. The ratio of two sums is too
    # small on average, the sums are not: σ below is made of these, and by the larger ratio it would come out too small
    unbiased = np.clip(own * (1 + 2 / n1), -MAX_RHO, MAX_RHO)
    # the sums that the fit left are blown up by n/(n − lost), and their scatter with them
    chance = np.maximum(1 - unbiased**2, 0.0) / n1 * (n0 / (n0 - np.maximum(lost[0], 0.0))) ** 2
    rho, rho_error, rho_common = _shrink(unbiased, n1, chance, known)
    innovations = 1 - rho**2
    sigma = scale * np.sqrt(n0 / (n0 - lost[0]) * (1 + rho**2 - 2 * rho * own) / innovations)
    degrees = n0 - np.where(known, ((1 + rho**2) * lost[0] - 2 * rho * lost[1]) / innovations, lost[0])
    kappa = inflation(gap, rho)
    return NoiseEstimate(
        np.maximum(sigma, floor),
        rho,
        kappa,
        n,
        n / kappa,
        (there & ~inside).sum(axis=0),
        _correlation(e / np.maximum(sigma, floor), inside),
        np.maximum(degrees, 1.0),
        np.clip(lost[0], 0.0, None),
        rho_error,
        rho_common,
        excess_kurtosis(np.where(pairs, e[1:] - rho * e[:-1], np.nan) if np.any(rho) else np.where(inside, e, np.nan)),
    )


def _shrink(
    rho: np.ndarray, n: np.ndarray, chance: np.ndarray, known: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correlations (m,) drawn towards their mean as far as their scatter is no more than chance, and standard errors:
    each sensor's own, and that of the mean, which they have in common.

    `chance` (m,) is the variance with which each scatters by chance, (1 − ρ²)/n where the fit took nothing.
    Empirical Bayes (B. Efron and C. Morris, J. Am. Statist. Ass. 70 (1975) 311–319): from 100 readings ρ is known to
    0.1 only, and tests that believed each sensor's own would raise false alarms. Sensors not `known` take no part and
    are certain.
    """
    if known.sum() < 4:
        return rho, np.where(known, np.sqrt(chance), 0.0), np.zeros(len(rho))
    mean = float(np.average(rho[known], weights=n[known]))
    excess = max(float(np.mean((rho[known] - mean) ** 2 - chance[known])), 0.0)
    own = excess / (excess + chance + 1e-12)
    common = (1 - own) * np.sqrt(np.mean(chance[known]) / known.sum())
    own_error = np.sqrt(own * chance)
    drawn = np.where(known, mean + own * (rho - mean), rho)
    return drawn, np.where(known, own_error, 0.0), np.where(known, common, 0.0)


def excess_kurtosis(u: np.ndarray) -> np.ndarray:
    """Excess kurtosis of each column of (N, m), NaN where missing, as far as it is not chance.

    Fisher's g₂, unbiased for Gaussian noise; its variance is then 24/n (D. N. Joanes and C. A. Gill, The Statistician
    47 (1998) 183–189). The sensors' mean is drawn towards 0 and each sensor towards the mean, both by the share of
    their square that chance explains, as in `_shrunk`.
    """
    n = np.isfinite(u).sum(axis=0)
    known = n >= 20
    if not known.any():
        return np.zeros(u.shape[1])
    v = np.nan_to_num(u[:, known])
    k = n[known]
    second = np.sum(v**2, axis=0) / k
    fourth = np.sum(v**4, axis=0) / k
    plain = np.where(second > 0, fourth / np.where(second > 0, second, 1.0) ** 2 - 3, 0.0)
    own = (k - 1) / ((k - 2) * (k - 3)) * ((k + 1) * plain + 6)
    mean = float(np.average(own, weights=k))
    chance = 24.0 / k
    of_mean = 24.0 / k.sum()
    excess = max(float(np.mean((own - mean) ** 2 - chance)), 0.0)
    common = mean * max(1 - of_mean / max(mean**2, 1e-300), 0.0)
    found = np.zeros(u.shape[1])
    found[known] = np.clip(common + excess / (excess + chance) * (own - mean), -2.0, MAX_KURTOSIS)
    return found


def huber_scale(e: np.ndarray) -> np.ndarray:
    """Proposal 2 scale of each column of (N, m) about 0, ignoring NaN; NaN for a column without readings."""
    there = np.isfinite(e)
    out = np.full(e.shape[1], np.nan)
    for s in range(e.shape[1]):
        column = e[there[:, s], s]
        if not len(column):
            continue
        out[s] = np.sqrt(np.mean(column**2))
        for _ in range(100):  # falls monotonically from the root mean square to the fixed point
            if out[s] == 0.0:
                break
            before = out[s]
            out[s] *= np.sqrt(np.mean(np.minimum((column / before) ** 2, CLIP**2)) / GAUSSIAN_MEAN)
            if abs(out[s] - before) < 1e-6 * before:
                break
    return out


def initial_noise(residual: np.ndarray, gap: np.ndarray, floor: np.ndarray) -> NoiseEstimate:
    """Noise as it looks before a fit: scatter of (N, m) about the median of each recording.

    It holds the whole error of the model, which changes slowly along a recording, so that its correlation is
    high and a first fit trusts the priors more than the data.
    """
    centred = residual.copy()
    starts = np.flatnonzero(np.isinf(gap))
    for first, stop in zip(starts, [*starts[1:], len(gap)], strict=True):
        part = residual[first:stop]
        there = np.isfinite(part).any(axis=0)
        centred[first:stop, there] -= np.nanmedian(part[:, there], axis=0)
    return estimate_noise(centred, gap, np.zeros(residual.shape[1]), floor)


def _correlation(z: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Correlation of sensors over records in which both have a reading; 0 where fewer than 10 do.

    Pairs that are taken over different records need not be the correlation of any numbers: what is negative of its
    eigenvalues is removed, and the diagonal brought back to 1 (J. Rousseeuw and G. Molenberghs, Commun. Statist.
    Theory Meth. 22 (1993) 965–984, eigenvalue method)."""
    v = np.where(inside, z, 0.0)
    both = inside.astype(float).T @ inside.astype(float)
    power = (v**2).T @ inside.astype(float)
    c = (v.T @ v) / np.maximum(np.sqrt(power * power.T), 1e-300)
    c = np.where(both >= 10, c, 0.0)
    np.fill_diagonal(c, 1.0)
    values, vectors = np.linalg.eigh(c)
    if values[0] >= 0.0:
        return c
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    root /= np.sqrt(np.sum(root**2, axis=1, keepdims=True))  # no row is 0: the trace is that of c, m, or more
    c = root @ root.T
    np.fill_diagonal(c, 1.0)
    return c


ROUNDING = 1e-9
"""Relative difference below which two readings are the same number, written or converted differently."""


def quantisation_sigma(measured: np.ndarray) -> np.ndarray:
    """q/√12 of each sensor (m,) from its readings (N, m), NaN where missing; q is the smallest step between them.

    The standard deviation of rounding to steps of q (W. R. Bennett, Bell Syst. Tech. J. 27 (1948) 446–472).
    Readings that hardly ever leave one step look exact and are not. Finely recorded readings have a step
    near zero; a sensor that gives one value only has none, and 0 is returned.
    """
    out = np.zeros(measured.shape[1])
    for j in range(measured.shape[1]):
        values = np.unique(measured[np.isfinite(measured[:, j]), j])
        steps = np.diff(values)
        steps = steps[steps > ROUNDING * np.max(np.abs(values), initial=0.0)]
        if steps.size:
            out[j] = float(steps.min()) / np.sqrt(12.0)
    return out


def cross_validated_noise(residual: np.ndarray, gap: np.ndarray, floor: np.ndarray) -> NoiseEstimate:
    """Noise from residuals (N, m), NaN where missing, of records predicted by a fit without them;
    `gap` (N,) as for `estimate_noise`.

    The scale is the root mean square of all readings, none excluded: where the model is at its worst is part of
    what it will do again. `floor` (m,) is the noise of the fit, below which prediction cannot be.
    """
    found = estimate_noise(residual, gap, np.zeros(residual.shape[1]), floor)
    there = np.isfinite(residual)
    squares = np.sum(np.where(there, residual, 0.0) ** 2, axis=0)
    rms = np.sqrt(squares / np.maximum(there.sum(axis=0), 1))
    return replace(found, sigma=np.maximum(rms, floor), sigma_from="cross_validation")
