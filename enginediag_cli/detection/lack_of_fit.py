"""Does the model fit at all? A verdict of its own, apart from "has a parameter changed".

    χ²_rest = Σ eᵀR⁻¹e − sᵀF⁺s ~ χ²(measurements − rank) when some value of the parameters explains the data.

Noise that is correlated in time counts as fewer measurements, which makes the test cautious.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.excitation import range_space
from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class LackOfFit:
    """`ratio` = χ²_rest per degree of freedom: 1 when the noise is as stated and the model is right."""

    statistic: float
    dof: float
    p_value: float
    ratio: float


def lack_of_fit(statistics: LocalStatistics) -> LackOfFit:
    """Test of what no change of the parameters explains; NaN where nothing is left over to test."""
    from enginediag_cli.detection.distributions import chdtrc

    space = range_space(statistics.F, statistics.prior_sigma)
    v = (statistics.prior_sigma * statistics.s) @ space.basis
    rest = max(statistics.chi2 - float(np.sum(v**2 / space.eigenvalues)), 0.0)
    dof = statistics.dof - space.rank
    if dof <= 0:
        return LackOfFit(rest, dof, float("nan"), float("nan"))
    return LackOfFit(rest, dof, float(chdtrc(dof, rest)), rest / dof)
