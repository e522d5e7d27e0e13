"""Generalised likelihood ratio test of "no parameter has changed", eqs. (10) and (11).

    t = sᵀ V⁻¹ F (F V⁻¹ F)⁺ F V⁻¹ s ~ χ²(rank F; λ),    λ = Δθᵀ F V⁻¹ F Δθ

The degrees of freedom are the rank, not the number of parameters: operating points that excite fewer
combinations give a test of fewer.

Where the noise itself was estimated, t/r is not χ²(r)/r but λ⁻¹ F(r, ν), with λ and ν such that mean and variance are
right: M. G. Kenward and J. H. Roger, Biometrics 53 (1997) 983–997.

Where noise is not Gaussian, t is a sum of squares of variance 2r + Q, Q = Σ_i κ_i h_i² (G. A. F. Seber and A. J. Lee,
Linear Regression Analysis, 2nd ed. (2003), theorem 1.6), and r'/r · t has about the χ²(r') distribution with
r' = 2r²/(2r + Q): the same mean and variance. Both together: λ t/r ~ F(r', ν).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class GlrTest:
    """Outcome of the test: `alarm` is None where nothing is excited and nothing can be judged."""

    statistic: float
    dof: int
    threshold: float
    p_value: float
    alarm: bool | None


def threshold(dof: int, false_alarm: float) -> float:
    """Value that χ²(dof) exceeds with probability `false_alarm`."""
    from enginediag_cli.residuals.distributions import chdtri

    if not 0 < false_alarm < 1:
        raise ValueError("`false_alarm` must lie between 0 and 1")
    return float(chdtri(dof, false_alarm)) if dof else float("nan")


def noise_correction(rank: int, doubt: tuple[float, float, float]) -> tuple[float, float]:
    """(λ, ν): λ t/r has the F(r, ν) distribution; (1, inf) when the noise is known.

    doubt: A₁ and A₂ of Kenward and Roger, see `Score`. Where the noise is hardly known at all the formulas end; they
    are then kept at their ends, and the test is cautious but not exact.
    """
    A1, A2, _ = doubt
    r = float(rank)
    if rank == 0 or A2 <= 0:
        return 1.0, float("inf")
    A2 = min(A2, 0.5 * r)
    B = (A1 + 6 * A2) / (2 * r)
    g = ((r + 1) * A1 - (r + 4) * A2) / ((r + 2) * A2)
    below = 3 * r + 2 * (1 - g)
    c1, c2, c3 = g / below, (r - g) / below, (r + 2 - g) / below
    mean = 1 / (1 - A2 / r)
    variance = 2 / r * (1 + c1 * B) / (max(1 - c2 * B, 0.05) ** 2 * max(1 - c3 * B, 0.05))
    ratio = variance / (2 * mean**2)
    nu = 4 + (r + 2) / max(r * ratio - 1, 1e-9)
    return nu / (mean * (nu - 2)), nu


def numerator(rank: int, doubt: tuple[float, float, float]) -> float:
    """r' = 2r²/(2r + Q): degrees of freedom with which the law of the noise makes the statistic scatter.

    It is kept within a factor of 4 of r: what is so far from Gaussian two moments do not describe.
    """
    return 2.0 * rank**2 / min(max(2.0 * rank + doubt[2], 0.5 * rank), 8.0 * rank) if rank else 0.0


def p_value(statistic: float, score: Score) -> float:
    """Probability of a larger statistic when nothing has changed."""
    from enginediag_cli.residuals.distributions import chdtrc, fdtrc

    scale, nu = noise_correction(score.rank, score.doubt)
    r = numerator(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(chdtrc(r, statistic * r / score.rank))
    return float(fdtrc(r, nu, scale * statistic / score.rank))


def critical_value(score: Score, false_alarm: float) -> float:
    """The statistic that is exceeded with probability `false_alarm` when nothing has changed."""
    from enginediag_cli.residuals.distributions import chdtri, fdtri

    limit = threshold(score.rank, false_alarm)
    if score.rank == 0:
        return limit
    scale, nu = noise_correction(score.rank, score.doubt)
    r = numerator(score.rank, score.doubt)
    if not np.isfinite(nu):
        return float(score.rank / r * chdtri(r, false_alarm))
    return float(score.rank / scale * fdtri(r, nu, 1 - false_alarm))


def glr_test(score: Score, false_alarm: float = 0.01) -> GlrTest:
    """Test of no change against any change of the parameters of `score`."""
    limit = critical_value(score, false_alarm)
    if score.rank == 0:
        return GlrTest(0.0, 0, limit, float("nan"), None)
    return GlrTest(score.glr, score.rank, limit, p_value(score.glr, score), bool(score.glr > limit))


def power(score: Score, change: np.ndarray, false_alarm: float = 0.01) -> float:
    """Probability that the test sees the change Δθ (p,), in parameter units."""
    from scipy.stats import ncx2

    if score.rank == 0:
        return 0.0
    noncentrality = float(change @ score.information @ change)
    return float(ncx2.sf(threshold(score.rank, false_alarm), score.rank, noncentrality))
