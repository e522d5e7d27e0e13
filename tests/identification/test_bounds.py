"""Parameters at bounds: those that the records hardly determine go back to what was assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from identification_toy import ToyEngine, fly

from enginediag_cli.identification.covariance import active_bounds, fix_weak_parameters, uncertainty
from enginediag_cli.identification.gauss_newton import solve
from enginediag_cli.identification.problem import IdentificationSettings, build_problem


def pushed(share):
    """A fit with its first parameter at a bound, of which the records give `share` of what is known."""
    problem = build_problem(ToyEngine(), [fly(ToyEngine(), np.random.default_rng(0))], IdentificationSettings())
    upper = problem.upper.copy()
    upper[0] = problem.prior_mean[0] - 1.2 * problem.prior_sigma[0]
    problem = replace(problem, upper=upper)
    fit = solve(problem)
    found = uncertainty(problem, fit, np.zeros(4))
    from_data = found.from_data.copy()
    from_data[0] = share
    return problem, fit, replace(found, from_data=from_data)


def test_what_the_records_hardly_determine_stays_where_it_was_assumed():
    problem, fit, found = pushed(0.1)
    assert fit.at_bound[0]
    back = fix_weak_parameters(problem, fit, found)
    again = solve(back, (fit.x, fit.z))
    assert again.converged
    assert again.x[0] == 0.0
    assert active_bounds(back, again) == ()


def test_what_the_records_determine_stays_at_its_bound_and_is_told():
    problem, fit, found = pushed(0.9)
    assert fix_weak_parameters(problem, fit, found) is None
    (told,) = active_bounds(problem, fit)
    assert str(told).startswith("hpc.efficiency at its upper bound 0.9")
