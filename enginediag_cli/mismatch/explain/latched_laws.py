"""Laws of a switch whose states say what it follows: its thresholds begin where the states have them.

A law with sharp thresholds is found from near them only: between records the readings say nothing of where they lie.
With the moments of its changes given by thresholds a switch is likelier than by itself by what these save (`latched`).
A law in their place, which is gradual where a valve jumps, may be less so by no more than that.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.explain.follows import HysteresisFit, followed
from enginediag_cli.mismatch.explain.judging import Fits
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.grammar import FALLING, RISING, SWITCHING, span
from enginediag_cli.mismatch.laws.scan import (
    Formula,
    forms_of,
    known_variables,
    number_of_groups,
    over_records,
    prior_of_a_place,
    scored,
    share_of_form,
    share_of_variables,
)
from enginediag_cli.mismatch.laws.shortlist import Proposal, proposal
from enginediag_cli.mismatch.unrecorded.latched import SwitchingDirection
from enginediag_cli.mismatch.unrecorded.recorded_driver import Hidden

WIDTHS = (0.08, 0.03)
"""Of a threshold, of the variable's range: a sharp one is often in the way of its own fit, and is tried last."""
VARIABLES, PLACES = 2, 3
"""That are tried, best first."""

FORM = {
    SwitchingDirection.ABOVE: SWITCHING,
    SwitchingDirection.BELOW: SWITCHING,
    SwitchingDirection.RISING: RISING,
    SwitchingDirection.FALLING: FALLING,
}


def outweighing(finding: Hidden, evidence: float, fits: Fits) -> list[tuple[Proposal, ...]]:
    """Laws along what a switch follows that are as likely as that switch, of this ln `evidence` by itself."""
    found: dict[str, Proposal] = {}
    known = known_variables(fits.base.found)
    follows = followed(finding, fits.base.found, known)[:VARIABLES]
    places = (finding.location, *finding.rivals)[:PLACES]
    for width in WIDTHS if follows else ():
        formulas = [_formula(f, width, number_of_groups(known)) for f in follows]
        for p in _proposals(formulas, places, fits.base):
            trials = [] if p.option.label in found else fits.refit([(p.option,)]) or []
            if any(Fitted.to(fits.base, (p,), t).evidence > evidence - follows[0].latch.gain for t in trials):
                found[p.option.label] = p
    return [(p,) for p in found.values()]


def _proposals(formulas: Sequence[Formula], places: Sequence[Location], base: HypothesisFit) -> list[Proposal]:
    found = scored(base.found, base.projection, places, formulas, prior_of_a_place(base.found))
    return [proposal(c, base.found.evidence.engine) for c in found]


def _formula(follows: HysteresisFit, width: float, groups: int) -> Formula:
    of, latch = follows.of, follows.latch
    form = FORM[latch.way]
    shape = {"c": latch.lower, "h": 0.5 * (latch.upper - latch.lower), "w": width * span(of.values)}
    share = share_of_variables(1, groups) * share_of_form(form, forms_of((of,)))
    return Formula(form, (of,), shape, over_records(form, (of,), shape), float(np.log(share)))
