"""The local approach: primary residuals and their sums, for any number of blocks of records at once.

Primary residual, eq. (7) with the weighting that mixed units need: K_k = J_kᵀ R⁻¹ e_k. R is the *long-run*
noise, σ²(1+ρ)/(1−ρ), the variance that a mean over many records really has; a sensor with slowly wandering
errors is thereby trusted less, and V ≈ F however correlated the noise.
"""

from __future__ import annotations

from collections.abc import Sequence

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
    with np.errstate(invalid="ignore"):
        present = np.isfinite(e) & np.isfinite(J.sum(axis=2))
    if not present.all():
        e = np.where(present, e, 0.0)
        J = np.where(present[:, :, None], J, 0.0)
    if noise.covariance is None:
        weight = 1 / (noise.sigma * np.sqrt(noise.inflation))
        return e * weight, J * weight[:, None]
    z, G = np.zeros_like(e), np.zeros_like(J)
    for pattern in np.unique(present, axis=0):  # one Cholesky factor per set of working sensors
        records = np.flatnonzero(np.all(present == pattern, axis=1))
        sensors = np.flatnonzero(pattern)
        if sensors.size:
            inverse = np.linalg.inv(np.linalg.cholesky(noise.covariance[np.ix_(sensors, sensors)]))
            cell = np.ix_(records, sensors)
            z[cell] = e[cell] @ inverse.T
            G[cell] = inverse @ J[cell]
    return z, G


def block_statistics(
    e: np.ndarray,
    J: np.ndarray,
    noise: NoiseModel,
    starts: np.ndarray,
    frame: Frame,
    *,
    lags: np.ndarray | None = None,
    labels: Sequence[tuple[str, str]] | None = None,
) -> list[Block]:
    """Statistics of consecutive blocks of records, ready to be added up to windows.

    e (N, m), J (N, m, p): residuals and sensitivities at the θ0 of the frame of p parameters; starts (B,): first record
    of each block, ascending from 0. lags (N,): steps of time since the record before (inf: unrelated, a new recording);
    1 when not given. V is exact for AR(1) noise, inside blocks and, when blocks are added, between them.
    """
    N, _, p = J.shape
    z, G = whiten(e, J, noise)
    with np.errstate(invalid="ignore"):
        present = np.isfinite(e) & np.isfinite(J.sum(axis=2))
    lags = np.ones(N) if lags is None else lags
    stops = np.append(starts[1:], N)
    share = 1 / noise.inflation  # variance of one whitened residual
    lagged = lagged_sums(G, noise.rho, lags, starts)
    blocks = []
    for b, (i, k) in enumerate(zip(starts, stops, strict=True)):
        rows = G[i:k].reshape(-1, p)
        F = rows.T @ rows
        doubt, parts = noise.doubt(k - i), None
        if doubt is not None:
            parts = _by_sensor(G[i:k], lagged.before[i:k], share)
            errors, bias = doubt
            V = F if noise.white else np.tensordot(1 / (1 + bias), parts, axes=1)
            parts = np.tensordot(errors, parts, axes=1)
        elif noise.white:
            V = F
        else:
            weighted = (G[i:k] * share[:, None]).reshape(-1, p)
            cross = weighted.T @ lagged.before[i:k].reshape(-1, p)
            V = weighted.T @ rows + cross + cross.T
        terms = kurtosis = None
        if noise.kurtosis is not None and (k - i) * G.shape[1] <= MAX_ROWS:
            told = np.flatnonzero(noise.kurtosis)
            terms = independent_rows(G[i:k, told], noise.rho[told], lags[i:k]) * np.sqrt(share[told])[:, None]
            terms, kurtosis = terms.reshape(-1, p), np.tile(noise.kurtosis[told], k - i)
        start, end = labels[b] if labels is not None else ("", "")
        used = present[i:k]
        statistics = LocalStatistics(
            parameters=tuple(frame.names),
            theta0=np.asarray(frame.theta0, float),
            prior_sigma=np.asarray(frame.prior_sigma, float),
            s=rows.T @ z[i:k].ravel(),
            F=F,
            V=V,
            n=int(used.any(axis=1).sum()),
            chi2=float(np.sum(z[i:k] ** 2)),
            # neighbours that differ more than by chance are no further measurements
            dof=float(used.sum(axis=0) @ np.minimum(share, 1.0)),
            start=start,
            end=end,
            by_sensor=parts,
            rows=terms,
            kurtosis=kurtosis,
            meaning=frame.meaning,
        )
        blocks.append(Block(statistics, lagged.head[b], lagged.tail[b], lagged.decay[b], share))
    return blocks


def _by_sensor(G: np.ndarray, before: np.ndarray, share: np.ndarray) -> np.ndarray:
    """V_j (m, p, p): each sensor's part of the covariance of s, for G and their decayed past (n, m, p)."""
    cross = np.stack([G[:, j].T @ (before[:, j] + G[:, j] / 2) for j in range(len(share))])
    return np.asarray((cross + cross.transpose(0, 2, 1)) * share[:, None, None])


def local_statistics(
    e: np.ndarray,
    J: np.ndarray,
    noise: NoiseModel,
    frame: Frame,
    *,
    lags: np.ndarray | None = None,
    label: tuple[str, str] = ("", ""),
) -> LocalStatistics:
    """Statistics of all records together; arguments as in `block_statistics`."""
    return block_statistics(e, J, noise, np.array([0]), frame, lags=lags, labels=[label])[0].statistics
