"""Measurement noise of the sensors: size, correlation from record to record, and what a ratio of variances says."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KNOWN = 0.3
"""Standard deviation of the logarithm of the noise's variance where the model is right: the noise of another flight is
known to 15 %. On blind realistic trials the ratio lies between 0.7 and 1.6."""
LARGEST = 1e4
"""By how much the variance may be larger where something is missing: readings off by a hundred times their noise."""


@dataclass(frozen=True)
class NoiseModel:
    """Noise of m sensors: standard deviation `sigma` (m,) in the sensor's unit, lag-1 correlation `rho` (m,).

    Noise is AR(1) in time: cov(e_k, e_l) = σ² ρ^|k−l|. `covariance` (m, m), when given, replaces σ and is
    white in time (ρ = 0): sensors whose errors go together. `readings` (m,) is from how many readings, less
    those that a fit used up, σ has been estimated; inf, or not given: it is certain. `rho_error` (m,) is the
    standard error of ρ; not given, it follows from `readings`; `rho_common` (m,) is one more, that all sensors
    share. `kurtosis` (m,) is the excess kurtosis of what a reading adds to the one before it; not given, noise
    is Gaussian.
    """

    sigma: np.ndarray
    rho: np.ndarray
    covariance: np.ndarray | None = None
    readings: np.ndarray | None = None
    rho_error: np.ndarray | None = None
    rho_common: np.ndarray | None = None
    kurtosis: np.ndarray | None = None

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

    def _log_variance(self, rho: np.ndarray, records: int) -> np.ndarray:
        """log of the variance (m,) of a mean over so many records, σ_ε²/(1 − ρ²) · L(ρ)/records with
        L = 1 + 2 Σ_l (1 − l/records) ρ^l, as far as it depends on ρ: where σ is certain, through L alone."""
        L = (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**records) / (max(records, 1) * (1 - rho) ** 2)
        certain = True if self.readings is None else ~np.isfinite(self.readings)
        return np.asarray(np.log(np.maximum(L, 1e-300)) - np.where(certain, 0.0, np.log(1 - rho**2)))

    def doubt(self, records: int) -> tuple[np.ndarray, np.ndarray] | None:
        """How wrong the estimated noise variance of a mean over so many records is: errors (q, m) of its logarithm, as
        standard deviations, one row for each independent cause; and bias (m,), what it is too large by on average, as a
        share. None where noise is certain.

        For AR(1) noise log σ_ε² and ρ are estimated independently, with variances (2 + κ)/n, κ the excess kurtosis, and
        (1 − ρ²)/n. σ_ε² has no bias, but the variance v is convex in ρ: its bias is ½ v''/v var ρ (M. G. Kenward and
        J. H. Roger, Comput. Statist. Data Anal. 53 (2009) 2583–2595, correct for it too).
        """
        if self.readings is None:
            return None
        step = 1e-4
        low, here, high = (self._log_variance(self.rho + d, records) for d in (-step, 0.0, step))
        slope, bend = (high - low) / (2 * step), (high - 2 * here + low) / step**2
        if self.rho_error is None:
            of_rho = np.where(np.isfinite(self.readings), (1 - self.rho**2) / self.readings, 0.0)
        else:
            of_rho = self.rho_error**2
        kurtosis = 0.0 if self.kurtosis is None else self.kurtosis
        errors = np.diag(np.sqrt((2 + kurtosis) / self.readings + of_rho * slope**2))
        if self.rho_common is not None and self.rho_common.any():
            errors = np.concatenate([errors, [self.rho_common * slope]])
            of_rho = of_rho + self.rho_common**2
        return errors, np.clip(0.5 * of_rho * (slope**2 + bend), 0.0, 1.0)

    @property
    def white(self) -> bool:
        return not np.any(self.rho)


def white_noise(sigma: np.ndarray) -> NoiseModel:
    """Independent noise of standard deviation `sigma` (m,)."""
    sigma = np.asarray(sigma, float)
    return NoiseModel(sigma, np.zeros_like(sigma))


@dataclass(frozen=True)
class NoiseLevel:
    """What the rest of χ² says: `factor` v ≥ 1 by which evidence is divided; log likelihoods of that rest where the
    noise is as stated and where it may be anything."""

    factor: float = 1.0
    log_stated: float = 0.0
    log_anything: float = 0.0


def level_of_ratio(ratio: float, dof: float, doubt: float = 0.0) -> NoiseLevel:
    """Of χ² per degree of freedom that is left, of so many; doubt: 2/ν of estimated noise."""
    from scipy.special import log_ndtr, ndtr

    variance = 2.0 / dof + doubt
    log, wide = float(np.log(ratio)), np.log(max(LARGEST, ratio))
    total = KNOWN**2 + variance
    s = np.sqrt(variance)
    inside = max(float(ndtr(log / s) - ndtr((log - wide) / s)), float(np.exp(log_ndtr(log / s))) / 2, 1e-300)
    return NoiseLevel(
        max(float(np.exp(log * KNOWN**2 / total)), 1.0),
        -0.5 * log**2 / total - 0.5 * float(np.log(2 * np.pi * total)),
        float(np.log(inside) - np.log(wide)),
    )
