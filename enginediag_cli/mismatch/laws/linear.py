"""A linear model of which the sizes have a normal prior, for many choices of their variances at once.

With products G = CᵀC and pulls g = Cᵀe of columns C, and sizes a ~ N(0, W), W diagonal,

    ln B = ½ gᵀ(W⁻¹ + G)⁻¹g − ½ ln|1 + W G|,     mean of a = (W⁻¹ + G)⁻¹g

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), section 2.1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from enginediag_cli.mismatch.laws.said import Says


@dataclass(frozen=True)
class Linear:
    """Curves that are sums of `columns` (N, k) over the records, by choices of their variances W (w, k), and what a
    place says of them: `products` (k, k), `pulls` (k,)."""

    columns: np.ndarray
    variances: np.ndarray
    products: np.ndarray
    pulls: np.ndarray

    @staticmethod
    def of(says: Says, columns: np.ndarray, variances: np.ndarray) -> Linear:
        (G,), (g,) = says.of(columns[:, None, :])
        return Linear(columns, variances, G, g)

    @cached_property
    def evidence(self) -> np.ndarray:
        """ln (w,)."""
        return linear_evidence(self.products, self.pulls, self.variances)

    @property
    def curves(self) -> np.ndarray:
        """The mean curve (w, N) of each choice."""
        return np.asarray(linear_means(self.products, self.pulls, self.variances) @ self.columns.T)


def evidence_of_all(tried: Sequence[Linear]) -> float:
    """ln of the mean evidence of all choices of these, which are as likely beforehand."""
    return ln_mean([e for t in tried for e in t.evidence])


def ln_mean(evidence: Sequence[float] | np.ndarray) -> float:
    """ln of the mean of things (n,) of which these are the logarithms."""
    return float(np.logaddexp.reduce(evidence)) - float(np.log(len(evidence)))


def linear_evidence(G: np.ndarray, g: np.ndarray, W: np.ndarray) -> np.ndarray:
    """ln evidence (w,) of a linear model with products G (k, k) and pulls g (k,), by variances W (w, k)."""
    L, h = _narrowed(G, g, W)
    return np.asarray(0.5 * np.sum(h**2, axis=1) - np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1))


def linear_means(G: np.ndarray, g: np.ndarray, W: np.ndarray) -> np.ndarray:
    """Means (w, k) of the sizes."""
    L, h = _narrowed(G, g, W)
    return np.asarray(np.sqrt(W) * np.linalg.solve(np.swapaxes(L, 1, 2), h[:, :, None])[:, :, 0])


def _narrowed(G: np.ndarray, g: np.ndarray, W: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """L (w, k, k) of L Lᵀ = 1 + √W G √W, and L⁻¹√W g (w, k)."""
    root = np.sqrt(W)
    L = np.linalg.cholesky(np.eye(len(g)) + root[:, :, None] * G * root[:, None, :])
    return L, np.linalg.solve(L, (root * g)[:, :, None])[:, :, 0]
