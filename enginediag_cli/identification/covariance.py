"""Covariance of the estimates: a sandwich that knows robust loss, priors and noise correlated in time.

With J̃ the sensitivities after elimination of the recordings' offsets, in prior standard deviations:

    A = Σ_s a_s/(κ_s σ_s²) Σ_k J̃_ks J̃_ksᵀ + C Cᵀ + 1          bread; a_s = mean ψ'(z)
    B = Σ_s b_s/(κ_s σ_s)² Σ_kl ρ_s^|k−l| J̃_ks J̃_lsᵀ + C Cᵀ   meat;  b_s = mean ψ(z)²
    cov = A⁻¹ (B + 1) A⁻¹

C = H_xz (H_zz + 1)⁻¹ carries the prior of the offsets, 1 that of the parameters, and the sum over k, l runs within a
recording, |k − l| counted in steps of time and operating point (`pace.py`). For white Gaussian noise (a = b = κ = 1,
ρ = 0) it is the usual (F + 1)⁻¹. The sum is exact for sensitivities of any shape in time; κ in the fit only balances
data against priors.

What the fit takes out of the noise of sensor s, e − ê = J̃ (x̂ − x), in units of its variance:

    Σ_k ê_k²          falls by  2 w Σ_kl ρ^|k−l| J̃_k A⁻¹ J̃_lᵀ − Σ_k J̃_k cov J̃_kᵀ/σ²
    Σ_k ê_k ê_k−1     falls by  w Σ_kl (ρ^|k−1−l| J̃_k + ρ^|k−l| J̃_k−1) A⁻¹ J̃_lᵀ − Σ_k J̃_k cov J̃_k−1ᵀ/σ²

with w = a/(κσ²). With white noise the first is the trace of the hat matrix.
Source: Huber 1981, chapter 7; W. K. Newey and K. D. West, Econometrica 55 (1987) 703–708, for the idea.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.normal_equations import Block, accumulate, blocks, eliminate
from enginediag_cli.identification.pace import NEIGHBOURS, correlated_sum, correlations, inflation
from enginediag_cli.identification.problem import Problem


@dataclass(frozen=True)
class Uncertainty:
    """Covariances in prior standard deviations of the fit; 1 means: known no better than before.

    `widths`: by which a prior is wider than the fit's where nothing corrects what is believed, None for 1.
    """

    covariance: np.ndarray  # (p, p) posterior
    information: np.ndarray  # (p, p) what the data alone say, the inverse of their covariance where it exists
    from_data: np.ndarray  # (p,) 1 − posterior variance / prior variance, not below 0
    data_standard_error: np.ndarray  # (p,) without priors on θ; inf where the data cannot tell
    sensor_dof: np.ndarray  # (m,) readings of each sensor that the fit has used up
    lost: np.ndarray  # (2, m) variances by which Σ e² and Σ e_k e_k−1 of each sensor are too small
    widths: np.ndarray | None = None  # (p,)


@dataclass(frozen=True)
class _Sums:
    """Sums over the records of each sensor, with J̃ the sensitivities and f_k = Σ_l C_kl J̃_l; where a trace is all that
    is asked for it is taken record by record, which costs one product of matrices less."""

    plain: np.ndarray  # (m, p, p) Σ J̃_kᵀ J̃_k
    lagged: np.ndarray  # (m, p, p) Σ J̃_kᵀ J̃_k−1, over neighbours only
    meat: np.ndarray  # (p, p) Σ J̃_kᵀ f_k, weighted over all sensors
    bread: np.ndarray  # (m,) tr A⁻¹ Σ w_k J̃_kᵀ J̃_k
    smooth: np.ndarray  # (m,) tr A⁻¹ Σ J̃_kᵀ f_k
    smooth_lagged: np.ndarray  # (m,) tr A⁻¹ Σ (J̃_kᵀ f_k−1 + J̃_k−1ᵀ f_k), over neighbours only
    offset_use: np.ndarray  # (m,) readings that the offsets use up


def uncertainty(problem: Problem, fit: Fit, rho: np.ndarray, used: np.ndarray | None = None) -> Uncertainty:
    """Posterior and data-only covariance at the fit for lag-1 correlations `rho` (m,), each in (−1, 1).

    `used` (m,): readings of each sensor that the fit has used up, as far as known: residuals are that much smaller
    than the noise.
    """
    scaled = fit.equations.residual / problem.sigma
    psi = problem.loss.weight(np.nan_to_num(scaled)) * scaled
    with np.errstate(invalid="ignore"):
        a = _column_mean(problem.loss.curvature(np.nan_to_num(scaled)), scaled, 1.0)
        b = _column_mean(psi**2, scaled, 1.0)
    if used is not None:
        n = np.isfinite(scaled).sum(axis=0)
        b = b * n / np.maximum(n - used, 0.5 * n + 0.5)
    bread = np.isfinite(scaled) * a / (problem.sigma**2 * problem.inflation)
    p, R, q = len(fit.x), *fit.z.shape
    H_xx, H_xz, H_zz = np.zeros((p, p)), np.zeros((R, p, q)), np.zeros((R, q, q))
    for block in blocks(problem, fit.x, fit.z):
        w = bread[block.rows]
        part = accumulate(problem, block, w, np.zeros_like(w))
        here = part.recordings
        H_xx += part.H_xx
        H_xz[here] += part.H_xz
        H_zz[here] += part.H_zz
    arrow = eliminate(H_xx, H_xz, H_zz, np.zeros(p), np.zeros((R, q)), np.zeros(p), np.zeros((R, q)))
    gain = np.swapaxes(arrow.gain, 0, 1).reshape(p, -1)
    prior_of_offsets = gain @ gain.T
    # an error of the model at an operating point is common to all its records
    scale = b * (1.0 if problem.shared is None else problem.shared) / (problem.sigma * problem.inflation) ** 2
    inverse = np.linalg.inv(arrow.S)
    sums = _sums(problem, fit, bread, (arrow.gain, np.linalg.inv(H_zz + np.eye(q))), rho, scale, inverse)
    meat = sums.meat
    covariance = inverse @ (meat + prior_of_offsets + np.eye(p)) @ inverse
    covariance = (covariance + covariance.T) / 2
    data = arrow.S - np.eye(p)
    w, variance = _column_mean(bread, scaled, 0.0), problem.sigma**2
    lost = np.stack(
        [
            2 * w * sums.smooth - np.einsum("pl,slp->s", covariance, sums.plain) / variance,
            w * sums.smooth_lagged - np.einsum("pl,slp->s", covariance, sums.lagged) / variance,
        ]
    )
    offset_use = sums.offset_use
    dof = sums.bread + offset_use
    # a mean varies by σ²κ/n and is in every product, of which there are fewer than squares
    neighbours = (np.isfinite(scaled[1:] + scaled[:-1]) & (problem.gap[1:] <= NEIGHBOURS)[:, None]).sum(axis=0)
    products = neighbours / np.maximum(np.isfinite(scaled).sum(axis=0), 1)
    lost = lost + offset_use * inflation(problem.gap, rho) * np.stack([np.ones_like(products), products])
    return Uncertainty(
        covariance,
        data,
        np.clip(1 - np.diag(covariance), 0, 1),
        _data_standard_error(data, meat + prior_of_offsets),
        dof,
        lost,
    )


def _offset_use(problem: Problem, block: Block, w: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Readings of each sensor (m,) of a block that the offsets use up, of `covariance` (R, q, q) with all else held."""
    G = np.nan_to_num(block.offset_columns(problem))
    return np.asarray(np.einsum("nm,nmq,nmq->m", w, G, G @ covariance[problem.recording[block.rows]]))


def _column_mean(values: np.ndarray, valid: np.ndarray, default: float) -> np.ndarray:
    there = np.isfinite(valid)
    n = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    return np.where(n > 0, total / np.maximum(n, 1), default)


def _sums(
    problem: Problem,
    fit: Fit,
    bread: np.ndarray,
    offsets: tuple[np.ndarray, np.ndarray],
    rho: np.ndarray,
    scale: np.ndarray,
    inverse: np.ndarray,
) -> _Sums:
    """Sums over all records; offsets: their gain (R, p, q) and covariance (R, q, q); scale (m,): weight of each sensor
    in the meat; inverse (p, p): S⁻¹, which the traces are taken with."""
    p, m = len(fit.x), len(problem.sensors)
    plain, lagged, meat = np.zeros((m, p, p)), np.zeros((m, p, p)), np.zeros((p, p))
    trace, smooth, smooth_lagged, offset_use = (np.zeros(m) for _ in range(4))
    gap, (gain, of_offsets) = problem.gap, offsets
    for block in blocks(problem, fit.x, fit.z):
        w, recording = bread[block.rows], problem.recording[block.rows]
        if of_offsets.shape[1]:
            offset_use += _offset_use(problem, block, w, of_offsets)
        J = np.where((w > 0)[:, :, None], block.jacobian, 0.0)
        outputs = block.offset_jacobian.shape[1]
        for j, o in enumerate(problem.offsets[:outputs]):
            s = problem.sensors.index(o.sensor)
            G = np.where(w[:, s] > 0, block.offset_jacobian[:, j], 0.0)
            J[:, s, :] -= G[:, None] * gain[recording, :, j]
        if outputs < len(problem.offsets):
            I = np.where((w > 0)[:, :, None], block.input_jacobian, 0.0)
            J -= I @ np.swapaxes(gain[recording, :, outputs:], 1, 2)
        steps = gap[block.rows].copy()
        steps[0] = np.inf  # what lies in the block before is forgotten: one record in thousands
        f = correlated_sum(J, correlations(steps, rho))
        meat += J.reshape(-1, p).T @ (f * scale[:, None]).reshape(-1, p)
        f = f @ inverse
        near = steps[1:] <= NEIGHBOURS
        smooth += np.einsum("nmp,nmp->nm", J, f).sum(axis=0)
        smooth_lagged += near @ (np.einsum("nmp,nmp->nm", J[1:], f[:-1]) + np.einsum("nmp,nmp->nm", J[:-1], f[1:]))
        for s in range(m):
            g = np.ascontiguousarray(J[:, s])
            own = g.T @ g
            trace[s] += w[:, s].max() * np.sum(inverse * own)  # the weight of all readings that there are is one
            plain[s] += own
            lagged[s] += (g[1:] * near[:, None]).T @ g[:-1]
    return _Sums(plain, lagged, meat, trace, smooth, smooth_lagged, offset_use)


def _data_standard_error(information: np.ndarray, meat: np.ndarray) -> np.ndarray:
    """√diag of F⁺ V F⁺, inf for a parameter with a part in a direction that the data leave open."""
    values, vectors = np.linalg.eigh(information)
    seen = values > max(1e-10 * values.max(initial=0.0), 1e-8)
    inverse = (vectors[:, seen] / values[seen]) @ vectors[:, seen].T
    error = np.sqrt(np.diag(inverse @ meat @ inverse))
    open_share = np.sum(vectors[:, ~seen] ** 2, axis=1)
    return np.where(open_share > 1e-9, np.inf, error)
