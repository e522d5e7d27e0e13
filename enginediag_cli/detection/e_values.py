"""The e-value of one engine over its flights, with level, scatter and its law in time unknown.

Rows z_i (m,) of n flights, readings minus prediction, are by the null hypothesis

    z_i = Bᵀ x_i + ε_i,    cov(ε_i, ε_j) = K_ij Σ

with x_i a level and functions of the conditions flown, of coefficients N(0, λ Σ), and K one of a few laws in time: each
flight by itself, or wandering. Level, errors that come with the operating point, offsets that change from flight to
flight, how large they are and how they go together are nuisance of both hypotheses. With L Lᵀ = K + X λ Xᵀ the rows of
V = L⁻¹ Z are independent given Σ, and L⁻¹ is causal. With h = L⁻¹ g for a course g (n,) of a change, and sums over the
first n flights

    A = Σ v vᵀ,   c = Σ h v,   γ = Σ h²,   a = dᵀA⁻¹d,   b = cᵀA⁻¹d,   γ_d = γ − cᵀA⁻¹c + b²/a

a change along d (m,) is the regression of what sees it on all that does not, and, δ ~ N(0, κ σ²) with σ the scatter of
that residual, the ratio of the densities of its invariants, which know neither Σ nor B, is

    L_d = (1 + κ γ_d)^−½ [1 − κ b²/(a (1 + κ γ_d))]^−(n − m)/2

(right Haar prior of σ: J. O. Berger, L. R. Pericchi, J. A. Varshavsky, Sankhyā A 60 (1998) 307–321). One in any
direction, N(0, κ Σ), is the product of such ratios of each reading regressed on those before it. When nothing changes L
has mean 1 exactly, for every B and Σ (M. F. Pérez-Ortiz, T. Lardy, R. de Heide, P. D. Grünwald, Ann. Statist. 52 (2024)
1410–1432), and so has the mean E over directions, sizes, courses and onsets, all weighed beforehand, given the law in
time; laws are averaged with the weights that the flights give them under the null hypothesis.

A wide proper prior of Σ, W⁻¹(Σ₀, m + 3), will not do in its place: E then has mean 1 over the engines of that prior,
and more for those that scatter as its mean does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIZES = (0.04, 0.4, 4.0, 40.0)
"""Variances κ of a change along one direction, in units of the scatter of one flight: from a fifth to six times."""
ANY = (0.04, 0.4)
"""The same of a change in any direction, which is the sum of as many as there are readings."""
RAMP = 30.0
"""Flights in which a growing change reaches its size: a unit, sizes span a hundredfold."""
SINGLE = 2 / 3
"""Weight of changes of one suspect alone; the rest is for those in any direction."""
HORIZON = 60.0
"""Flights over which onsets have about the same weight; it falls as 1/j² beyond."""
AT_ONCE = 0.1
"""Weight of a change that was there with the first flight after the baseline."""
FINE_STEPS, FINE_RAMPS = 12, 4
"""Onsets lie one flight apart to begin with, and as far apart as a twelfth (a fourth) of the flights since later."""
LAWS = ((0.0, 1.0, 0.4), (0.05, 30.0, 0.2), (0.2, 20.0, 0.2), (0.5, 20.0, 0.2))
"""Laws in time of what readings scatter by: share that wanders, flights over which it does, probability. The finer
they are the fewer engines are called changed whose instruments only wander, and faults pay for it with a part of the
logarithm of E; what is left of it: `tests/benchmarks/fleet_discoveries.py --wander 0.6`."""
LEVEL, CONDITIONS = 1e6, 1.0
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
    """What other engines scatter by from flight to flight, covariance (m, m), counted as so many flights."""

    covariance: np.ndarray
    flights: float


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


def _courses(n: int, baseline: int, fine_steps: int = FINE_STEPS, fine_ramps: int = FINE_RAMPS) -> _Courses:
    i = np.arange(n) - baseline
    parts = []
    for fine, ramp in ((fine_steps, False), (fine_ramps, True)):
        at = _ladder(max(n - baseline, 0), fine)
        after = i - at[:, None]
        g = np.clip(after + 1.0, 0.0, None) / RAMP if ramp else (after >= 0).astype(float)
        # each onset of the ladder has the weight of those up to the next one
        edges = np.append(at, n - baseline)
        total = np.concatenate([[0.0], np.cumsum(onset_weight(np.arange(max(n - baseline, 0), dtype=float)))])
        parts.append((g, at + baseline, np.full(len(at), ramp), 0.5 * np.diff(total[edges])))
    g, onset, ramp_, weight = (np.concatenate(x) for x in zip(*parts, strict=True))
    return _Courses(g, onset, ramp_, np.log(np.maximum(weight, 1e-300)))


def e_path(rows: Rows, suspects: Suspects, baseline: int, prior: ScatterPrior | None = None) -> EPath:
    """E of one engine of which nothing began in its first `baseline` flights. It is 1 until two flights more are known
    than there are readings, those of the prior counted. ValueError for readings that are not finite."""
    if not np.all(np.isfinite(rows.z)):
        raise ValueError("readings must be finite")
    n, m = rows.z.shape
    among = _courses(n, baseline)
    path, onset, suspect = np.zeros(n), np.zeros(n), np.zeros(len(suspects.weights))
    enough = m + 1 - (0 if prior is None else int(prior.flights))
    first = max(baseline, enough)
    if first >= n:
        return EPath(path, onset, 0.0, suspect)
    peaks = np.unique(np.linspace(first, n - 1, PEAKS).round().astype(int))
    null, changed, along = [], [], []
    for share, length, chance in LAWS:
        whitened = _Whitened.of(rows, among, share, length)
        log_null, log_ratio, own = _ratios(_clipped(whitened, prior), among, suspects, prior, peaks)
        null.append(log_null + np.log(chance))
        changed.append(log_ratio + null[-1][:, None])
        along.append(own + null[-1][-1])
    of_null = np.logaddexp.reduce(null, axis=0)  # (peaks,)
    by_course = np.logaddexp.reduce(changed, axis=0) - of_null[:, None]  # (peaks, courses)
    rest = np.log(max(-np.expm1(min(np.logaddexp.reduce(among.log_weight), 0.0)), 1e-300))
    log_e = np.logaddexp(np.logaddexp.reduce(by_course, axis=1), rest)
    path[first:] = log_e[np.searchsorted(peaks, np.arange(first, n), side="right") - 1]
    total = np.logaddexp.reduce(by_course[-1])
    last = np.exp(by_course[-1] - total)
    np.add.at(onset, among.onset, last)
    suspect = np.exp(np.logaddexp.reduce(along, axis=0) - of_null[-1] - total)
    return EPath(path, onset, float(last[among.ramp].sum()), suspect)


def onset_law(rows: Rows, suspects: Suspects, baseline: int) -> np.ndarray:
    """Probability (n,) that the change began with each flight, given that there is one, looked at flight by flight."""
    n, m = rows.z.shape
    if n <= max(baseline, m + 1):
        return np.zeros(n)
    among, last = _courses(n, baseline, n, n), np.array([n - 1])
    logs = []
    for share, length, chance in LAWS:
        log_null, log_ratio, _ = _ratios(_Whitened.of(rows, among, share, length), among, suspects, None, last)
        logs.append(log_ratio[0] + log_null[0] + np.log(chance))
    log = np.logaddexp.reduce(logs, axis=0)
    found = np.zeros(n)
    np.add.at(found, among.onset, np.exp(log - np.logaddexp.reduce(log)))
    return found


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


def _clipped(w: _Whitened, prior: ScatterPrior | None) -> _Whitened:
    """Flights that are off by more than others, by a chance below ONE_FLIGHT, drawn in to that."""
    from scipy.special import fdtri

    n, m = w.v.shape
    freedom = np.arange(n) - m + (0.0 if prior is None else prior.flights)
    at = np.flatnonzero(freedom >= 1)
    inverse = np.linalg.inv(_sums(w.v, prior)[at])
    square = np.einsum("nm,nmk,nk->n", w.v[at], inverse, w.v[at]) * freedom[at] / m
    share = np.ones(n)
    share[at] = np.minimum(1.0, np.sqrt(fdtri(m, freedom[at], 1 - ONE_FLIGHT) / np.maximum(square, 1e-300)))
    return _Whitened(w.v * share[:, None], w.h, w.log_scale)


def _sums(v: np.ndarray, prior: ScatterPrior | None) -> np.ndarray:
    """A (n + 1, m, m) after none and after each of the rows v (n, m)."""
    m = v.shape[1]
    begin = np.zeros((m, m)) if prior is None else prior.flights * prior.covariance
    sums = np.cumsum(v[:, :, None] * v[:, None, :], axis=0)
    return np.asarray(begin + np.concatenate([np.zeros((1, m, m)), sums]))


def _ratios(
    w: _Whitened, among: _Courses, suspects: Suspects, prior: ScatterPrior | None, peaks: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """log p(Z) (k,) under no change, up to what is common to all laws; log ratio (k, G) of each course, its weight in
    it, after the flights `peaks` (k,); the same (d,) of each direction at the last of them."""
    m = w.v.shape[1]
    A = _sums(w.v, prior)[peaks + 1]
    flights = peaks + 1.0 + (0.0 if prior is None else prior.flights)
    inverse, root = np.linalg.inv(A), np.linalg.inv(np.linalg.cholesky(A))
    log_null = -0.5 * (flights - 1) * np.linalg.slogdet(A)[1] - m * np.cumsum(w.log_scale)[peaks]
    a = np.einsum("dm,kmj,dj->kd", suspects.directions, inverse, suspects.directions)
    sums = np.cumsum(w.h[:, :, None] * w.v, axis=1)
    squares = np.cumsum(w.h**2, axis=1)
    found = np.zeros((len(w.h), len(peaks)))  # of a course that has not begun: 1
    g, k = np.nonzero(among.onset[:, None] <= peaks)
    c, gamma, n = sums[g, peaks[k]], squares[g, peaks[k]], flights[k]
    told = np.matmul(root[k], c[:, :, None])[:, :, 0]
    b = np.matmul(c[:, None, :], inverse[k])[:, 0] @ suspects.directions.T
    explained = b**2 / a[k]
    left = np.maximum((gamma - np.sum(told**2, axis=1))[:, None] + explained, 1e-300)
    mean, most = _along_suspects(explained, left, 0.5 * (n - m))
    one = np.log(mean @ suspects.weights) + most + np.log(SINGLE)
    found[g, k] = np.logaddexp(one, _anywhere(told, gamma, n) + np.log1p(-SINGLE))
    last = k == len(peaks) - 1
    with np.errstate(divide="ignore"):
        each = np.log(mean[last] * suspects.weights) + (most[last] + among.log_weight[g[last]])[:, None]
    own = np.logaddexp.reduce(each, axis=0) + np.log(SINGLE)
    return log_null, (found + among.log_weight[:, None]).T, own


def _along_suspects(explained: np.ndarray, left: np.ndarray, power: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Mean L_d (k, d) over sizes, over exp of most (k,); explained b²/a and left γ_d (k, d); power (n − m)/2 (k,)."""
    logs = np.empty((len(SIZES), *left.shape))
    for log, kappa in zip(logs, SIZES, strict=True):
        wide = 1 + kappa * left
        np.log(1 - kappa * explained / wide, out=log)
        log *= -power[:, None]
        log -= 0.5 * np.log(wide)
    most = logs.max(axis=(0, 2))
    logs -= most[:, None]
    return np.exp(logs, out=logs).sum(axis=0) / len(SIZES), most


def _anywhere(told: np.ndarray, gamma: np.ndarray, flights: np.ndarray) -> np.ndarray:
    """log mean ratio (k,) of a change in any direction: of each reading regressed on those before it, told (k, m) =
    R c with R the inverse of the Cholesky factor of A."""
    square = told**2
    left = np.maximum(gamma[:, None] - np.cumsum(square, axis=1) + square, 1e-300)
    power = 0.5 * (flights[:, None] - np.arange(1, told.shape[1] + 1))
    parts = []
    for kappa in ANY:
        wide = 1 + kappa * left
        parts.append(np.sum(-power * np.log(1 - kappa * square / wide) - 0.5 * np.log(wide), axis=1))
    return np.asarray(np.logaddexp.reduce(parts, axis=0) - np.log(len(ANY)))
