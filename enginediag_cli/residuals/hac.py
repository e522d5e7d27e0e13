"""Long-run covariance of the primary residuals when no noise model is trusted.

Bartlett kernel with automatic bandwidth: Newey, W. K. and West, K. D. (1987) Econometrica 55, 703–708 and
(1994) Review of Economic Studies 61, 631–653.
"""

from __future__ import annotations

import numpy as np


def newey_west_bandwidth(K: np.ndarray) -> int:
    """Number of lags for centred K (N, p): Newey and West (1994) on the sum of its normalised columns."""
    N = len(K)
    scale = K.std(axis=0)
    series = K[:, scale > 0] / scale[scale > 0]
    if N < 3 or not series.size:
        return 0
    w = series.sum(axis=1)
    pilot = int(4 * (N / 100) ** (2 / 9))
    gamma = np.array([w[lag:] @ w[: N - lag] / N for lag in range(min(pilot, N - 1) + 1)])
    lag = np.arange(len(gamma))
    s0 = gamma[0] + 2 * gamma[1:].sum()
    s1 = 2 * (lag * gamma)[1:].sum()
    if s0 <= 0:
        return 0
    return int(min(1.1447 * (s1 / s0) ** (2 / 3) * N ** (1 / 3), N - 1))


def hac_covariance(K: np.ndarray, bandwidth: int | None = None) -> np.ndarray:
    """Covariance (p, p) of Σ_k K_k: Γ₀ + Σ_l (1 − l/(L+1)) (Γ_l + Γ_lᵀ), for K (N, p) with its mean removed.

    Pass residuals of a fit (K at θ̂), so that a fault does not count as noise. Needs N well above p.
    """
    K = K - K.mean(axis=0)
    L = newey_west_bandwidth(K) if bandwidth is None else min(bandwidth, len(K) - 1)
    V = K.T @ K
    for lag in range(1, L + 1):
        gamma = K[lag:].T @ K[:-lag]
        V += (1 - lag / (L + 1)) * (gamma + gamma.T)
    return V
