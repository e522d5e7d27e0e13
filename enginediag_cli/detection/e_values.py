"""The e-value of one engine over its flights, with level, scatter and its law in time unknown.

Rows z_i (m,) of n flights, readings minus prediction, are by the null hypothesis

    z_i = Bᵀ x_i + ε_i,    cov(ε_i, ε_j) = K_ij Σ,    B | Σ ~ N(0, Λ ⊗ Σ),    Σ ~ W⁻¹(Ψ, ν)

with x_i a level and functions of the conditions flown, and K one of a few laws in time (each flight by itself, or
wandering), which have prior probabilities too: level, errors that come with the operating point, offsets that change
from flight to flight and their size are integrated out, in both hypotheses alike. With L Lᵀ = K + X Λ Xᵀ the rows of
V = L⁻¹ Z are independent given Σ, L⁻¹ is causal, and the density of the first n rows is, up to what is common to all,

    p(Z_n) ∝ Π_i L_ii⁻ᵐ |A_n|^−(ν + n)/2,     A_n = Ψ + Σ_{i ≤ n} v_i v_iᵀ

(conjugate prior: A. P. Dawid, Biometrika 68 (1981) 265–274). A change of size δ along d (m,) with course g (n,) leaves
A_n + δ-terms of rank two: with h = L⁻¹ g, c = Σ h_i v_i, γ = Σ h_i², a = dᵀA⁻¹d, b = cᵀA⁻¹d, e = cᵀA⁻¹c

    p(Z_n | d, g, δ) / p(Z_n) = [(1 − δ b)² + δ² a (γ − e)]^−(ν + n)/2

and one in any direction, N(0, κ Σ):  (1 − κ e/(1 + κ γ))^−(ν + n)/2 (1 + κ γ)^−m/2. The mean over directions, sizes,
courses and onsets, all weighed beforehand, is a martingale of mean 1 under the null hypothesis: E at any stopping time
has mean 1 at most, over engines whose level and scatter are as the priors say (J. Ville (1939); A. Ramdas, P. Grünwald,
V. Vovk, G. Shafer, Statist. Sci. 38 (2023) 576–601).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STEPS = (0.25, 0.5, 1.0, 2.0)
"""Sizes of a sudden change, in the unit of its direction, either way: between two of them evidence is hardly lost."""
RAMPS = (0.0625, 0.125, 0.25, 0.5, 1.0)
"""Sizes that a growing change reaches in `RAMP` flights."""
RAMP = 30.0
"""Flights in which a growing change reaches its size: a unit, sizes span a hundredfold on either side."""
ANY = (0.25, 4.0)
"""Variances κ of a change in any direction, in units of the scatter of one flight."""
SINGLE = 2 / 3
"""Weight of changes of one suspect alone; the rest is for those in any direction."""
HORIZON = 60.0
"""Flights over which onsets have about the same weight; it falls as 1/j² beyond."""
AT_ONCE = 0.1
"""Weight of a change that was there with the first flight after the baseline."""
FINE_STEPS, FINE_RAMPS = 12, 4
"""Onsets lie one flight apart to begin with, and as far apart as a twelfth (a fourth) of the flights since later."""
LAWS = ((0.0, 1.0, 0.5), (0.3, 10.0, 0.25), (0.7, 30.0, 0.25))
"""Laws in time of what readings scatter by: share that wanders, flights over which it does, probability. Judgement: of
half of the engines flights scatter by themselves."""
LEVEL, CONDITIONS = 1e4, 1.0
"""Variance of a level, of which nothing is known, and of what a standardised condition adds, in units of the scatter:
errors of the model at an operating point are about as large as that."""
PEAKS = 25
"""Flights at which E is computed; at the others it stays as it was, which is a rule for stopping as any."""
ONE_FLIGHT = 1e-3
"""Chance of a flight, were it as the others, beyond which it counts for no more: one flight alone is no verdict."""


@dataclass(frozen=True)
class Suspects:
    """Directions (d, m) of unit changes in the readings, and the weight (d,) of each beforehand; they sum to 1."""

    directions: np.ndarray
    weights: np.ndarray


@dataclass(frozen=True)
class ScatterPrior:
    """Σ ~ W⁻¹((ν − m − 1) covariance, ν), of mean `covariance` (m, m)."""

    covariance: np.ndarray
    freedom: float

    @staticmethod
    def stated(noise: np.ndarray) -> ScatterPrior:
        """Of readings of which no more is known than the covariance of their noise: hardly a prior."""
        return ScatterPrior(noise, len(noise) + 3.0)


@dataclass(frozen=True)
class Rows:
    """The flights of one engine: z (n, m); conditions (n, c), standardised; weight (n,): square root of how much of a
    usual flight each one tells."""

    z: np.ndarray
    conditions: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class EPath:
    """log_e (n,): logarithm of E after each flight. Of the change, given that there is one: onset (n,), probability
    that it began with each flight; growing: that it grows; suspect (d,): that it is along each direction, the rest
    along none of them."""

    log_e: np.ndarray
    onset: np.ndarray
    growing: float
    suspect: np.ndarray


@dataclass(frozen=True)
class _Courses:
    g: np.ndarray
    onset: np.ndarray
    ramp: np.ndarray
    log_weight: np.ndarray


def onset_weight(j: np.ndarray) -> np.ndarray:
    """w_j of a change that begins with the j-th flight after the baseline, from 0; they sum to 1."""
    late = (1 - AT_ONCE) * HORIZON / ((j + HORIZON - 1.0) * (j + HORIZON))
    return np.where(j == 0, AT_ONCE, late)


def _ladder(n: int, fine: int) -> np.ndarray:
    """Onsets 0 … n − 1, ever farther apart."""
    found, j = [], 0
    while j < n:
        found.append(j)
        j += 1 + j // fine
    return np.array(found, int)


def _courses(n: int, baseline: int) -> _Courses:
    i = np.arange(n) - baseline
    parts = []
    for fine, ramp in ((FINE_STEPS, False), (FINE_RAMPS, True)):
        at = _ladder(max(n - baseline, 0), fine)
        after = i - at[:, None]
        g = np.clip(after + 1.0, 0.0, None) / RAMP if ramp else (after >= 0).astype(float)
        # each onset of the ladder has the weight of those up to the next one
        edges = np.append(at, n - baseline)
        total = np.concatenate([[0.0], np.cumsum(onset_weight(np.arange(max(n - baseline, 0), dtype=float)))])
        parts.append((g, at + baseline, np.full(len(at), ramp), 0.5 * np.diff(total[edges])))
    g, onset, ramp_, weight = (np.concatenate(x) for x in zip(*parts, strict=True))
    return _Courses(g, onset, ramp_, np.log(np.maximum(weight, 1e-300)))


def e_path(rows: Rows, suspects: Suspects, baseline: int, prior: ScatterPrior) -> EPath:
    """E of one engine of which nothing began in its first `baseline` flights. ValueError for readings that are not
    finite."""
    if not np.all(np.isfinite(rows.z)):
        raise ValueError("readings must be finite")
    n = len(rows.z)
    among = _courses(n, baseline)
    path, onset, suspect = np.zeros(n), np.zeros(n), np.zeros(len(suspects.weights))
    if not len(among.g):
        return EPath(path, onset, 0.0, suspect)
    peaks = np.unique(np.linspace(baseline, n - 1, PEAKS).round().astype(int))
    null, changed, along = [], [], []
    for share, length, chance in LAWS:
        whitened = _Whitened.of(rows, among, share, length)
        log_null, log_ratio, own = _ratios(_clipped(whitened, prior), among, suspects, prior, peaks)
        null.append(log_null + np.log(chance))
        changed.append(log_ratio + null[-1][:, None])
        along.append(own + null[-1][-1])
    of_null = np.logaddexp.reduce(null, axis=0)  # (peaks,)
    by_course = np.logaddexp.reduce(changed, axis=0) - of_null[:, None]  # (peaks, courses)
    spent = np.logaddexp.reduce(among.log_weight)
    rest = np.log(max(-np.expm1(min(spent, 0.0)), 1e-300))
    log_e = np.logaddexp(np.logaddexp.reduce(by_course, axis=1), rest)
    path[baseline:] = log_e[np.searchsorted(peaks, np.arange(baseline, n), side="right") - 1]
    total = np.logaddexp.reduce(by_course[-1])
    last = np.exp(by_course[-1] - total)
    np.add.at(onset, among.onset, last)
    suspect = np.exp(np.logaddexp.reduce(along, axis=0) - of_null[-1] - total)
    return EPath(path, onset, float(last[among.ramp].sum()), suspect)


@dataclass(frozen=True)
class _Whitened:
    """v (n, m) and h (G, n): readings and courses, of which each flight is new; log_scale (n,) = ln L_ii."""

    v: np.ndarray
    h: np.ndarray
    log_scale: np.ndarray

    @staticmethod
    def of(rows: Rows, among: _Courses, share: float, length: float) -> _Whitened:
        from scipy.linalg import solve_triangular

        n = len(rows.z)
        t = np.arange(n)
        K = (1 - share) * np.eye(n) + share * np.exp(-np.abs(t[:, None] - t) / length)
        K += LEVEL + CONDITIONS * rows.conditions @ rows.conditions.T
        L = np.linalg.cholesky(K * rows.weight * rows.weight[:, None])
        right = np.concatenate([rows.z, among.g.T], axis=1) * rows.weight[:, None]
        solved = solve_triangular(L, right, lower=True, check_finite=False)
        m = rows.z.shape[1]
        return _Whitened(solved[:, :m], solved[:, m:].T, np.log(np.diag(L)))


def _clipped(w: _Whitened, prior: ScatterPrior) -> _Whitened:
    """Flights that are off by more than others, by a chance below ONE_FLIGHT, drawn in to that."""
    from scipy.special import fdtri

    n, m = w.v.shape
    before = _inverse(w.v, prior)[:-1]
    freedom = prior.freedom + np.arange(n) - m + 1.0
    square = np.einsum("nm,nmk,nk->n", w.v, before, w.v) * freedom / m
    most = fdtri(m, freedom, 1 - ONE_FLIGHT)
    return _Whitened(w.v * np.minimum(1.0, np.sqrt(most / np.maximum(square, 1e-300)))[:, None], w.h, w.log_scale)


def _inverse(v: np.ndarray, prior: ScatterPrior) -> np.ndarray:
    """A⁻¹ (n + 1, m, m) after none and after each of the rows v (n, m)."""
    m = v.shape[1]
    begin = (prior.freedom - m - 1) * prior.covariance
    sums = np.cumsum(v[:, :, None] * v[:, None, :], axis=0)
    return np.asarray(np.linalg.inv(begin + np.concatenate([np.zeros((1, m, m)), sums])))


def _ratios(
    w: _Whitened, among: _Courses, suspects: Suspects, prior: ScatterPrior, peaks: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """log p(Z) (k,) under no change, up to what is common to all laws; log ratio (k, G) of each course, its weight in
    it, after the flights `peaks` (k,); the same (d,) of each direction at the last of them."""
    m = w.v.shape[1]
    inverse = _inverse(w.v, prior)[peaks + 1]
    power = 0.5 * (prior.freedom + peaks + 1.0)
    log_null = power * np.linalg.slogdet(inverse)[1] - m * np.cumsum(w.log_scale)[peaks]
    a = np.einsum("dm,kmj,dj->kd", suspects.directions, inverse, suspects.directions)
    sums = np.cumsum(w.h[:, :, None] * w.v, axis=1)
    squares = np.cumsum(w.h**2, axis=1)
    found = np.zeros((len(w.h), len(peaks)))  # of a course that has not begun: 1
    own = np.full(len(suspects.weights), -np.inf)
    for ramp, sizes in ((False, STEPS), (True, RAMPS)):
        g, k = np.nonzero((among.onset[:, None] <= peaks) & (among.ramp == ramp)[:, None])
        c, gamma = sums[g, peaks[k]], squares[g, peaks[k]]
        told = np.matmul(c[:, None, :], inverse[k])[:, 0]
        e = np.sum(told * c, axis=1)
        b = told @ suspects.directions.T
        mean, most = _along_suspects(a[k], b, gamma - e, power[k], sizes)
        one = np.log(mean @ suspects.weights) + most + np.log(SINGLE)
        found[g, k] = np.logaddexp(one, _anywhere(e, gamma, power[k], m) + np.log1p(-SINGLE))
        last = k == len(peaks) - 1
        with np.errstate(divide="ignore"):
            each = np.log(mean[last] * suspects.weights) + (most[last] + among.log_weight[g[last]])[:, None]
        own = np.logaddexp(own, np.logaddexp.reduce(each, axis=0) + np.log(SINGLE))
    return log_null, (found + among.log_weight[:, None]).T, own


def _along_suspects(
    a: np.ndarray, b: np.ndarray, left: np.ndarray, power: np.ndarray, sizes: tuple[float, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Mean ratio (k, d) over sizes of a change along each direction, over exp of most (k,); a, b (k, d)."""
    square = b**2 + a * left[:, None]
    signed = [*sizes, *(-s for s in sizes)]
    logs = np.empty((len(signed), *b.shape))
    for log, size in zip(logs, signed, strict=True):
        np.log((1 - 2 * size * b) + size**2 * square, out=log)
    logs *= -power[:, None]
    most = logs.max(axis=(0, 2))
    logs -= most[:, None]
    return np.exp(logs, out=logs).sum(axis=0) / len(signed), most


def _anywhere(e: np.ndarray, gamma: np.ndarray, power: np.ndarray, m: int) -> np.ndarray:
    """log mean ratio (k,) of a change in any direction."""
    parts = [-power * np.log1p(-k * e / (1 + k * gamma)) - 0.5 * m * np.log1p(k * gamma) for k in ANY]
    return np.asarray(np.logaddexp.reduce(parts, axis=0) - np.log(len(ANY)))
