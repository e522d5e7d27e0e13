"""Small linear systems of many points at once, points last: every step is one operation on all of them.

What LAPACK does point by point costs up to four times as much for matrices of five to ten rows.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.dual import Array

PIVOT = 0.1
"""Least share of the largest element below it at which an element of the diagonal is divided by (threshold pivoting):
growth of rounding errors stays below 1/PIVOT a row, and most points exchange no rows."""


@np.errstate(all="ignore")  # a singular matrix gives what is not finite, in its own point only
def factors(A: Array) -> tuple[Array, Array]:
    """L and U in one array (k, k, n), with 1/diagonal of U, and the order (k, n) in which each point's rows were taken,
    for A (k, k, n)."""
    LU = A.copy()
    k, _, n = LU.shape
    order = np.repeat(np.arange(k)[:, None], n, axis=1)
    for c in range(k):
        if c < k - 1:
            _exchange(LU, order, c)
        LU[c, c] = 1.0 / LU[c, c]
        LU[c + 1 :, c] *= LU[c, c]
        LU[c + 1 :, c + 1 :] -= LU[c + 1 :, c, None] * LU[c, None, c + 1 :]
    return LU, order


@np.errstate(all="ignore")
def substituted(LU: Array, order: Array, B: Array) -> Array:
    """A⁻¹ B (k, n) or (k, m, n) for the factors of A and B of that shape."""
    vectors = B.ndim == 2
    n = LU.shape[2]
    X = B.ravel().take(order * n + np.arange(n)) if vectors else np.take_along_axis(B, order[:, None], axis=0)
    L = LU if vectors else LU[:, :, None]
    k = len(LU)
    for c in range(k - 1):
        X[c + 1 :] -= L[c + 1 :, c] * X[c]
    for c in range(k - 1, -1, -1):
        X[c] *= L[c, c]
        X[:c] -= L[:c, c] * X[c]
    return X


def directly(A: Array, B: Array) -> Array:
    """A⁻¹ B (k, n) for A (k, k, n) and B (k, n), by LAPACK: for so few points that calls cost more than computing."""
    matrices, vectors = A.transpose(2, 0, 1), B.T[:, :, None]
    try:
        return np.linalg.solve(matrices, vectors)[:, :, 0].T
    except np.linalg.LinAlgError:  # of one point, which says nothing about the others
        bad = ~(np.abs(np.linalg.det(matrices)) > 0.0)
        X = np.linalg.solve(np.where(bad[:, None, None], np.eye(len(A)), matrices), vectors)[:, :, 0].T
        X[:, bad] = np.nan
        return X


def _exchange(LU: Array, order: Array, c: int) -> None:
    """Brings the largest element of column c to the diagonal, at points where the one there is too small."""
    size = np.abs(LU[c:, c])
    at = np.flatnonzero(~(size[0] >= PIVOT * size.max(axis=0)))
    if at.size:
        row = c + size[:, at].argmax(axis=0)
        taken = LU[row, :, at]
        LU[row, :, at] = LU[c][:, at].T
        LU[c][:, at] = taken.T
        order[row, at], order[c, at] = order[c, at], order[row, at]
