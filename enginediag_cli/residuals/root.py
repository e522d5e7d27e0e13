"""L of a covariance C = L Lᵀ of parameters in mixed units, computed in units in which they are of one size.

Beside a heating value in J/kg, of variance 10¹¹, the error of a map, of variance 10⁻⁵, is less than rounding: a root
computed in parameter units would leave it out, and what is uncertain would pass for certain.
"""

from __future__ import annotations

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
