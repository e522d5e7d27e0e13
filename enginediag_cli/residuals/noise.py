"""Measurement noise of the sensors: size, and correlation from one record to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class NoiseModel:
    """Noise of m sensors: standard deviation `sigma` (m,) in the sensor's unit, lag-1 correlation `rho` (m,).

    Noise is AR(1) in time: cov(e_k, e_l) = σ² ρ^|k−l|. `covariance` (m, m), when given, replaces σ and is
    white in time (ρ = 0): sensors whose errors go together. `readings` (m,) is from how many readings, less
    those that a fit used up, σ and ρ have been estimated; not given, they are certain.
    """

    sigma: np.ndarray
    rho: np.ndarray
    covariance: np.ndarray | None = None
    readings: np.ndarray | None = None

    def __post_init__(self) -> None:
        if self.sigma.ndim != 1 or self.rho.shape != self.sigma.shape:
            raise ValueError("`sigma` and `rho` must be vectors of one length")
        if not np.all(np.isfinite(self.sigma) & (self.sigma > 0)):
            raise ValueError("`sigma` must be positive and finite")
        if not np.all((self.rho > -1) & (self.rho < 1)):
            raise ValueError("`rho` must lie in (-1, 1)")
        if self.covariance is not None and np.any(self.rho):
            raise ValueError("a full covariance between sensors is only defined for white noise (rho = 0)")

    @property
    def inflation(self) -> np.ndarray:
        """(1 + ρ)/(1 − ρ) (m,): variance of a long mean relative to that of independent records."""
        return (1 + self.rho) / (1 - self.rho)

    def doubt(self, records: int) -> np.ndarray | None:
        """Variance (m,) of the logarithm of each sensor's estimated noise in a mean over so many records; None where
        noise is certain.

        For AR(1) noise log σ_ε² and ρ are estimated independently, with variances 2/n and (1 − ρ²)/n, and the
        variance of the mean is σ_ε²/(1 − ρ²) · K(ρ)/records with K = 1 + 2 Σ_l (1 − l/records) ρ^l. Where the sensors'
        ρ scatter less than chance would have it, identification has pooled them, and all m sensors tell of each.
        """
        if self.readings is None:
            return None
        step = 1e-4

        def log_variance(rho: np.ndarray) -> np.ndarray:
            K = (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**records) / (max(records, 1) * (1 - rho) ** 2)
            return np.asarray(np.log(np.maximum(K, 1e-300) / (1 - rho**2)))

        slope = (log_variance(self.rho + step) - log_variance(self.rho - step)) / (2 * step)
        alone = (1 - self.rho**2) / self.readings
        of_rho = np.minimum(alone, np.var(self.rho) + alone / len(self.rho))
        return np.asarray(2 / self.readings + of_rho * slope**2)

    @property
    def white(self) -> bool:
        return not np.any(self.rho)


def white_noise(sigma: np.ndarray) -> NoiseModel:
    """Independent noise of standard deviation `sigma` (m,)."""
    sigma = np.asarray(sigma, float)
    return NoiseModel(sigma, np.zeros_like(sigma))
