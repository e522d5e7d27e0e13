"""The local approach: primary residuals and their sums, for any number of blocks of records at once.

Primary residual, eq. (7) with the weighting that mixed units need: K_k = J_kᵀ R⁻¹ e_k. R is the *long-run*
noise, σ²(1+ρ)/(1−ρ), the variance that a mean over many records really has; a sensor with slowly wandering
errors is thereby trusted less, and V ≈ F however correlated the noise.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from enginediag_cli.residuals.blocks import Block
from enginediag_cli.residuals.correlated import independent_rows, lagged_sums
from enginediag_cli.residuals.frame import Frame
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.statistics import MAX_ROWS, LocalStatistics


def whiten(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray]:
    """Residuals z (N, m) and sensitivities G (N, m, p) in units of the long-run noise; missing rows are zero.

    e (N, m) in sensor units, NaN where a sensor is missing; J (N, m, p) in sensor unit per parameter unit. A
    row of J that is not finite is dropped with its measurement.
    """
    z, G, _ = whitened(e, J, noise)
    return z, G


def whitened(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As `whiten`, and which measurements there are (N, m)."""
    with np.errstate(invalid="ignore"):
        present = np.isfinite(e) & np.isfinite(J.sum(axis=2))
    if not present.all():
        e = np.where(present, e, 0.0)
        J = np.where(present[:, :, None], J, 0.0)
    if noise.covariance is None:
        weight = 1 / (noise.sigma * np.sqrt(noise.inflation))
        return e * weight, J * weight[:, None], present
    z, G = np.zeros_like(e), np.zeros_like(J)
    for pattern in np.unique(present, axis=0):  # one Cholesky factor per set of working sensors
        records = np.flatnonzero(np.all(present == pattern, axis=1))
        sensors = np.flatnonzero(pattern)
        if sensors.size:
            inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance[np.ix_(sensors, sensors)]))
            cell = np.ix_(records, sensors)
            z[cell] = e[cell] @ inverse.T
            G[cell] = inverse @ J[cell]
    return z, G, present


def block_statistics(
    e: np.ndarray,
    J: np.ndarray,
    noise: NoiseModel,
    starts: np.ndarray,
    frame: Frame,
    *,
    lags: np.ndarray | None = None,
    information: np.ndarray | None = None,
) -> Iterator[Block]:
    """Statistics of consecutive blocks of records in turn, ready to be added up to windows.

    e (N, m), J (N, m, p): residuals and sensitivities at the θ0 of the frame of p parameters; starts (B,): first record
    of each block, ascending from 0. lags (N,): steps of time since the record before (inf: unrelated, a new recording);
    1 when not given. V is exact for AR(1) noise, inside blocks and, when blocks are added, between them.
    information: F (B, p, p) of the blocks, where it is known.
    """
    N, _, p = J.shape
    z, G, present = whitened(e, J, noise)
    lags = np.ones(N) if lags is None else lags
    stops = np.append(starts[1:], N)
    share = 1 / noise.inflation  # variance of one whitened residual
    lagged = lagged_sums(G, noise.rho, lags, starts)
    by_sensor = not noise.white or noise.readings is not None
    for b, (i, k) in enumerate(zip(starts, stops, strict=True)):
        rows = G[i:k].reshape(-1, p)
        F = rows.T @ rows if information is None else information[b]
        parts = terms = kurtosis = None
        if by_sensor:
            parts = np.stack([h.T @ h for h in lagged.factors[:, i:k]]) * share[:, None, None]  # (m, p, p)
        if noise.kurtosis is not None and (k - i) * G.shape[1] <= MAX_ROWS:
            told = np.flatnonzero(noise.kurtosis)
            terms = independent_rows(G[i:k, told], noise.rho[told], lags[i:k]) * np.sqrt(share[told])[:, None]
            terms, kurtosis = terms.reshape(-1, p), np.tile(noise.kurtosis[told], k - i)
        used = present[i:k]
        sums = LocalStatistics(
            parameters=tuple(frame.names),
            theta0=np.asarray(frame.theta0, float),
            prior_sigma=np.asarray(frame.prior_sigma, float),
            s=rows.T @ z[i:k].ravel(),
            F=F,
            V=F,
            n=int(used.any(axis=1).sum()),
            chi2=float(np.sum(z[i:k] ** 2)),
            # neighbours that differ more than by chance are no further measurements
            dof=float(used.sum(axis=0) @ np.minimum(share, 1.0)),
            rows=terms,
            kurtosis=kurtosis,
            meaning=frame.meaning,
        )
        yield Block(sums, noise, parts, int(k - i), lagged.head[b], lagged.tail[b], lagged.decay[b])


def local_statistics(
    e: np.ndarray,
    J: np.ndarray,
    noise: NoiseModel,
    frame: Frame,
    *,
    lags: np.ndarray | None = None,
    information: np.ndarray | None = None,
) -> LocalStatistics:
    """Statistics of all records together; arguments as in `block_statistics`, information (p, p)."""
    known = None if information is None else information[None]
    return next(block_statistics(e, J, noise, np.array([0]), frame, lags=lags, information=known)).statistics
