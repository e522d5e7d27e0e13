"""Health over many flights: each flight's changes, and since when and how fast each parameter has been changing.

Everything is read from the statistics (s, F) of the flights, which are summed and never recomputed. With the law of
parameter a, g_a(i) = step or ramp from an onset τ_a to 1 at the last flight, the changes in flight i are

    Δθ_i = level + diag(g(i)) · change        level, change ~ N(0, P)

a linear model in (level, change), whose normal equations are Σ X_iᵀ s_i and Σ X_iᵀ F_i X_i: generalised least squares
on the flights' estimates F_i⁻¹ s_i with covariances F_i⁻¹. Laws and onsets are compared by marginal likelihood.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.progress import stage
from enginediag_cli.residuals.statistics import LocalStatistics

INCLUSION = 0.2
"""Probability beforehand that a parameter changes at all during the flights."""
MAX_SWEEPS = 50
"""Changes of law that the search makes at most. Each gains, so that it ends by itself after a few a parameter; a stop
for what should not happen."""
STEADY, STEP, RAMP = "steady", "step", "deterioration"


@dataclass(frozen=True)
class FlightChange:
    """Change of each parameter (p,) from nominal in one flight, with standard errors (p,), in parameter units.

    Posterior mean and deviation under a change of prior size: where a flight tells nothing, 0 ± prior.
    """

    parameters: tuple[str, ...]
    records: int
    change: np.ndarray
    standard_error: np.ndarray


@dataclass(frozen=True)
class Trend:
    """What one parameter has done. kind: steady, step or deterioration, the most probable; probability: that it
    changes at all. onset, onset_low, onset_high: number of the first changed flight, from 1, with its 95 % interval
    (for a deterioration, of the last unchanged). change: since the onset, up to the last flight; rate: per flight; both
    with standard error, in the parameter's unit, averaged over onsets and given that it changes."""

    parameter: str
    kind: str
    probability: float
    onset: int
    onset_low: int
    onset_high: int
    change: float
    change_error: float
    rate: float
    rate_error: float


@dataclass(frozen=True)
class TrendFit:
    """Trends of all parameters; `converged` is False when the search over laws and onsets did not settle."""

    trends: tuple[Trend, ...]
    converged: bool


def flight_change(statistics: LocalStatistics) -> FlightChange:
    """Changes in the flight(s) that the statistics stand for."""
    D = statistics.prior_sigma
    F, s = _effective(statistics)
    covariance = np.linalg.inv(np.eye(len(D)) + D[:, None] * F * D)
    return FlightChange(
        statistics.parameters, statistics.n, D * (covariance @ (D * s)), D * np.sqrt(np.diag(covariance))
    )


def _effective(statistics: LocalStatistics) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and score (p,) with the true covariance V of s: F V⁻¹ F and F V⁻¹ s."""
    if np.array_equal(statistics.F, statistics.V):
        return statistics.F, statistics.s
    from enginediag_cli.residuals.score import fisher_score

    score = fisher_score(statistics)
    return score.information, score.b


@dataclass(frozen=True)
class _Flights:
    """Scores (n, p) and information (n, p, p) of n flights in units of the prior standard deviations D (p,)."""

    parameters: tuple[str, ...]
    D: np.ndarray
    s: np.ndarray
    F: np.ndarray


@stage("fitting trends")
def fit_trends(flights: Sequence[LocalStatistics]) -> TrendFit:
    """Trends over flights in order of time. Needs three flights at least; ValueError otherwise."""
    if len(flights) < 3:
        raise ValueError("a trend needs at least three flights")
    D = flights[0].prior_sigma
    effective = [_effective(x) for x in flights]
    data = _Flights(
        flights[0].parameters,
        D,
        np.stack([D * s for _, s in effective]),
        np.stack([D[:, None] * F * D for F, _ in effective]),
    )
    laws = _laws(len(flights))
    chosen = np.zeros(len(D), int)  # index of the law of each parameter, 0 is steady
    converged = False
    for _ in range(MAX_SWEEPS):  # the one parameter whose new law gains most changes it; each step gains
        scores = np.stack([_log_posteriors(data, laws, chosen, a) for a in range(len(D))])
        gains = scores.max(axis=1) - scores[range(len(D)), chosen]
        a = int(np.argmax(gains))
        if gains[a] < 1e-6:
            converged = True
            break
        chosen[a] = int(np.argmax(scores[a]))
    return TrendFit(tuple(_trend(data, laws, chosen, a) for a in range(len(D))), converged)


@dataclass(frozen=True)
class _Laws:
    """g (L, n) of each law over the flights, its kind, its onset (index of a flight), and log probability before."""

    g: np.ndarray
    kind: tuple[str, ...]
    onset: np.ndarray
    log_prior: np.ndarray


def _laws(n: int) -> _Laws:
    i = np.arange(n)
    g, kind, onset = [np.zeros(n)], [STEADY], [0]
    for first in range(1, n):
        g.append((i >= first).astype(float))
        kind.append(STEP)
        onset.append(first)
    for last in range(n - 2):  # a ramp over one flight would be a step
        g.append(np.maximum(i - last, 0) / (n - 1 - last))
        kind.append(RAMP)
        onset.append(last)
    counts = {name: kind.count(name) for name in (STEP, RAMP)}
    prior = [1 - INCLUSION if k == STEADY else INCLUSION / 2 / counts[k] for k in kind]
    return _Laws(np.stack(g), tuple(kind), np.array(onset), np.log(prior))


def _equations(data: _Flights, G: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right side (2p,) and matrix (2p, 2p) of the posterior of (level, change), with g of each parameter G (p, n)."""
    p = len(data.D)
    F_lc = np.einsum("nab,bn->ab", data.F, G)
    H = np.block([[data.F.sum(axis=0), F_lc], [F_lc.T, np.einsum("nab,an,bn->ab", data.F, G, G)]]) + np.eye(2 * p)
    return np.concatenate([data.s.sum(axis=0), np.einsum("na,an->a", data.s, G)]), H


def _log_posteriors(data: _Flights, laws: _Laws, chosen: np.ndarray, a: int) -> np.ndarray:
    """log marginal likelihood plus log prior (L,) of each law of parameter a, the others keeping theirs.

    The law of a touches one row of the normal equations, so that the rest is solved once.
    """
    p = len(data.D)
    G = laws.g[chosen].copy()
    G[a] = 0.0
    r, H = _equations(data, G)
    others = np.delete(np.arange(2 * p), p + a)
    inner, right = H[np.ix_(others, others)], r[others]
    row = np.concatenate(  # cross product of the change of a with every other unknown, for each law
        [laws.g @ data.F[:, a, :], np.einsum("ln,nb,bn->lb", laws.g, data.F[:, a, :], G)[:, np.arange(p) != a]], axis=1
    )
    solved = np.linalg.solve(inner, np.column_stack([right, row.T]))
    S = 1 + laws.g**2 @ data.F[:, a, a] - np.einsum("lq,ql->l", row, solved[:, 1:])
    b = laws.g @ data.s[:, a] - row @ solved[:, 0]
    return np.asarray(-0.5 * np.log(S) + 0.5 * b**2 / S + laws.log_prior)


def _trend(data: _Flights, laws: _Laws, chosen: np.ndarray, a: int) -> Trend:
    p, n = len(data.D), data.s.shape[0]
    score = _log_posteriors(data, laws, chosen, a)
    weight = np.exp(score - score.max())
    weight /= weight.sum()
    best = int(np.argmax(weight))
    leading = laws.kind[best]
    shown = leading if leading != STEADY else RAMP
    mine = np.array([k == shown for k in laws.kind])
    given = np.where(mine, weight, 0.0)
    given = given / given.sum()
    means, variances = np.zeros(len(score)), np.zeros(len(score))
    for law in np.flatnonzero(given > 1e-4):
        G = laws.g[chosen].copy()
        G[a] = laws.g[law]
        r, H = _equations(data, G)
        covariance = np.linalg.inv(H)
        means[law], variances[law] = covariance[p + a] @ r, covariance[p + a, p + a]
    change, change_error = _mixture(given, means, variances, data.D[a])
    span = np.where(laws.onset < n - 1, n - 1.0 - laws.onset, 1.0)
    rate, rate_error = _mixture(given, means / span, variances / span**2, data.D[a])
    onset = int(np.argmax(given))
    low, high = _onset_interval(given, laws.onset)
    if shown == STEP:
        rate, rate_error = 0.0, 0.0
    return Trend(
        data.parameters[a],
        leading,
        float(1 - weight[0]),
        int(laws.onset[onset]) + 1,
        low + 1,
        high + 1,
        change,
        change_error,
        rate,
        rate_error,
    )


def _mixture(weight: np.ndarray, mean: np.ndarray, variance: np.ndarray, scale: float) -> tuple[float, float]:
    """Mean and standard deviation of a mixture of normals, in units of `scale`."""
    centre = float(weight @ mean)
    return scale * centre, scale * float(np.sqrt(weight @ (variance + (mean - centre) ** 2)))


def _onset_interval(weight: np.ndarray, onset: np.ndarray) -> tuple[int, int]:
    order = np.argsort(-weight, kind="stable")
    chosen = order[: int(np.searchsorted(np.cumsum(weight[order]), 0.95)) + 1]
    return int(onset[chosen].min()), int(onset[chosen].max())
