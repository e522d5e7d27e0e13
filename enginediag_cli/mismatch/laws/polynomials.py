"""Smooth curves of a variable as polynomials: of low degrees much, of each degree more only a share ρ of the variance.

    f = Σ_i α_i q_i(x),     α_i ~ N(0, A² ρⁱ)

with q_i orthonormal over the records, the variances scaled to add up to A².
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import product

import numpy as np

from enginediag_cli.mismatch.laws.linear import Linear
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import KnownVariable

SIZES = (0.1, 0.4, 1.6)
"""A of the parts of a law over its size: the standard deviation of one that a fit carries, or of what is plausible."""
SMOOTH = (0.15, 0.45, 0.85)
"""ρ: variance of a degree over that of the one before."""
HIGHEST = 11
"""Degree of a curve, or of each of a sum of two."""


@dataclass(frozen=True)
class Polynomials:
    """Curves of one variable, or sums of one of each of two: `columns` (N, k) over the records, and their variances
    (w, k), of every smoothness and every share of a size of 1."""

    columns: np.ndarray
    variances: np.ndarray

    @staticmethod
    def of(known: Sequence[KnownVariable]) -> Polynomials:
        parts, degrees = zip(*product(range(len(known)), range(HIGHEST)), strict=True)
        return Polynomials(np.hstack([from_design(k, HIGHEST) for k in known]), variances(parts, degrees))

    def at(self, says: Says, size: float) -> Linear:
        """What a place says of them, of this size."""
        return Linear.of(says, self.columns, size**2 * self.variances)


def from_design(k: KnownVariable, degree: int) -> np.ndarray:
    """Polynomials (N, degree) less what they are at the record that is nearest to the design point: beyond what was
    flown they are anything."""
    q = orthonormal(k.values, degree)
    return np.asarray(q - q[np.argmin(np.abs(k.values - k.variable.reference))])


def orthonormal(x: np.ndarray, degree: int) -> np.ndarray:
    """Polynomials of a variable (N,) over the records: (N, degree), of zero mean and unit variance."""
    low, high = float(np.min(x)), float(np.max(x))
    V = np.polynomial.chebyshev.chebvander(2.0 * (x - low) / (high - low) - 1.0, degree)
    return np.asarray(np.linalg.qr(V)[0][:, 1:] * np.sqrt(len(x)))


@lru_cache(maxsize=8)
def variances(parts: tuple[int, ...], degrees: tuple[int, ...]) -> np.ndarray:
    """W (w, k) of columns of these parts and degrees: every choice of sizes of the parts and of smoothness."""
    part, degree = np.array(parts), np.array(degrees, float)
    found = []
    for rho in SMOOTH:
        share = rho**degree
        share = share / np.array([share[part == p].sum() for p in part])
        found += [share * np.array(sizes)[part] ** 2 for sizes in product(SIZES, repeat=len(set(parts)))]
    return np.array(found)
