"""The same formula at further places: what changes one machine by its Reynolds number changes others by theirs.

Sought by itself, a law at a further place pays for its form and variables; where another place has them already it is
one of the places of the same quantity, ln prior −ln n. Left out, its share is taken by the first place, whose size is
then wrong by many of its standard errors. The shape is that of the first to begin with, and each place's own. An
instrument's law is its own: what instruments of different kinds share, by shapes that each may bend, is the engine's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, over_records, scored, seen_at
from enginediag_cli.mismatch.laws.shortlist import Proposal, proposal

MOST_PLACES = 5
"""Of one formula: an engine's turbomachines."""
RIVAL = 2.0
"""ln evidence by which a further place may be behind, to be told with the probability that it has."""


def elsewhere_too(laws: Sequence[Proposal], trial: HypothesisFit, where: Sequence[Location]) -> Proposal | None:
    """Where the formula of one of these laws, as it was fitted, says most of what they leave; None where it says
    less than a rival would have to. `where`: all places of the engine."""
    taken = {p.candidate.location.name for p in laws}
    found: list[Candidate] = []
    # a curve of steps is one place's own: it has no shape that another could have
    formed = [p for p in laws if p.candidate.formula.form.listed and not p.candidate.location.belongs_to_sensor]
    for p in {p.candidate.formula.form.name: p for p in reversed(formed)}.values():
        place = p.candidate.location
        free = [w for w in likes(place, where) if w.name not in taken and w.through is None and place.through is None]
        law = _as_fitted(p, trial)
        if free and np.isfinite(law.curve).all() and np.std(law.curve) > 0.0:
            found += scored(trial.found, trial.projection, free, [law], -float(np.log(len(free))))
    best = max(found, key=lambda c: c.weight, default=None)
    return proposal(best, trial.found.evidence.engine) if best is not None and best.weight > -RIVAL else None


def likes(place: Location, where: Sequence[Location]) -> list[Location]:
    """Places at which the same law may act, itself among them: those of its quantity, none of an instrument."""
    return [w for w in where if w.quantity == place.quantity and not (w.belongs_to_sensor or place.belongs_to_sensor)]


def _as_fitted(law: Proposal, trial: HypothesisFit) -> Formula:
    """Its formula with the fitted shape, free of the prior that it has paid."""
    formula = law.candidate.formula
    effect = law.option.hypothesis.effects[0]
    shape = {n: trial.coefficients[effect.parameter_name(n)][0] for n in formula.shape}
    of = seen_at(trial.found, formula.of)
    curve = over_records(formula.form, of, shape)
    return replace(formula, of=of, shape=shape, curve=curve, prior=0.0, tried=1)
