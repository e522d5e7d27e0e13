"""Scatter between flights: how readings of a series wander by more than their noise, and scores of changes by it.

Readings minus prediction z (n, m) of n epochs are a level, a smooth function of the conditions flown (`weather`), a
process that wanders and noise. Its size is read from differences of epochs, by their distance in time: half of the mean
square of a difference, of all pairs of readings, is the structure function (Matheron's variogram). A step in one
reading is in few of these differences, and in none of them at most once, so that it is not learnt as scatter; a
tenth of the series is the longest distance, beyond which a step would be in too many.

The structure functions of the shortest and of the longest distance have common modes W (generalised eigenvectors),
each a scalar series with the covariance Σ_j x_j exp(−|t − t'|/τ_j). Epochs that are off alone, against what is before
and after them, count as much as their own scatter allows.

Scores and information of all courses and onsets at once. In each mode k of `wander` the series is z_k = level + Σ_e
g_e(i) A_ki δ_e + scatter, A_ki (p,) the effect of each parameter. A change with course g has the score b = Σ_i g(i)
A_kiᵀ c_k(i) and the information S = Σ_ij g(i) A_kiᵀ K_k⁻¹(i,j) A_kj g(j); for steps both are cumulative sums from the
end.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.detection.series import Readings

DISTANCES = 12
"""Classes of distance, each twice as long as the one before: from neighbours to a tenth of the longest series."""
LONGEST = 0.1
"""Longest distance of differences, in lengths of the series."""
SHORT, OF_SHORT = 16, 0.4
"""Distance in epochs up to which a short series is looked at all the same, and the longest such in lengths of it: a
tenth of forty epochs does not separate a random walk from wear."""
PAIRS = 8
"""Differences of one epoch with later ones in a class: all of them say the same."""
LEAST_PAIRS = 20
"""Differences that a class needs; with fewer the neighbouring classes are more precise."""
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
series of five times as many separates them."""
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
    log_without_events: float
    slow: bool
    inputs: int = 0


def structure_functions(clock: np.ndarray, z: np.ndarray, least: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
    most: the determinant without its bias (Anderson (2003), theorem 7.5.3). 1 with too few differences."""
    from scipy.special import psi

    m = len(least)
    sign, log = np.linalg.slogdet(S)
    tell = (own >= 2 * (m + 2)) & (sign > 0)
    bias = psi((np.maximum(own, m)[:, None] - np.arange(m)) / 2).sum(axis=1) - m * np.log(own / 2)
    mean = (np.where(tell, log, 0.0) - bias - np.linalg.slogdet(least)[1]) / m
    return np.where(tell, np.exp(np.minimum(mean, 0.0)), 1.0)


class ScatterLaws:
    """The laws of scatter of one series. An input wanders by itself, by all distances and whatever the weather: what
    the readings follow of it is the weather's already; few events show in it, so that its law is read once for all
    others."""

    def __init__(self, readings: Readings):
        self.readings = readings
        self._inputs: dict[tuple[int, bytes], Wander] = {}

    def estimate(self, known: np.ndarray, laws: Sequence[bool]) -> list[Wander]:
        """The laws with the events `known` (n, m) taken out of the readings: by all distances (True), and by that of
        neighbours alone (False)."""
        from scipy.linalg import block_diag

        readings = self.readings
        m = readings.z.shape[1] - readings.inputs
        own = _wander_laws(_select_readings(readings, slice(0, m), readings.weather), known[:, :m], laws)
        inputs = [self._input_law(k, known[:, k : k + 1]) for k in range(m, m + readings.inputs)]
        return [
            Wander(
                block_diag(*(part.W for part in parts)),
                np.concatenate([part.inverse for part in parts]),
                np.concatenate([part.c for part in parts]),
                sum(part.log for part in parts),
                sum(part.log_without_events for part in parts),
                slow,
                readings.inputs,
            )
            for slow, parts in ((slow, [law, *inputs]) for slow, law in zip(laws, own, strict=True))
        ]

    def _input_law(self, k: int, known: np.ndarray) -> Wander:
        key = (k, known.tobytes())
        if key not in self._inputs:
            none = np.zeros((len(self.readings), 0))
            [self._inputs[key]] = _wander_laws(_select_readings(self.readings, slice(k, k + 1), none), known, [True])
        return self._inputs[key]


def _select_readings(readings: Readings, rows: slice, weather: np.ndarray) -> Readings:
    """Some of the readings, with the conditions that they follow."""
    return replace(
        readings,
        z=readings.z[:, rows],
        J=readings.J[:, rows],
        noise=readings.noise[rows, rows],
        weather=weather,
        inputs=0,
    )


def _wander_laws(readings: Readings, known: np.ndarray, laws: Sequence[bool]) -> list[Wander]:
    beside = _remove_weather(readings.z - known, readings.weather)
    distances, C = structure_functions(readings.clock, beside, readings.noise)
    return [_scatter_law(readings, known, distances, C, slow) for slow in laws]


def _scatter_law(readings: Readings, known: np.ndarray, distances: np.ndarray, C: np.ndarray, slow: bool) -> Wander:
    """One law of scatter from the structure functions C (h, m, m)."""
    from scipy.linalg import eigh
    from scipy.special import chdtri

    t = readings.clock
    # with one distance any basis solves this, and rounding would choose among them: that of the readings is taken
    _, W = eigh(C[-3:].mean(axis=0) if slow and len(C) > 1 else C[0] + 1e-6 * np.diag(np.diag(C[0])), C[0])
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
    more = _local_inflation(np.sum(c**2 / own, axis=0) / chdtri(m, 0.5)) if slow else np.ones(n)
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


def _local_inflation(squares: np.ndarray) -> np.ndarray:
    """By how much the variance of an epoch (n,) is larger than by the law of the series, from squares of its residuals,
    of median 1: an engine that is run in another way for a while wanders more in that time. Single epochs have no say,
    a law that is too wide somewhere stands."""
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


def _remove_weather(z: np.ndarray, weather: np.ndarray) -> np.ndarray:
    """What level and conditions leave of the readings (n, m)."""
    X = np.concatenate([np.ones((len(z), 1)), weather], axis=1)
    H = X.T @ X + np.diag([0.0, *np.ones(weather.shape[1])])
    return np.asarray(z - X @ np.linalg.solve(H, X.T @ z))


STEP, DETERIORATION = "step", "deterioration"
"""At once and for good; growing since its onset."""
ONSETS = 32
"""Onsets of growth that are looked at: it begins slowly, so that its beginning is not known more finely."""
POWERS = (1.0, 2.0, 4.0)
"""Growth with this power of the time since its onset: even, as fouling; ever faster, as wear before a failure."""


@dataclass(frozen=True)
class Courses:
    """L courses: g (L, n) over the epochs, 1 at the last; growing (L,); onset (L,): the first changed epoch, for a
    growing one the last unchanged."""

    g: np.ndarray
    growing: np.ndarray
    onset: np.ndarray

    def laws(self, k: int) -> np.ndarray:
        """Courses (l, n) of the kind and onset of that at k: of growth with every power."""
        return self.g[(self.onset == self.onset[k]) & (self.growing == self.growing[k])]


def candidate_courses(clock: np.ndarray, earliest: int = 0) -> Courses:
    """Steps at every epoch after the first `earliest`, and growths over two epochs at least, for one over a single
    epoch would be a step."""
    n = len(clock)
    earliest = min(earliest, n - 1)
    at = np.arange(max(earliest, 1), n)
    steps = (np.arange(n) >= at[:, None]).astype(float)
    last = np.zeros(0, int)
    if n > earliest + 2:
        last = np.unique(np.linspace(max(earliest - 1, 0), n - 3, ONSETS).round().astype(int))
    even = np.clip((clock - clock[last][:, None]) / (clock[-1] - clock[last])[:, None], 0.0, None)
    grown = [even**power for power in POWERS]
    growing = np.repeat([False, True], [len(steps), len(POWERS) * len(last)])
    return Courses(np.concatenate([steps, *grown]), growing, np.concatenate([at, *[last] * len(POWERS)]))


@dataclass(frozen=True)
class ScoreTable:
    """Scores b (L, k, p + 1) and information S (L, k, P), of those pairs of parameters that `at` (p + 1, p + 1) has a
    place for, of every course in every mode of one law of scatter. The last parameter is a change of that mode alone by
    one; effect (k, n, p + 1)."""

    wander: Wander
    effect: np.ndarray
    b: np.ndarray
    S: np.ndarray
    places: np.ndarray

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """First and second parameter (P,) of each pair."""
        return parameter_pairs(self.places)


def parameter_pairs(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second parameter (P,) of each pair, in their order."""
    i, j = np.nonzero(np.triu(at >= 0))
    order = np.argsort(at[i, j])
    return i[order], j[order]


def pair_places(together: np.ndarray) -> np.ndarray:
    """Place (p + 1, p + 1) of every pair of parameters that is needed, and of a change of a mode alone; −1 for the
    others. together (p, p) bool."""
    p = len(together)
    at = np.full((p + 1, p + 1), -1)
    i, j = np.nonzero(np.triu(together))
    i, j = np.append(i, p), np.append(j, p)
    at[i, j] = at[j, i] = np.arange(len(i))
    return at


def score_table(readings: Readings, wander: Wander, among: Courses, at: np.ndarray) -> ScoreTable:
    """at: places of the pairs of parameters of which the information is needed."""
    effect = np.einsum("amp,mk->kap", readings.J, wander.W)
    effect = np.concatenate([effect, np.ones((*effect.shape[:2], 1))], axis=2)
    first, second = parameter_pairs(at)
    L, m, n = len(among.g), len(effect), effect.shape[1]
    b, S = np.empty((L, m, effect.shape[2])), np.zeros((L, m, len(first)))
    steps = ~among.growing
    onset, grown = among.onset[steps], among.g[~steps]
    one, of = np.triu(np.ones((n, n))), np.arange(len(first))
    for k in range(m):
        A, inverse = effect[k], wander.inverse[k]
        b[:, k] = course_sums(A * wander.c[k][:, None], among)
        told = of[A[:, first].any(axis=0) & A[:, second].any(axis=0)]
        i, j = first[told], second[told]
        # sum over i, j ≥ τ of one parameter with another: what τ adds is its row and its column from τ on
        later = inverse * one
        row, column = later @ A, later @ A - np.diag(inverse)[:, None] * A
        upper = A[:, i] * row[:, j] + A[:, j] * column[:, i]
        of_steps = np.cumsum(upper[::-1], axis=0)[::-1][onset]
        S[np.flatnonzero(steps)[:, None], k, told] = of_steps
        if len(grown):
            moved = grown[:, :, None] * A  # (l, n, p)
            held = np.matmul(inverse, moved)
            both = np.einsum("lnq,lnq->lq", moved[:, :, i], held[:, :, j])
            S[np.flatnonzero(~steps)[:, None], k, told] = both
    return ScoreTable(wander, effect, b, S, at)


def course_sums(values: np.ndarray, among: Courses) -> np.ndarray:
    """Σ_i g(i) values(i) (L, …) of every course, values (n, …)."""
    found = np.empty((len(among.g), *values.shape[1:]))
    steps = ~among.growing
    found[steps] = np.cumsum(values[::-1], axis=0)[::-1][among.onset[steps]]
    found[~steps] = np.tensordot(among.g[~steps], values, 1)
    return found
