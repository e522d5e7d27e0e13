"""Generalised likelihood ratio test of "no parameter has changed", eqs. (10) and (11).

    t = sᵀ V⁻¹ F (F V⁻¹ F)⁺ F V⁻¹ s ~ χ²(rank F; λ),    λ = Δθᵀ F V⁻¹ F Δθ

The degrees of freedom are the rank, not the number of parameters: operating points that excite fewer
combinations give a test of fewer.
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
    from scipy.special import chdtri  # the χ² quantile; scipy.stats would take most of the start-up time

    if not 0 < false_alarm < 1:
        raise ValueError("`false_alarm` must lie between 0 and 1")
    return float(chdtri(dof, false_alarm)) if dof else float("nan")


def glr_test(score: Score, false_alarm: float = 0.01) -> GlrTest:
    """Test of no change against any change of the parameters of `score`."""
    from scipy.special import chdtrc

    limit = threshold(score.rank, false_alarm)
    if score.rank == 0:
        return GlrTest(0.0, 0, limit, float("nan"), None)
    return GlrTest(
        score.glr, score.rank, limit, float(chdtrc(score.rank, score.glr)), bool(score.glr > limit)
    )


def power(score: Score, change: np.ndarray, false_alarm: float = 0.01) -> float:
    """Probability that the test sees the change Δθ (p,), in parameter units."""
    from scipy.stats import ncx2

    if score.rank == 0:
        return 0.0
    noncentrality = float(change @ score.information @ change)
    return float(ncx2.sf(threshold(score.rank, false_alarm), score.rank, noncentrality))
