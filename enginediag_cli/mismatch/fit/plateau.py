"""Intervals of coefficients beyond which χ² does not rise: of a play that is at least so large, any larger explains.

An interval of ± 1.96 standard errors is that of a parabola. At its end θ_e χ² has risen by 3.84 where it is one; where
it has risen by less than half of that, the end moves on, twice as far each time, as long as

    χ²(θ_e) − χ²(θ) < 1.92,     everything else at its best for θ_e by linearisation,

and at most to the bound: it is never too narrow, and up to twice too wide.
Source: D. J. Venzon, S. H. Moolgavkar, Appl. Statist. 37 (1988) 87–94 (profile likelihood).
"""

from __future__ import annotations

from dataclasses import replace

from enginediag_cli.identification.normal_equations import normal_equations
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.probability import NORMAL_95

RISEN = 0.5 * NORMAL_95**2
"""Of χ², half of what it has risen by at the end of a 95 % interval: less is no parabola."""
FARTHER, STEPS = 2.0, 8
"""By how much farther from the estimate an end is tried, and how often."""


def interval_at(found: IdentifiedHypothesis, name: str, standard_error: float) -> tuple[float, float]:
    """95 % interval of a coefficient of a fit, within its bounds."""
    j = found.problem.names.index(name)
    lower, upper = float(found.problem.lower[j]), float(found.problem.upper[j])
    at, least = found.theta[name], _objective(found, j, found.theta[name])
    return (
        _end(found, j, least, at, max(at - NORMAL_95 * standard_error, lower), lower),
        _end(found, j, least, at, min(at + NORMAL_95 * standard_error, upper), upper),
    )


def _end(found: IdentifiedHypothesis, j: int, least: float, at: float, end: float, bound: float) -> float:
    """From an estimate by a first end to a bound."""
    for _ in range(STEPS):
        if end == bound or not _objective(found, j, end) < least + RISEN:
            return end
        farther = at + FARTHER * (end - at)
        end = bound if abs(farther - at) >= abs(bound - at) else farther
    return end


def _objective(found: IdentifiedHypothesis, j: int, value: float) -> float:
    """χ² with one parameter kept at a value."""
    fit, problem = found.fit, found.problem
    x, kept = fit.x.copy(), fit.at_bound.copy()
    x[j], kept[j] = (value - problem.prior_mean[j]) / problem.prior_sigma[j], True
    there = replace(fit, x=x, at_bound=kept, equations=normal_equations(problem, x, fit.z))
    return Projection(replace(found, fit=there)).objective
