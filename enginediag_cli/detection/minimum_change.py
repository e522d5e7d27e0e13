"""The smallest change of each parameter that the data at hand would have shown."""

from __future__ import annotations

import numpy as np

from enginediag_cli.detection.glr import threshold
from enginediag_cli.residuals.score import Score, separable_information

TESTS = ("global", "directed", "minmax")
"""global: the test of all parameters; directed: the test of this one alone, the others unchanged; minmax:
the test of this one whatever the others did."""


def required_noncentrality(dof: int, false_alarm: float, power: float) -> float:
    """λ at which χ²(dof; λ) exceeds the threshold with probability `power`."""
    from scipy.optimize import brentq
    from scipy.stats import ncx2

    if not false_alarm < power < 1:
        raise ValueError("`power` must lie between `false_alarm` and 1")
    limit = threshold(dof, false_alarm)
    upper = 10.0
    while ncx2.sf(limit, dof, upper) < power:
        upper *= 2
    return float(brentq(lambda value: ncx2.sf(limit, dof, value) - power, 1e-12, upper))


def minimum_change(
    score: Score, *, false_alarm: float = 0.01, power: float = 0.9, test: str = "global", sides: int = 2
) -> np.ndarray:
    """Smallest change (p,) of each parameter alone, in its unit, seen with probability `power`.

    inf where the operating points do not excite the parameter. `sides` = 1 when the direction of the change
    is known beforehand (only for the directed and min-max tests, whose statistic has a sign).
    """
    from scipy.stats import norm

    if test not in TESTS:
        raise ValueError(f"`test` must be one of {', '.join(TESTS)}, not {test!r}")
    if sides not in (1, 2) or (sides == 1 and test == "global"):
        raise ValueError("`sides` must be 1 or 2, and 2 for the global test")
    if test == "global":
        if score.rank == 0:
            return np.full(len(score.parameters), np.inf)
        needed = required_noncentrality(score.rank, false_alarm, power)
    elif sides == 2:
        needed = required_noncentrality(1, false_alarm, power)
    else:
        needed = float((norm.isf(false_alarm) + norm.ppf(power)) ** 2)
    known = separable_information(score) if test == "minmax" else np.diag(score.information)
    scaled = known * score.prior_sigma**2
    seen = scaled > 1e-9 * max(float(np.max(np.diag(score.scaled()[1]), initial=0.0)), 1e-300)
    with np.errstate(divide="ignore"):
        return np.where(seen, np.sqrt(needed / np.where(seen, known, 1.0)), np.inf)
