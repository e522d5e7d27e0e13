"""What the fit leaves: noise per sensor, its correlation in time and between sensors.

The scale is Huber's "proposal 2": σ for which the mean of min((e/σ)², c²) is what it is for Gaussian noise.
A gross outlier counts as c standard deviations, not as nothing: leaving the tails out would let σ, the weights
of the fit and the tails chase each other down. Readings beyond `OUTLIER` standard deviations are counted. The
lag-1 correlation is taken without them between consecutive records of one recording, and

    κ = (1 + ρ)/(1 − ρ),  n_effective = n/κ

is how many independent readings the n correlated ones are worth for a constant (G. V. Bayley and
J. M. Hammersley, J. R. Statist. Soc. Suppl. 8 (1946) 184–197). Scale: P. J. Huber, Ann. Math. Statist. 35
(1964) 73–101, §8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

OUTLIER = 4.0
CLIP = 2.5
GAUSSIAN_MEAN = 0.9775
"""E min(z², CLIP²) for a standard normal z: 1 − 2(cφ(c) + Q(c)) + 2c²Q(c)."""

MAX_RHO = 0.98
"""Beyond this the recording is one reading, not many, and κ says nothing any more."""


@dataclass(frozen=True)
class NoiseEstimate:
    """Noise of m sensors; `sigma` in the column's unit."""

    sigma: np.ndarray  # (m,)
    rho1: np.ndarray  # (m,) in [0, MAX_RHO]
    n: np.ndarray  # (m,) readings
    n_effective: np.ndarray  # (m,)
    outliers: np.ndarray  # (m,) readings beyond OUTLIER standard deviations
    correlation: np.ndarray  # (m, m) between sensors in the same record

    @property
    def inflation(self) -> np.ndarray:
        """κ = (1 + ρ)/(1 − ρ), (m,)."""
        return (1 + self.rho1) / (1 - self.rho1)


def estimate_noise(
    residual: np.ndarray, recording: np.ndarray, dof: np.ndarray, floor: np.ndarray
) -> NoiseEstimate:
    """Noise from residuals (N, m), NaN where missing, of records ordered in time within `recording` (N,).

    `dof` (m,) is how many readings of each sensor the fit used up. `floor` (m,) bounds sigma from below, in
    the column's unit: a sensor that the model can follow exactly must not get infinite weight.
    """
    there = np.isfinite(residual)
    n = there.sum(axis=0)
    scale = np.maximum(huber_scale(residual), floor)
    with np.errstate(invalid="ignore"):
        inside = there & (np.abs(residual) <= OUTLIER * scale)
    kept = inside.sum(axis=0)
    e = np.where(inside, residual, 0.0)
    pairs = inside[1:] & inside[:-1] & (recording[1:] == recording[:-1])[:, None]
    a, b = np.where(pairs, e[1:], 0.0), np.where(pairs, e[:-1], 0.0)
    rho = np.sum(a * b, axis=0) / np.maximum(np.sqrt(np.sum(a**2, axis=0) * np.sum(b**2, axis=0)), 1e-300)
    # fitted quantities that vary slowly take correlated noise with them; Kendall's first-order correction
    # for a fitted mean (Biometrika 41 (1954) 403–404), once per reading used up
    rho = rho + (1 + 3 * rho) * dof / np.maximum(kept, 1)
    rho = np.where(pairs.sum(axis=0) >= 10, np.clip(rho, 0.0, MAX_RHO), 0.0)
    inflation = (1 + rho) / (1 - rho)
    used = np.minimum(dof * inflation, kept / 2)
    sigma = scale * np.sqrt(kept / np.maximum(kept - used, 1.0))
    return NoiseEstimate(
        np.maximum(sigma, floor),
        rho,
        n,
        n / inflation,
        (there & ~inside).sum(axis=0),
        _correlation(e / np.maximum(sigma, floor), inside),
    )


def huber_scale(e: np.ndarray) -> np.ndarray:
    """Proposal 2 scale of each column of (N, m) about 0, ignoring NaN; NaN for a column without readings."""
    there = np.isfinite(e)
    out = np.full(e.shape[1], np.nan)
    for s in range(e.shape[1]):
        column = e[there[:, s], s]
        if not len(column):
            continue
        out[s] = np.sqrt(np.mean(column**2))
        for _ in range(100):  # falls monotonically from the root mean square to the fixed point
            if out[s] == 0.0:
                break
            before = out[s]
            out[s] *= np.sqrt(np.mean(np.minimum((column / before) ** 2, CLIP**2)) / GAUSSIAN_MEAN)
            if abs(out[s] - before) < 1e-6 * before:
                break
    return out


def starting_noise(residual: np.ndarray, recording: np.ndarray, floor: np.ndarray) -> NoiseEstimate:
    """Noise as it looks before a fit: scatter of (N, m) about the median of each recording.

    It holds the whole error of the model, which changes slowly along a recording, so that its correlation is
    high and a first fit trusts the priors more than the data.
    """
    centred = residual.copy()
    for r in np.unique(recording):
        rows = recording == r
        for s in range(residual.shape[1]):
            column = residual[rows, s]
            if np.isfinite(column).any():
                centred[rows, s] = column - np.nanmedian(column)
    return estimate_noise(centred, recording, np.zeros(residual.shape[1]), floor)


def _correlation(z: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """Correlation of sensors over records in which both have a reading; 0 where fewer than 10 do."""
    v = np.where(inside, z, 0.0)
    both = inside.astype(float).T @ inside.astype(float)
    power = (v**2).T @ inside.astype(float)
    c = (v.T @ v) / np.maximum(np.sqrt(power * power.T), 1e-300)
    c = np.where(both >= 10, c, 0.0)
    np.fill_diagonal(c, 1.0)
    return c
