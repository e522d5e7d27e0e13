"""Every form with the shape that suits a place best, before anything is fitted in the simulator.

A scan tries a form's shape at a few values, between which a narrow one is missed, and at a model without the law, which
answers a large one with other derivatives. Here the shapes of the best tries are sought (`shaping`) at a fit that
carries a law at the place already, which is added back to what this fit leaves.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.proposed import possible
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, KnownVariable, of_same_groups, of_same_variables
from enginediag_cli.mismatch.laws.shaping import Shaping
from enginediag_cli.mismatch.laws.within import Room, ends_of
from enginediag_cli.progress import stage

ALIKE = 6
"""Forms, likeliest first, of which all variables of the same groups are tried."""
ROUNDS = 12
"""Steps of each shape: what has not settled then is as good as it has become."""


@stage("shaping laws")
def refined(said: Said, tries: Sequence[Formula], known: Sequence[KnownVariable], prior: float) -> list[Candidate]:
    """Every form of the same variables once, likeliest first, from these tries; the likeliest also of all variables of
    the same groups. `prior`: ln, of the place. `weight`: ln evidence against the base."""
    found = _sought(said, tries, prior)
    of = set(map(_form_of, found))
    others = [f for c in found[:ALIKE] for f in of_same_groups(c.formula, known)]
    more = _sought(said, others, prior)
    return sorted([*found, *(c for c in more if _form_of(c) not in of)], key=lambda c: -c.weight)


def reshaped(trial: HypothesisFit, candidates: Sequence[Candidate], most: int) -> list[Candidate]:
    """The best candidates of as many forms, likeliest first, beside what a trial has, each with the shape that suits
    it."""
    best: dict[object, Candidate] = {}
    for c in candidates:
        best.setdefault((c.location.name, _form_of(c)), c)
    chosen = list(best.values())[:most]
    found: list[Candidate] = []
    for place in {c.location.name: c.location for c in chosen}.values():
        own = [c for c in chosen if c.location.name == place.name]
        nothing = np.zeros(len(trial.found.number))
        at = Carried(trial.found, trial.projection, place, nothing, 0.0, ())
        prior = own[0].prior - own[0].formula.prior
        tries = [f for c in own for f in (c.formula, *of_same_variables(c.formula))]
        found += _sought(Said(at), tries, prior)
    return sorted(found, key=lambda c: -c.weight)


def _form_of(c: Candidate) -> tuple[str, frozenset[str]]:
    return c.formula.form.name, frozenset(k.variable.name for k in c.formula.of)


def _sought(said: Said, tries: Sequence[Formula], prior: float) -> list[Candidate]:
    """The best shapes, of each form of the same variables once."""
    shaping = [Shaping.of(f) for f in said.best(tries)]
    for _ in range(ROUNDS):
        said.look([s for s in shaping if not s.settled])
    found: dict[object, Candidate] = {}
    room = Room.at(said.at.found, said.at.place)
    for s in sorted(shaping, key=lambda s: -s.evidence - s.formula.prior):
        if np.isfinite(s.evidence):
            formula, own = s.found(), s.formula.prior + prior
            within = float(room.of_curves(s.amplitude, ends_of(formula.curve), s.statistic))
            weight = said.gain + s.evidence + own + within
            c = Candidate(said.at.place, formula, s.amplitude, s.statistic, weight, own)
            found.setdefault(_form_of(c), c)
    return [c for c in found.values() if possible(c)]
