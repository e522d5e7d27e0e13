"""What the largest of many scores is worth.

The largest of many scores is large by chance; its distribution when nothing is missing is drawn from the
geometry of the columns themselves, all scores being linear in one Gaussian vector.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import special

DRAWS = 2000
"""Of the null distribution of a statistic: a level of 1 % is known to 0.2 %."""
RESOLVED = 0.05  # level that 100 draws lie beyond
FAR = 1e-280  # tail probabilities below it come from the asymptotic series


def surprise(T: np.ndarray | float, dof: int) -> np.ndarray:
    """−ln p of a χ² statistic, without underflow however large: by ln Φ for one degree of freedom, T/2 for two, and
    beyond by Γ(k/2, T/2)/Γ(k/2), whose tail is −ln p → T/2 − (k/2 − 1) ln(T/2) + ln Γ(k/2)."""
    half = 0.5 * np.asarray(T, float)
    if dof == 1:
        return np.asarray(-special.log_ndtr(-np.sqrt(2.0 * half)) - np.log(2.0))
    if dof == 2:
        return half
    p = special.gammaincc(0.5 * dof, half)
    far = half - (0.5 * dof - 1.0) * np.log(np.maximum(half, 1.0)) + special.gammaln(0.5 * dof)
    return np.where(p > FAR, -np.log(np.maximum(p, FAR)), far)


def critical_surprise(
    gram: np.ndarray, dofs: Sequence[int], levels: Sequence[float], rng: np.random.Generator
) -> tuple[float, ...]:
    """−ln p that the largest score of blocks exceeds with each probability of `levels` when nothing is missing;
    infinite when there is no block. `gram` (K, K): products of all blocks' columns, orthonormal within each block, and
    as many of each as it has degrees of freedom.

    The tail of the largest −ln p is exponential, P(g) = 1 − exp(−K e^(−g)), with K the effective number of tests, which
    hardly changes with g: gates beyond what the draws resolve are extrapolated by it.
    """
    if not sum(dofs):
        return tuple(np.inf for _ in levels)
    values, vectors = np.linalg.eigh(gram)
    w = rng.standard_normal((DRAWS, len(values))) @ (vectors * np.sqrt(np.maximum(values, 0.0))).T
    top: dict[int, np.ndarray] = {}  # the largest T of each number of degrees of freedom
    j = 0
    for k in dofs:
        if not k:
            continue
        T = np.einsum("dk,dk->d", w[:, j : j + k], w[:, j : j + k])
        top[k] = np.maximum(top[k], T) if k in top else T
        j += k
    largest = np.max([surprise(T, k) for k, T in top.items()], axis=0)
    anchor = float(np.quantile(largest, 1.0 - RESOLVED))
    return tuple(
        float(np.quantile(largest, 1.0 - level))
        if level >= RESOLVED
        else anchor + float(np.log(np.log1p(-RESOLVED) / np.log1p(-level)))
        for level in levels
    )
