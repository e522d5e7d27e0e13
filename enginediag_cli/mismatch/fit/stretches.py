"""How well a sum over records is known where records are not independent: by stretches of them that nearly are.

An estimate β solves Σ_r u_r(β) = 0 with the information S = Σ_r s_r, priors' added. Whatever the readings' errors are
like, as long as stretches b of a recording are independent of each other,

    var β = S⁻¹ (Σ_b ũ_b ũ_bᵀ) S⁻¹      ũ_b = Σ_{r in b} u_r / (1 − h_b)      h_b = tr(s_b S⁻¹)/k

A stretch is LENGTHS integrated correlation times τ = 1 + 2 Σ_k ρ_k of the u_r long, or a whole recording where that is
shorter: what a model leaves in a row of records counts as one thing, and what it leaves in a whole flight, too.

Sources: K.-Y. Liang and S. L. Zeger, Biometrika 73 (1986) 13–22 (sums by independent groups); J. G. MacKinnon and
H. White, J. Econometrics 29 (1985) 305–325 (the divisor, for groups that decide much themselves); A. Sokal, "Monte
Carlo Methods in Statistical Mechanics" (Cargèse lectures, 1996), section 3 (where to end the sum of correlations);
L. Kish, "Survey Sampling" (1965), section 11.7 (effective number).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LENGTHS = 3.0
"""Correlation times of a stretch: sums of neighbours then share less than a fifth of their variance."""
WINDOW = 5.0
"""Correlation times over which correlations are summed (Sokal)."""
LARGEST_SHARE = 0.99
"""Of the information that one stretch is taken to hold at most; beyond it nothing else could tell its error."""
TINY = 1e-300
"""Instead of 0 below a fraction."""


@dataclass(frozen=True)
class Stretches:
    """`covariance` (k, k) of the estimate; `effective`: as many stretches of equal weight would tell as much; `count`
    of those that tell anything, and the `length` of one in records."""

    covariance: np.ndarray
    effective: float
    count: int
    length: int


def by_stretches(scores: np.ndarray, information: np.ndarray, S: np.ndarray, recording: np.ndarray) -> Stretches:
    """Of scores (N, k) at the estimate and information (N, k, k), N > 0 records of recordings (N,) in order, and all
    information S (k, k)."""
    k = scores.shape[1]
    length = max(1, int(np.ceil(LENGTHS * correlation_time(scores, S, recording))))
    stretch = cut(recording, length)
    u, s = np.zeros((stretch[-1] + 1, k)), np.zeros((stretch[-1] + 1, k, k))
    np.add.at(u, stretch, scores)
    np.add.at(s, stretch, information)
    share = np.trace(s @ np.linalg.inv(S), axis1=1, axis2=2) / k
    half = np.linalg.solve(S, (u / (1.0 - np.minimum(share, LARGEST_SHARE))[:, None]).T)
    effective = float(share.sum() ** 2 / max(np.sum(share**2), TINY))
    return Stretches(half @ half.T, effective, int(np.sum(share > 0.0)), length)


def correlation_time(scores: np.ndarray, S: np.ndarray, recording: np.ndarray) -> float:
    """τ ≥ 1 of scores (N, k), in records, all directions weighed by the information S (k, k) alike."""
    v = np.linalg.solve(np.linalg.cholesky(S), scores.T).T
    own = float(np.sum(v**2))
    tau, longest = 1.0, int(np.bincount(recording).max())
    if own == 0.0:
        return tau
    for lag in range(1, longest):
        if lag > WINDOW * tau:
            break
        same = recording[lag:] == recording[:-lag]
        tau += 2.0 * float(np.sum((v[lag:] * v[:-lag])[same])) / own
        tau = max(tau, 1.0)
    return tau


def cut(recording: np.ndarray, length: int) -> np.ndarray:
    """Number of the stretch of each record (N,): recordings (N,) in order, cut into equal parts of at least `length`
    records where they are as long."""
    found = np.zeros(len(recording), int)
    first = 0
    for r in dict.fromkeys(recording.tolist()):
        rows = np.flatnonzero(recording == r)
        parts = max(1, len(rows) // length)
        found[rows] = first + np.arange(len(rows)) * parts // len(rows)
        first += parts
    return found
