"""Noise estimated from what nothing explains: not the nuisance, not any listed effect, change in time or free form.

The residual of a fit is projected off the space of all of them, so that what is missing does not count as noise:

    σ_s² = Σ_{rows of s} e⊥² / Σ_{rows of s} (1 − h_ii)        ρ_s = Σ e⊥_k e⊥_{k−1} / Σ e⊥_k²

with h the leverage in that space. The second is biased towards 0 by the projection, by about the share of rows that
it takes; it is divided by that share. Rows that are whitened with a correlation ρ already show what is left of it, r:
noise e_k = ρ e_{k−1} + √(1 − ρ²) w_k of such w has the variance (1 + ρr)/(1 − ρr) of theirs and the lag-1 correlation
(ρ + r)/(1 + ρr) (an autoregression of second order).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from enginediag_cli.mismatch.fit.evidence import Dataset, Noise
from enginediag_cli.mismatch.fit.families import Scored
from enginediag_cli.mismatch.fit.neighbours import Neighbours
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.scores import surprise
from enginediag_cli.mismatch.fit.unexplained import unexplained

LARGEST_SHARE = 0.4
"""Of the rows that the space may take; beyond it only its strongest directions count."""

LARGEST_RHO = 0.95
"""A correlation beyond it is drift of the model, not noise."""
LEAST_RHO, DEVIATIONS = 0.08, 3.0  # of a few hundred records nothing below is to be told from 0, of nine sensors


def estimated_noise(projection: Projection, blocks: Sequence[Scored]) -> Noise:
    """Noise by sensor from a fit's projection and the scored blocks of all that may be missing."""
    found = projection.found
    rest = unexplained(projection, blocks, LARGEST_SHARE)
    sigma, rho = {}, {}
    for s, column in enumerate(found.problem.sensors):
        rows = rest.sensor == s
        if not rows.any():
            continue
        left, free = rest.left[rows], float(rest.free[s])
        alike = found.evidence.noise.shared.get(column, 1.0)
        # rows are freed of the correlation that the fit knew: what is found in them adds to it
        known, further = (
            float(found.rho[s]),
            _lag_one(left, rest.record[rows], projection.frame.neighbours, free),
        )
        more = (1.0 + known * further) / (1.0 - known * further)
        sigma[column] = float(found.problem.sigma[s] * np.sqrt(alike * more * (left @ left) / (free * len(left))))
        rho[column] = min((known + further) / (1.0 + known * further), max(LARGEST_RHO, known))
    return replace(found.evidence.noise, sigma={**found.evidence.noise.sigma, **sigma}, rho=rho)


def doubtful(gate: float, projection: Projection) -> float:
    """A gate on −ln p of scores that take estimated noise as exact: a score may rest on one sensor, whose σ² comes from
    about ν independent readings, so that T is F distributed with (1, ν) degrees of freedom. Of a record correlated by
    ρ with the one before it (1 − ρ)/(1 + ρ) is independent; LARGEST_SHARE may be taken by what was fitted."""
    if not np.isfinite(gate):
        return gate
    return float(surprise(_exceeded(gate, projection), 1))


def doubtful_ratio(ratio: float, projection: Projection) -> float:
    """The same of a gate on a log likelihood ratio, which is half such a statistic."""
    if not 0.0 < ratio < np.inf:
        return ratio
    return 0.5 * _exceeded(float(surprise(2.0 * ratio, 1)), projection)


def _exceeded(gate: float, projection: Projection) -> float:
    """T that F (1, ν) exceeds with −ln p = gate."""
    return float(special.fdtri(1.0, independent_readings(projection), 1.0 - np.exp(-gate)))


def independent_readings(projection: Projection) -> float:
    """ν of the sensor with the fewest."""
    frame = projection.frame
    rho = np.abs(frame.correlation()[frame.record, frame.sensor])
    noise, sensors = projection.found.evidence.noise, projection.found.problem.sensors
    alike = np.array([noise.shared.get(s, 1.0) for s in sensors])
    independent = np.bincount(frame.sensor, (1.0 - rho) / (1.0 + rho) / alike[frame.sensor])[np.unique(frame.sensor)]
    return max(1.0, (1.0 - LARGEST_SHARE) * float(independent.min()))


def larger_noise(a: Noise, b: Noise) -> Noise:
    """Of each sensor the noise that is larger, with its correlation; of noise as large, the second's."""
    wider = {s for s, sigma in b.sigma.items() if sigma >= a.sigma.get(s, 0.0)}
    return replace(
        a,
        sigma={s: b.sigma[s] if s in wider else v for s, v in a.sigma.items()},
        rho={s: (b if s in wider else a).rho.get(s, 0.0) for s in a.sigma},
        estimated=a.estimated or b.estimated,
    )


def with_noise(evidence: Dataset, noise: Noise) -> Dataset:
    return replace(evidence, noise=noise)


def _lag_one(e: np.ndarray, record: np.ndarray, near: Neighbours, free: float) -> float:
    """Correlation of records that follow each other as usual, 0 where it is not told from it; `record` (n,) of each
    residual (n,)."""
    next_to = (np.diff(record) == 1) & near.consecutive[record[1:]]
    if next_to.sum() < 20:
        return 0.0
    r = float((e[1:] * e[:-1])[next_to].sum() / (e @ e) * len(e) / max(next_to.sum(), 1)) / free
    return 0.0 if abs(r) < max(LEAST_RHO, DEVIATIONS / np.sqrt(next_to.sum())) else float(np.clip(r, -0.5, LARGEST_RHO))
