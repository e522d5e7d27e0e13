"""A natural cubic spline: the free curve that a law is compared with.

Knots t₁ … t_K at quantiles of the variable over the records that are fitted; beyond the outer knots it is straight. In
the basis of T. Hastie, R. Tibshirani, J. Friedman, The Elements of Statistical Learning, 2nd ed. (2009), eq. 5.4–5.5,

    N₁ = x,   N_{k+1} = d_k − d_{K−1},   d_k = ((x − t_k)³₊ − (x − t_K)³₊)/(t_K − t_k)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

KNOTS = (0.05, 0.35, 0.65, 0.95)
"""Quantiles, as is usual for four knots: F. E. Harrell, Regression Modeling Strategies (2015), table 2.3."""
MANY_KNOTS = (0.02, 0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 0.98)
"""Of a curve that is to follow whatever one variable can say."""


def spline(x: np.ndarray, fitted: np.ndarray | None = None, knots: Sequence[float] = KNOTS) -> np.ndarray:
    """Its functions (N, K − 1) of a variable (N,), each of mean 0 and standard deviation 1 over the records `fitted`
    (all of them when not given), whose quantiles the knots are."""
    own = x if fitted is None else fitted
    t = np.nanquantile(own, knots)
    middle, width = 0.5 * (t[0] + t[-1]), max(float(t[-1] - t[0]), 1e-300)
    at = (t - middle) / width
    B, known = (_functions((v - middle) / width, at) for v in (x, own))
    return np.asarray((B - np.nanmean(known, axis=0)) / np.maximum(np.nanstd(known, axis=0), 1e-12))


def _functions(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    def d(k: int) -> np.ndarray:
        cubes = np.maximum(x - t[k], 0.0) ** 3 - np.maximum(x - t[-1], 0.0) ** 3
        return np.asarray(cubes / max(t[-1] - t[k], 1e-9))

    last = d(len(t) - 2)
    return np.column_stack([x, *(d(k) - last for k in range(len(t) - 2))])
