"""Does the model fit at all? A verdict of its own, apart from "has a parameter changed".

    χ²_rest = Σ eᵀR⁻¹e − sᵀF⁺s ~ χ²(measurements − rank) when some value of the parameters explains the data.

Noise that is correlated in time counts as fewer measurements, which makes the test cautious.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.excitation import range_space
from enginediag_cli.residuals.statistics import LocalStatistics

ROUNDING = 1e-9
"""Share of χ² that sums of a million readings in double precision may miss."""


@dataclass(frozen=True)
class LackOfFit:
    """`ratio` = χ²_rest per degree of freedom: 1 when the noise is as stated and the model is right.

    `consistent`: whether s and F explain no more than there is; statistics of a window that was condensed with doubt
    (a reference, an error of the model) may, and then their rest, taken as 0, says nothing.
    """

    statistic: float
    dof: float
    p_value: float
    ratio: float
    consistent: bool = True


def lack_of_fit(statistics: LocalStatistics) -> LackOfFit:
    """Test of what no change of the parameters explains; NaN where nothing is left over to test."""
    from enginediag_cli.residuals.distributions import chdtrc

    space = range_space(statistics.F, statistics.prior_sigma)
    v = (statistics.prior_sigma * statistics.s) @ space.basis
    unexplained = statistics.chi2 - float(np.sum(v**2 / space.eigenvalues))
    consistent = unexplained >= -ROUNDING * statistics.chi2
    rest = max(unexplained, 0.0)
    dof = statistics.dof - space.rank
    if dof <= 0:
        return LackOfFit(rest, dof, float("nan"), float("nan"), consistent)
    return LackOfFit(rest, dof, float(chdtrc(dof, rest)), rest / dof, consistent)
