"""How likely it is that any smooth curve of some variable acts at some place, at a fit that lacks it.

A wave, or whatever no list holds, scores low as any listed form, and an amplitude of its own in every record follows it
as well as one that no column shows. All smooth curves of a variable at once have the evidence of a linear model, before
anything is fitted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.linear import evidence_of_all
from enginediag_cli.mismatch.laws.polynomials import Polynomials
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import KnownVariable, number_of_groups, prior_of_a_place
from enginediag_cli.mismatch.laws.smooth import prior_of_variables


def any_curve_at_all(found: IdentifiedHypothesis, projection: Projection, known: Sequence[KnownVariable]) -> float:
    """ln evidence of all smooth curves of the likeliest variable at its place, priors included; −∞ without any."""
    where = locations(found)
    columns = Columns(found, [p.parameter for p in where], [p.through for p in where if p.through is not None])
    nothing = np.zeros(len(found.number))
    every = [(prior_of_variables([k], number_of_groups(known)), Polynomials.of([k])) for k in known]
    best = -np.inf
    for place in where:
        says = Says(AnyCurve.at(projection, columns, place.parameter), nothing, 0.0, tuple(known))
        for prior, curves in every:
            best = max(best, evidence_of_all([curves.at(says, place.scale)]) + prior)
    return best + prior_of_a_place(found)
