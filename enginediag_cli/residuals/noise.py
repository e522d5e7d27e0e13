"""Measurement noise of the sensors: size, and correlation from one record to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NoiseModel:
    """Noise of m sensors: standard deviation `sigma` (m,) in the sensor's unit, lag-1 correlation `rho` (m,).

    Noise is AR(1) in time: cov(e_k, e_l) = σ² ρ^|k−l|. `covariance` (m, m), when given, replaces σ and is
    white in time (ρ = 0): sensors whose errors go together.
    """

    sigma: np.ndarray
    rho: np.ndarray
    covariance: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.sigma.ndim != 1 or self.rho.shape != self.sigma.shape:
            raise ValueError("`sigma` and `rho` must be vectors of one length")
        if not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            raise ValueError("`sigma` must be positive and finite")
        if not np.all((self.rho >= 0) & (self.rho < 1)):
            raise ValueError("`rho` must lie in [0, 1)")
        if self.covariance is not None and np.any(self.rho):
            raise ValueError("a full covariance between sensors is only defined for white noise (rho = 0)")

    @property
    def inflation(self) -> np.ndarray:
        """(1 + ρ)/(1 − ρ) (m,): variance of a long mean relative to that of independent records."""
        return (1 + self.rho) / (1 - self.rho)

    @property
    def white(self) -> bool:
        return not np.any(self.rho)


def white_noise(sigma: np.ndarray) -> NoiseModel:
    """Independent noise of standard deviation `sigma` (m,)."""
    sigma = np.asarray(sigma, float)
    return NoiseModel(sigma, np.zeros_like(sigma))
