"""Parameters at the bounds of what is physically possible.

A bound is no estimate. Where the records hardly determine a parameter, and the rest of the model pushes it against its
bound, it goes back to what was assumed and stays there with its uncertainty. Where the records do determine it, the
model lacks something that this parameter cannot stand for, and the identification has failed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.identification.covariance import Uncertainty
from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.problem import Problem

DETERMINED = 0.5
"""Share of what is known of a parameter that the records give: with less, most of it is what was assumed."""
ROUNDS = 4
"""Fits after which no further parameter is given back: each may push another one to its bound."""


@dataclass(frozen=True)
class AtBound:
    """A parameter that the records push against a bound, in its own unit."""

    name: str
    value: float
    upper: bool

    def __str__(self) -> str:
        return f"{self.name} at its {'upper' if self.upper else 'lower'} bound {self.value:g}"


def given_back(problem: Problem, fit: Fit, found: Uncertainty) -> Problem | None:
    """The problem with those parameters at a bound that the records hardly determine held at what was assumed; None
    where there are none."""
    weak = fit.at_bound & (found.from_data < DETERMINED)
    if not weak.any():
        return None
    lower, upper = np.where(weak, problem.prior_mean, problem.lower), np.where(weak, problem.prior_mean, problem.upper)
    return replace(problem, lower=lower, upper=upper)


def at_bounds(problem: Problem, fit: Fit) -> tuple[AtBound, ...]:
    """What the fit left at a bound."""
    values = problem.physical(fit.x)
    held = [(i, values[problem.names[i]]) for i in np.flatnonzero(fit.at_bound)]
    return tuple(AtBound(problem.names[i], v, bool(v >= problem.upper[i])) for i, v in held)
