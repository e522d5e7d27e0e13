"""Which combinations of parameters the operating points excite, and which they leave in the dark.

Everything is scaled by the prior standard deviations D = diag(prior_sigma), so that D F D has no unit: an
eigenvalue of 1 means that the data know the combination exactly as well as the prior did.

L of a covariance C = L Lᵀ of parameters in mixed units, computed in units in which they are of one size.

Beside a heating value in J/kg, of variance 10¹¹, the error of a map, of variance 10⁻⁵, is less than rounding: a root
computed in parameter units would leave it out, and what is uncertain would pass for certain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST_VARIANCE = 1e-14
"""Share of the largest variance, in units of the scale, up to which one is rounding."""


def root_of(covariance: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """L (p, r) of a positive semidefinite covariance (p, p), one column for each direction that is uncertain at all.

    scale (p,): a positive size of each parameter in its unit, such as its prior standard deviation.
    """
    scaled = covariance / scale / scale[:, None]
    own = np.diag(scaled)
    if np.count_nonzero(scaled) == np.count_nonzero(own):  # unit normals, offsets: nothing is left to decompose
        seen = own > LEAST_VARIANCE * max(float(own.max(initial=0.0)), 0.0)
        return np.asarray(np.diag(scale * np.sqrt(np.maximum(own, 0.0)))[:, seen])
    eigenvalues, vectors = np.linalg.eigh(scaled)
    seen = eigenvalues > LEAST_VARIANCE * max(float(eigenvalues[-1]), 0.0) if eigenvalues.size else eigenvalues > 0
    return np.asarray(scale[:, None] * vectors[:, seen] * np.sqrt(eigenvalues[seen]))


RANK_TOLERANCE = 1e-9
"""Eigenvalues of D F D below this share of the largest count as zero (sensitivities are good to 1e-10)."""


@dataclass(frozen=True)
class RangeSpace:
    """Eigen-decomposition of D F D restricted to its range: D F D = U diag(eigenvalues) Uᵀ.

    `scale` (p,) is the diagonal of D, `basis` U is (p, r), `eigenvalues` is (r,), descending; `tolerance`: by which
    others were taken for zero.
    """

    scale: np.ndarray
    basis: np.ndarray
    eigenvalues: np.ndarray
    tolerance: float = RANK_TOLERANCE

    @property
    def rank(self) -> int:
        return int(self.eigenvalues.size)


@dataclass(frozen=True)
class DarkCombination:
    """A combination of parameters that the operating points hardly excite.

    `weights` gives the change of each parameter in multiples of its prior standard deviation; `information`
    is the squared signal-to-noise ratio of that change of one prior standard deviation.
    """

    weights: dict[str, float]
    information: float

    def __str__(self) -> str:
        terms = [f"{'-' if weight < 0 else '+'} {abs(weight):.2g} {name}" for name, weight in self.weights.items()]
        return " ".join(terms).removeprefix("+ ")


def range_space(F: np.ndarray, scale: np.ndarray, tolerance: float = RANK_TOLERANCE) -> RangeSpace:
    """Range of the information matrix F (p, p) in units of `scale` (p,), rank by relative tolerance."""
    eigenvalues, vectors = np.linalg.eigh(scale[:, None] * F * scale)
    eigenvalues, vectors = eigenvalues[::-1], vectors[:, ::-1]
    kept = eigenvalues > tolerance * max(eigenvalues[0], 0.0) if eigenvalues.size else np.zeros(0, bool)
    return RangeSpace(scale, vectors[:, kept], eigenvalues[kept], tolerance)


def dark_combinations(
    parameters: tuple[str, ...], F: np.ndarray, scale: np.ndarray, least_information: float = 1.0
) -> tuple[DarkCombination, ...]:
    """Combinations known worse than `least_information` prior standard deviations squared, one per dimension.

    The eigenvectors of a null space of several dimensions are an arbitrary rotation, hard to read; the basis
    is therefore brought to reduced echelon form, in which each combination owns one leading parameter.
    """
    import scipy.linalg

    scaled = scale[:, None] * F * scale
    eigenvalues, vectors = np.linalg.eigh(scaled)
    weak = vectors[:, eigenvalues < least_information]
    if not weak.shape[1]:
        return ()
    d = weak.shape[1]
    _, R, pivots = scipy.linalg.qr(weak.T, mode="economic", pivoting=True)
    echelon = np.empty((d, weak.shape[0]))
    echelon[:, pivots] = np.linalg.solve(R[:, :d], R)
    found = []
    for row in echelon:
        row = row / np.linalg.norm(row)
        order = np.argsort(-np.abs(row), kind="stable")
        weights = {parameters[i]: float(row[i]) for i in order if abs(row[i]) > 0.1}
        found.append(DarkCombination(weights, max(float(row @ scaled @ row), 0.0)))
    return tuple(sorted(found, key=lambda c: c.information))
