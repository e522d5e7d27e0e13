"""Uncertainty of the estimates: covariance, combinations that are not identifiable, parameters at bounds.

**Covariance.** A sandwich estimator for a robust loss, priors and noise that is correlated in time.

With J̃ the sensitivities after elimination of the recordings' offsets, in prior standard deviations:

    A = Σ_s a_s/(κ_s σ_s²) Σ_k J̃_ks J̃_ksᵀ + C Cᵀ + 1          bread; a_s = mean ψ'(z)
    B = Σ_s b_s/(κ_s σ_s)² Σ_kl ρ_s^|k−l| J̃_ks J̃_lsᵀ + C Cᵀ   meat;  b_s = mean ψ(z)²
    cov = A⁻¹ (B + 1) A⁻¹

C = H_xz (H_zz + 1)⁻¹ carries the prior of the offsets, 1 that of the parameters, and the sum over k, l runs within a
recording, |k − l| counted in steps of time and operating point (`noise.py`). For white Gaussian noise (a = b = κ = 1,
ρ = 0) it is the usual (F + 1)⁻¹. The sum is exact for sensitivities of any shape in time; κ in the fit only balances
data against priors.

What the fit takes out of the noise of sensor s, e − ê = J̃ (x̂ − x), in units of its variance:

    Σ_k ê_k²          falls by  2 w Σ_kl ρ^|k−l| J̃_k A⁻¹ J̃_lᵀ − Σ_k J̃_k cov J̃_kᵀ/σ²
    Σ_k ê_k ê_k−1     falls by  w Σ_kl (ρ^|k−1−l| J̃_k + ρ^|k−l| J̃_k−1) A⁻¹ J̃_lᵀ − Σ_k J̃_k cov J̃_k−1ᵀ/σ²

with w = a/(κσ²). With white noise the first is the trace of the hat matrix.
Source: Huber 1981, chapter 7; W. K. Newey and K. D. West, Econometrica 55 (1987) 703–708, for the idea.

**Combinations that are not identifiable.** In prior standard deviations the data's information has eigenvalues λ; a
direction of eigenvalue λ is known to λ/(1 + λ) from the data and for the rest from the prior. The directions below a
threshold span a space whose eigenvectors are an arbitrary mixture; they are rewritten so that each has a leading
parameter that is in no other (reduced echelon form with pivots from a QR factorisation, Golub and Van Loan, §5.5.7),
and printed as

    θ_lead + c₂ θ₂ + …     changes in this ratio, in the parameters' own units, leave the readings as they are

with the share of the prior variance along the direction v that the data removed, 1 − vᵀCv / vᵀv.

**Bounds.** A bound is no estimate. Where the records hardly determine a parameter, and the rest of the model pushes it
against its bound, it is fixed at what was assumed, with its uncertainty. Where the records do determine it, the model
lacks something that this parameter cannot stand for, and the identification has failed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.noise import NEIGHBOURS, correlated_sum, correlations, inflation
from enginediag_cli.identification.normal_equations import (
    SUMMED_RECORDS,
    PredictionBlock,
    accumulate,
    blocks,
    eliminate,
)
from enginediag_cli.identification.problem import IdentificationProblem

SAMPLE = 1500
"""Records of which some in this many, in whole stretches, show what a fit takes out of the noise until the last one. It
is a small part of the noise, and known by so many to a few per cent of itself."""


@dataclass(frozen=True)
class Uncertainty:
    """Covariances in prior standard deviations of the fit; 1 means: known no better than before.

    `widths`: by which a prior is wider than the fit's where nothing corrects what is believed, None for 1.
    """

    covariance: np.ndarray  # (p, p) posterior
    information: np.ndarray  # (p, p) what the data alone say, the inverse of their covariance where it exists
    from_data: np.ndarray  # (p,) 1 − posterior variance / prior variance, not below 0
    sensor_dof: np.ndarray  # (m,) readings of each sensor that the fit has used up
    absorbed: np.ndarray  # (2, m) variances by which Σ e² and Σ e_k e_k−1 of each sensor are too small
    widths: np.ndarray | None = None  # (p,)


@dataclass(frozen=True)
class _SensorSums:
    """Sums over the records of each sensor, with J̃ the sensitivities and f_k = Σ_l C_kl J̃_l; where a trace is all
    that is required it is taken record by record, which costs one product of matrices less."""

    plain: np.ndarray  # (m, p, p) Σ J̃_kᵀ J̃_k
    lagged: np.ndarray  # (m, p, p) Σ J̃_kᵀ J̃_k−1, over neighbours only
    meat: np.ndarray  # (p, p) Σ J̃_kᵀ f_k, weighted over all sensors
    bread: np.ndarray  # (m,) tr A⁻¹ Σ w_k J̃_kᵀ J̃_k
    smooth: np.ndarray  # (m,) tr A⁻¹ Σ J̃_kᵀ f_k
    smooth_lagged: np.ndarray  # (m,) tr A⁻¹ Σ (J̃_kᵀ f_k−1 + J̃_k−1ᵀ f_k), over neighbours only
    offset_use: np.ndarray  # (m,) readings that the offsets use up


def uncertainty(
    problem: IdentificationProblem, fit: Fit, rho: np.ndarray, used: np.ndarray | None = None, *, sampled: bool = False
) -> Uncertainty:
    """Posterior and data-only covariance at the fit for lag-1 correlations `rho` (m,), each in (−1, 1).

    `used` (m,): readings of each sensor that the fit has used up, as far as known: residuals are that much smaller than
    the noise. sampled: what the fit takes out of the noise is estimated from SAMPLE records, where there are many more.
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
    at = fit.equations.prediction
    for block in blocks(problem, fit.x, fit.z, at=at, records=SUMMED_RECORDS):
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
    of_offsets = (arrow.gain, np.linalg.inv(H_zz + np.eye(q)))
    sums = _sums(problem, fit, bread, of_offsets, (rho, scale), inverse, sampled)
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
        dof,
        lost,
    )


def _eliminate_offsets(problem: IdentificationProblem, block: PredictionBlock, gain: np.ndarray) -> np.ndarray:
    """J̃ (n, m, p), the sensitivities of a block after elimination of the offsets by their gain (R, p, q); overwrites
    those of the block."""
    J, q = block.jacobian, len(problem.offsets)
    if not q:
        return J
    columns, recording = block.offset_columns(problem), problem.recording[block.rows]
    starts = np.flatnonzero(np.diff(recording, prepend=-1))
    for first, stop in zip(starts, [*starts[1:], len(recording)], strict=True):
        taken = columns[first:stop].reshape(-1, q) @ gain[recording[first]].T
        J[first:stop] -= taken.reshape(J[first:stop].shape)
    return J


def _offset_use(
    problem: IdentificationProblem, block: PredictionBlock, w: np.ndarray, covariance: np.ndarray
) -> np.ndarray:
    """Readings of each sensor (m,) of a block that the offsets use up, of `covariance` (R, q, q) with all else held."""
    G = np.nan_to_num(block.offset_columns(problem))
    return np.asarray(np.einsum("nm,nmq,nmq->m", w, G, G @ covariance[problem.recording[block.rows]]))


def _column_mean(values: np.ndarray, valid: np.ndarray, default: float) -> np.ndarray:
    there = np.isfinite(valid)
    n = there.sum(axis=0)
    total = np.where(there, values, 0.0).sum(axis=0)
    return np.where(n > 0, total / np.maximum(n, 1), default)


def _sums(
    problem: IdentificationProblem,
    fit: Fit,
    bread: np.ndarray,
    offsets: tuple[np.ndarray, np.ndarray],
    noise: tuple[np.ndarray, np.ndarray],
    inverse: np.ndarray,
    sampled: bool,
) -> _SensorSums:
    """Sums over all records, or estimated from a sample of them; offsets: their gain (R, p, q) and covariance (R, q,
    q); noise: correlation (m,) and weight of each sensor in the meat (m,); inverse (p, p): S⁻¹, which the traces are
    taken with."""
    p, m = len(fit.x), len(problem.sensors)
    plain, lagged, meat = np.zeros((m, p, p)), np.zeros((m, p, p)), np.zeros((p, p))
    trace, smooth, smooth_lagged, offset_use = (np.zeros(m) for _ in range(4))
    gap, (gain, of_offsets), (rho, scale) = problem.gap, offsets, noise
    at, N = fit.equations.prediction, len(problem.recording)
    every = max(N // SAMPLE, 1) if sampled and at is not None else 1
    taken = 0
    for block in blocks(problem, fit.x, fit.z, at=at, records=SUMMED_RECORDS if every > 1 else None, every=every):
        taken += len(block.predicted)
        w = bread[block.rows]
        if of_offsets.shape[1]:
            offset_use += _offset_use(problem, block, w, of_offsets)
        J = _eliminate_offsets(problem, block, gain)
        steps = gap[block.rows].copy()
        steps[0] = np.inf  # what lies in the block before is forgotten: one record in thousands
        r, near = correlations(steps, rho), steps[1:] <= NEIGHBOURS
        for s in range(m):
            g = np.where((w[:, s] > 0)[:, None], J[:, s], 0.0)
            f = correlated_sum(g[:, None], r[:, s : s + 1])[:, 0]
            meat += scale[s] * (g.T @ f)
            h = g @ inverse
            smooth[s] += np.vdot(h, f)
            beside = np.einsum("np,np->n", h[1:], f[:-1]) + np.einsum("np,np->n", h[:-1], f[1:])
            smooth_lagged[s] += near @ beside
            trace[s] += w[:, s].max() * np.vdot(h, g)  # the weight of all readings that there are is one
            plain[s] += g.T @ g
            lagged[s] += (g[1:] * near[:, None]).T @ g[:-1]
    sums = (plain, lagged, meat, trace, smooth, smooth_lagged, offset_use)
    return _SensorSums(*(part * (N / taken) for part in sums)) if every > 1 else _SensorSums(*sums)


THRESHOLD = 0.1
"""A direction of which the data give less than this share counts as unidentified."""

NAMED = 0.15
"""A parameter is named in a combination when its part reaches this share of the leader's, in prior sigmas."""


SHOWN = 5
"""Parameters of one combination that its sentence names."""


@dataclass(frozen=True)
class Combination:
    """Changes of parameters in the ratio of `coefficients`, which the readings hardly show.

    `from_data` is the share of what is known of it that the data give, 0 to 1.
    """

    parameters: tuple[str, ...]
    coefficients: tuple[float, ...]
    from_data: float

    def __str__(self) -> str:
        terms = [self.parameters[0]]
        for name, c in list(zip(self.parameters, self.coefficients, strict=True))[1:SHOWN]:
            terms.append(f"{'+' if c > 0 else '−'} {abs(c):.2g}·{name}")
        if len(self.parameters) > SHOWN:
            terms.append(f"and {len(self.parameters) - SHOWN} smaller parts")
        return f"{' '.join(terms)}: data give {100 * self.from_data:.0f} % of what is known"


def unidentified_combinations(
    information: np.ndarray, covariance: np.ndarray, prior_sigma: np.ndarray, names: Sequence[str]
) -> tuple[Combination, ...]:
    """Combinations below THRESHOLD, the least known first.

    `information` and posterior `covariance` are (p, p) in prior standard deviations, `prior_sigma` (p,) in
    the parameters' units.
    """
    values, vectors = np.linalg.eigh(information)
    space = vectors[:, values / (1 + np.maximum(values, 0)) < THRESHOLD]
    if space.shape[1] == 0:
        return ()
    basis = reduced_echelon(space)
    found = [_name_combination(basis[:, j], covariance, prior_sigma, names) for j in range(basis.shape[1])]
    return tuple(sorted(found, key=lambda c: (c.from_data, c.parameters)))


def reduced_echelon(space: np.ndarray) -> np.ndarray:
    """Basis (p, d) of the space that the columns of `space` (p, d) span, in which each vector has a leading parameter
    that is in no other."""
    from scipy.linalg import qr

    _, _, order = qr(space.T, pivoting=True, mode="economic")
    return np.asarray(space @ np.linalg.inv(space[order[: space.shape[1]]]))


def _name_combination(
    direction: np.ndarray, covariance: np.ndarray, prior_sigma: np.ndarray, names: Sequence[str]
) -> Combination:
    size = np.abs(direction)
    order = [int(i) for i in np.argsort(-size, kind="stable") if size[i] >= NAMED * size.max()]
    w = np.zeros_like(direction)
    w[order] = direction[order]
    from_data = float(np.clip(1 - w @ covariance @ w / (w @ w), 0.0, 1.0))
    physical = direction[order] * prior_sigma[order]
    coefficients = physical / physical[0]
    return Combination(tuple(names[i] for i in order), tuple(float(c) for c in coefficients), from_data)


DETERMINED = 0.5
"""Share of what is known of a parameter that the records give: with less, most of it is what was assumed."""
ROUNDS = 4
"""Fits after which no further parameter is given back: each may push another one to its bound."""


@dataclass(frozen=True)
class ActiveBound:
    """A parameter that the records push against a bound, in its own unit."""

    name: str
    value: float
    upper: bool

    def __str__(self) -> str:
        return f"{self.name} at its {'upper' if self.upper else 'lower'} bound {self.value:g}"


def fix_weak_parameters(problem: IdentificationProblem, fit: Fit, found: Uncertainty) -> IdentificationProblem | None:
    """The problem with those parameters at a bound that the records hardly determine fixed at what was assumed; None
    where there are none."""
    weak = fit.at_bound & (found.from_data < DETERMINED)
    if not weak.any():
        return None
    lower, upper = np.where(weak, problem.prior_mean, problem.lower), np.where(weak, problem.prior_mean, problem.upper)
    return replace(problem, lower=lower, upper=upper)


def active_bounds(problem: IdentificationProblem, fit: Fit) -> tuple[ActiveBound, ...]:
    """What the fit left at a bound."""
    values = problem.to_physical(fit.x)
    held = [(i, values[problem.names[i]]) for i in np.flatnonzero(fit.at_bound)]
    return tuple(ActiveBound(problem.names[i], v, bool(v >= problem.upper[i])) for i, v in held)
