"""How the readings of a series wander by more than their noise: weather, vanes that move, drift that nobody models.

Readings minus prediction z (n, m) of n epochs are a level, a smooth function of the conditions flown (`weather`), a
process that wanders and noise. Its size is read from differences of epochs, by their distance in time: half of the mean
square of a difference, of all pairs of readings, is the structure function (Matheron's variogram). A step in one
reading stands in few of these differences, and in none of them at most once, so that it is not learnt as scatter; a
tenth of the series is the longest distance, beyond which a step would be in too many.

The structure functions of the shortest and of the longest distance have common modes W (generalised eigenvectors),
each a scalar series with the covariance Σ_j x_j exp(−|t − t'|/τ_j). Epochs that are off alone, against what is before
and after them, count as much as their own scatter allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.detection.readings import Readings

DISTANCES = 12
"""Classes of distance, each twice as long as the one before: from neighbours to a tenth of the longest series."""
LONGEST = 0.1
"""Longest distance of differences, in lengths of the series."""
SHORT, OF_SHORT = 16, 0.4
"""Distance in epochs up to which a short series is looked at all the same, and the longest such in lengths of it: a
tenth of forty epochs does not tell a walk from wear."""
PAIRS = 8
"""Differences of one epoch with later ones in a class: all of them say the same."""
LEAST_PAIRS = 20
"""Differences that a class needs; with fewer the neighbouring classes tell more."""
FREEDOM = 8.0
"""Degrees of freedom of Student's t by which differences are weighed (Lange, Little and Taylor (1989))."""
MEDIAN = 0.455
"""Median of the square of a standard normal variable."""
ROUNDS = 8
"""Rounds of weighing; the weights only have to be of the right order."""
WHITE = 0.05
"""Least share of the difference of neighbours that is noise."""
WALK = 4.0
"""Correlation length of a walk, in lengths of the series: it has no level to return to."""
LEVEL = 1e3
"""Variance of the level of a mode, in units of its scatter: nothing is known of it."""
LOCAL = 21
"""Epochs by whose median it is judged how much more readings scatter there than by the law of the whole series; a
series of five times as many can tell."""
OUTLIER = 1e-4
"""Chance of an epoch, were all as usual, below which it counts as off by itself."""


@dataclass(frozen=True)
class Wander:
    """Modes W (m, k); inverse (k, n, n): inverse covariance of each mode of the series; c (k, n): inverse times
    series; log: log likelihood of no event; beside: the same of the series without the known events, which it was read
    from; slow: whether readings wander at all; inputs: of the modes the last ones, each of one input."""

    W: np.ndarray
    inverse: np.ndarray
    c: np.ndarray
    log: float
    beside: float
    slow: bool
    inputs: int = 0


def structure(clock: np.ndarray, z: np.ndarray, least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (h,) and half the mean square of differences (h, m, m) of the readings z (n, m). least (m, m):
    covariance of their noise, which counts as m + 2 differences."""
    n = len(z)
    unit = np.median(np.diff(clock))
    rng = np.random.default_rng(n)  # which pairs are drawn; the same for the same series
    limit = max(LONGEST * (clock[-1] - clock[0]), min(OF_SHORT * (clock[-1] - clock[0]), SHORT * unit))
    edges = unit * 0.999 * 2.0 ** np.arange(DISTANCES + 1)
    distances: list[float] = []
    pairs: list[np.ndarray] = []
    for low, high in pairwise(edges):
        if low > limit and pairs:  # neighbours tell what they differ by in the shortest series
            break
        first, last = np.searchsorted(clock, clock + low), np.searchsorted(clock, clock + high)
        one = np.repeat(np.arange(n), np.minimum(last - first, PAIRS))
        if len(one) < LEAST_PAIRS and pairs:
            continue
        if not len(one):
            one, other = np.arange(n - 1), np.arange(1, n)
        else:
            other = first[one] + (rng.random(len(one)) * (last - first)[one]).astype(int)
        pairs.append(z[other] - z[one])
        distances.append(float(np.mean(clock[other] - clock[one])))
    return np.array(distances), _half_squares(pairs, least, n - 1)


def _half_squares(differences: Sequence[np.ndarray], least: np.ndarray, own: int) -> np.ndarray:
    """Half the second moments (h, m, m) of differences (k, m) of each class, those that are far off counting less;
    `own` of them are independent. All classes at once: each is a few small matrices."""
    m = len(least)
    k = np.array([len(d) for d in differences])
    padded = np.zeros((len(k), int(k.max()), m))
    for d, of_class in zip(differences, padded, strict=True):
        of_class[: len(d)] = d
    there = np.arange(padded.shape[1]) < k[:, None]
    prior, count = m + 2.0, k[:, None, None].astype(float)
    size = np.ones((len(k), 1, 1))
    # from medians on: of four differences one that holds a step would else take the rest for close to it
    S = np.array([np.diag(np.median(d**2, axis=0)) for d in differences]) / MEDIAN + 2e-9 * least
    for _ in range(ROUNDS):
        S = (count * S + prior * size * 2 * least) / (count + prior)
        distance = np.sum((padded @ np.linalg.inv(S)) * padded, axis=2)
        w = np.minimum((FREEDOM + m) / (FREEDOM + distance), 1.0) * there
        S = np.swapaxes(padded * w[:, :, None], 1, 2) @ padded / w.sum(axis=1)[:, None, None]
        size = _shares(S, 2 * least, np.minimum(k, own))[:, None, None]
    return np.asarray((count * S + prior * size * 2 * least) / (count + prior) / 2)


def _shares(S: np.ndarray, least: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Geometric mean of what S (h, m, m), second moments of `own` (h,) independent differences, are of `least`, one at
    most: the determinant without its bias (Anderson (2003), theorem 7.5.3). One with too few differences to tell."""
    from scipy.special import psi

    m = len(least)
    sign, log = np.linalg.slogdet(S)
    tell = (own >= 2 * (m + 2)) & (sign > 0)
    bias = psi((np.maximum(own, m)[:, None] - np.arange(m)) / 2).sum(axis=1) - m * np.log(own / 2)
    mean = (np.where(tell, log, 0.0) - bias - np.linalg.slogdet(least)[1]) / m
    return np.where(tell, np.exp(np.minimum(mean, 0.0)), 1.0)


class Scatter:
    """The laws of scatter of one series. An input wanders by itself, by all distances and whatever the weather: what
    the readings follow of it is the weather's already; few events show in it, so that its law is read once for all
    others."""

    def __init__(self, readings: Readings):
        self.readings = readings
        self._inputs: dict[tuple[int, bytes], Wander] = {}

    def without(self, known: np.ndarray, laws: Sequence[bool]) -> list[Wander]:
        """The laws with the events `known` (n, m) taken out of the readings: by all distances (True), and by that of
        neighbours alone (False)."""
        from scipy.linalg import block_diag

        readings = self.readings
        m = readings.z.shape[1] - readings.inputs
        own = _wandering(_rows(readings, slice(0, m), readings.weather), known[:, :m], laws)
        inputs = [self._of_input(k, known[:, k : k + 1]) for k in range(m, m + readings.inputs)]
        return [
            Wander(
                block_diag(*(part.W for part in parts)),
                np.concatenate([part.inverse for part in parts]),
                np.concatenate([part.c for part in parts]),
                sum(part.log for part in parts),
                sum(part.beside for part in parts),
                slow,
                readings.inputs,
            )
            for slow, parts in ((slow, [law, *inputs]) for slow, law in zip(laws, own, strict=True))
        ]

    def _of_input(self, k: int, known: np.ndarray) -> Wander:
        key = (k, known.tobytes())
        if key not in self._inputs:
            none = np.zeros((len(self.readings), 0))
            [self._inputs[key]] = _wandering(_rows(self.readings, slice(k, k + 1), none), known, [True])
        return self._inputs[key]


def _rows(readings: Readings, rows: slice, weather: np.ndarray) -> Readings:
    """Some of the readings, with the conditions that they follow."""
    return replace(
        readings,
        z=readings.z[:, rows],
        J=readings.J[:, rows],
        noise=readings.noise[rows, rows],
        weather=weather,
        inputs=0,
    )


def _wandering(readings: Readings, known: np.ndarray, laws: Sequence[bool]) -> list[Wander]:
    beside = _without_weather(readings.z - known, readings.weather)
    distances, C = structure(readings.clock, beside, readings.noise)
    return [_law(readings, known, distances, C, slow) for slow in laws]


def _law(readings: Readings, known: np.ndarray, distances: np.ndarray, C: np.ndarray, slow: bool) -> Wander:
    """One law of scatter from the structure functions C (h, m, m)."""
    from scipy.linalg import eigh
    from scipy.special import chdtri

    t = readings.clock
    _, W = eigh(C[-3:].mean(axis=0) if slow else C[0] + 1e-6 * np.diag(np.diag(C[0])), C[0])
    z, free = readings.z @ W, (readings.z - known) @ W
    apart = np.abs(t[:, None] - t)
    n, m = z.shape
    found = [_covariance(distances, W[:, k] @ C @ W[:, k], apart, slow) for k in range(m)]
    K, sizes = np.stack([covariance for covariance, _ in found]), sum(wanders for _, wanders in found)
    scale = np.maximum(np.var(free, axis=0), np.einsum("kii->k", K) / n)
    common = np.concatenate([np.ones((n, 1)) * np.sqrt(LEVEL), readings.weather], axis=1)
    common = scale[:, None, None] * (common @ common.T)
    inverse, logs = _inverse(K + common)
    c = np.einsum("kij,jk->ki", inverse, free)
    own = np.einsum("kii->ki", inverse)
    more = _locally(np.sum(c**2 / own, axis=0) / chdtri(m, 0.5)) if slow else np.ones(n)
    K = K * np.sqrt(more[:, None] * more) + common
    if np.any(more > 1):
        inverse, logs = _inverse(K)
        c = np.einsum("kij,jk->ki", inverse, free)
        own = np.einsum("kii->ki", inverse)
    beyond = chdtri(m, OUTLIER)
    alone = (free - _running_median(free)).T
    off = (np.sum(c**2 / own, axis=0) > beyond) & (np.sum(alone**2, axis=0) > beyond)
    if off.any():
        extra = np.where(off, np.minimum((c / own) ** 2, alone**2), 0.0)
        K[:, np.arange(n), np.arange(n)] += extra
        inverse, logs = _inverse(K)
        c = np.einsum("kij,jk->ki", inverse, free)
    log = n * float(np.linalg.slogdet(W)[1]) - float(logs.sum()) - 0.5 * float(np.log(n)) * sizes
    left = log - 0.5 * float(np.sum(c * free.T))
    c = np.einsum("kij,jk->ki", inverse, z)
    return Wander(W, inverse, c, log - 0.5 * float(np.sum(c * z.T)), left, slow)


def _locally(squares: np.ndarray) -> np.ndarray:
    """By how much the variance of an epoch (n,) is larger than by the law of the series, from squares of what is left
    of it, of median 1: an engine that is run in another way for a while wanders more in that time. Single epochs have
    no say, a law that is too wide somewhere stands."""
    n = len(squares)
    if n < 5 * LOCAL:
        return np.ones(n)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(squares, LOCAL // 2, mode="reflect"), LOCAL)
    return np.asarray(np.maximum(np.median(windows, axis=1), 1.0))


def _inverse(K: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse (k, n, n) of covariances, and half the logarithm of their determinants (k,)."""
    root = np.linalg.cholesky(K)
    return np.linalg.inv(K), np.log(np.einsum("kii->ki", root)).sum(axis=1)


def _covariance(distances: np.ndarray, value: np.ndarray, apart: np.ndarray, slow: bool) -> tuple[np.ndarray, bool]:
    """Covariance (n, n) of a mode whose structure function is `value` (h,) at these distances, and whether it wanders:
    what it wanders by is a size more that was read from the series, and costs what such a one does (Schwarz (1978))."""
    from scipy.optimize import nnls

    n = len(apart)
    if not slow:
        return np.asarray(value[0] * np.eye(n)), False
    if len(distances) < 2:  # of few epochs: that neighbours differ may be a walk as well as noise
        length = WALK * apart.max()
        size = value[0] / -np.expm1(-distances[0] / length)
        return np.asarray(WHITE * value[0] * np.eye(n) + (1 - WHITE) * size * np.exp(-apart / length)), False
    # up to the length of the series: what grows with distance as far as is seen may go on growing
    tau = distances[0] * 2.0 ** np.arange(1, np.ceil(np.log2(apart.max() / distances[0])) + 2)
    columns = np.concatenate([np.ones((len(distances), 1)), 1 - np.exp(-distances[:, None] / tau)], axis=1)
    x, _ = nnls(columns / value[:, None], np.ones(len(value)))
    K = max(x[0], WHITE * value[0]) * np.eye(n)
    for size, length in zip(x[1:], tau, strict=True):
        if size > 0:
            K += size * np.exp(-apart / length)
    return np.asarray(K), bool(np.any(x[1:] > 0))


def _running_median(z: np.ndarray) -> np.ndarray:
    """Of five epochs (n, m) each, or of those that there are."""
    padded = np.pad(z, ((2, 2), (0, 0)), mode="reflect") if len(z) > 2 else np.pad(z, ((2, 2), (0, 0)), mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, 5, axis=0), axis=-1))


def _without_weather(z: np.ndarray, weather: np.ndarray) -> np.ndarray:
    """What level and conditions leave of the readings (n, m)."""
    X = np.concatenate([np.ones((len(z), 1)), weather], axis=1)
    H = X.T @ X + np.diag([0.0, *np.ones(weather.shape[1])])
    return np.asarray(z - X @ np.linalg.solve(H, X.T @ z))
