"""Covariance of a sum of primary residuals when the noise of a sensor remembers its past (AR(1)).

    V = Σ_j σ_j² Σ_k Σ_l ρ_j^|k−l| g_kj g_ljᵀ      with g_kj = the row of whitened sensitivities

The double sum is one pass with the recursion a_k = c_k a_{k−1} + g_k, c_k = ρ^(steps since record k−1): it is

    Σ_k a_k a_kᵀ − Σ_k c_k² a_{k−1} a_{k−1}ᵀ = Σ_k h_k h_kᵀ,    h_k = √(1 − c_{k+1}²) a_k, c = 0 after the last record.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FORGOTTEN = 1e-14
"""Correlation below which the past no longer counts."""


@dataclass(frozen=True)
class LaggedSums:
    """`factors` (m, N, p): h_k of each sensor, inside the block of each record.

    Per block (B, ...): `tail` (m, p) = a at its last record; `head` (m, p) = Σ_k g_k times the correlation of
    record k with the record before the block; `decay` (m,) = correlation of last record and that record.
    """

    factors: np.ndarray
    tail: np.ndarray
    head: np.ndarray
    decay: np.ndarray


def linear_recursion(c: np.ndarray, g: np.ndarray) -> np.ndarray:
    """a_k = c_k a_{k−1} + g_k for c (N,), g (N, p), a_{−1} = 0; by doubling, O(N log(memory length))."""
    a, c = g.copy(), c.copy()
    if c.size:
        c[0] = 0.0
    distance = 1
    while distance < len(a) and np.any(np.abs(c) > FORGOTTEN):
        a[distance:] += c[distance:, None] * a[:-distance]
        c[distance:] *= c[:-distance].copy()
        c[:distance] = 0.0
        distance *= 2
    return a


def lagged_sums(G: np.ndarray, rho: np.ndarray, lags: np.ndarray, starts: np.ndarray) -> LaggedSums:
    """Factors, heads and tails of blocks for G (N, m, p), rho (m,), lags (N,) in steps, starts (B,)."""
    N, m, p = G.shape
    stops = np.append(starts[1:], N)
    factors = np.ascontiguousarray(G.transpose(1, 0, 2))
    head, tail, decay = (
        np.zeros((len(starts), m, p)),
        np.zeros((len(starts), m, p)),
        np.zeros((len(starts), m)),
    )
    for j in np.flatnonzero(rho):
        c = rho[j] ** lags
        inside = c.copy()
        inside[starts] = 0.0
        a = linear_recursion(inside, factors[j])
        for b, (i, k) in enumerate(zip(starts, stops, strict=True)):
            reach = np.cumprod(c[i:k])
            head[b, j], tail[b, j], decay[b, j] = reach @ factors[j, i:k], a[k - 1], reach[-1]
        kept = np.sqrt(1.0 - np.append(inside[1:], 0.0) ** 2)
        np.multiply(kept[:, None], a, out=factors[j])
    return LaggedSums(factors, tail, head, decay)


def independent_rows(G: np.ndarray, rho: np.ndarray, lags: np.ndarray) -> np.ndarray:
    """h (N, m, p) with Σ_k g_k z_k = Σ_k h_k ε_k, ε_k independent of variance 1, for G (N, m, p), rho (m,), lags (N,).

    z_k = c_k z_{k−1} + √(1 − c_k²) ε_k, c_k as above and 0 for the first record, so that
    h_k = √(1 − c_k²) (g_k + c_{k+1} g_{k+1} + c_{k+1} c_{k+2} g_{k+2} + …).
    """
    h = G.copy()
    for j in np.flatnonzero(rho):
        c = np.sign(rho[j]) ** np.where(np.isfinite(lags), lags, 0) * np.abs(rho[j]) ** lags
        c[:1] = 0.0
        later = np.append(c[1:], 0.0)
        h[:, j] = np.sqrt(1 - c**2)[:, None] * linear_recursion(later[::-1], G[::-1, j])[::-1]
    return h
