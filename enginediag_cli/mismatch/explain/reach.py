"""Explanations that a further recording may bring back: fitted, and now a little too far behind to be told.

The log odds of two explanations move by ½λ ± √λ with a recording that separates them by λ: what is behind by ten units
of χ² may be within six again after a flight on which the two hardly differ. A plan must tell the right one from these,
too.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.mismatch.explain.answer import Answer, Coefficient, Explanation
from enginediag_cli.mismatch.explain.rejected import Reason
from enginediag_cli.mismatch.fit.trial import HypothesisFit

REACH = 14.0
"""Units of χ² behind the best up to which an explanation counts: odds of a thousand to one. Judgement."""


def near_alternatives(answer: Answer, fitted: Mapping[str, HypothesisFit]) -> Sequence[Explanation]:
    """The explanations of an answer that has rivals, and after them those of the `fitted`, by label, that are within
    REACH, likeliest first; none where one stands alone."""
    told = answer.explanations
    if len(told) < 2:
        return ()
    near = [
        (r.figure, fitted[label])
        for label, r in answer.rejected.items()
        if r.reason is Reason.WORSE and r.figure <= REACH and label in fitted and fitted[label].converged
    ]
    return (*told, *(_explanation(t, told[0].probability * float(np.exp(-0.5 * f))) for f, t in sorted(near, key=_by)))


def _by(pair: tuple[float, HypothesisFit]) -> float:
    return pair[0]


def _explanation(t: HypothesisFit, probability: float) -> Explanation:
    parameters = t.found.model.parameters
    found = tuple(Coefficient(n, parameters[n].unit, v, s, *t.intervals[n]) for n, (v, s) in t.coefficients.items())
    return Explanation(t.options, found, t.objective, np.nan, probability, np.nan, np.nan, t.at_bound)
