"""Which of the formulas that were scored are worth a fit inside the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.freeform import parameter_at
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.proposed import possible, proposed
from enginediag_cli.mismatch.laws.refined import reshaped
from enginediag_cli.mismatch.laws.scan import (
    Candidate,
    Scan,
    formulas_of,
    scored,
    seen_at,
)

WHERE = 6
"""Places and groups of variables of which the best form is fitted. The first by score is the first by fit in most
searches."""
SHAPED, ADDED = 8, 2
"""Forms of which the shape is sought beside those that a law has, best by score first; how many of them are fitted."""
REACH, OF_LARGEST = 25.0, 0.02
"""ln evidence by which a candidate is behind the best of all scores, beside a share of the statistic of that, from
where a fit does not bring it back: linear scores of large effects are wrong by so much."""


@dataclass(frozen=True)
class Proposal:
    """A candidate as an option that can be fitted."""

    candidate: Candidate
    option: Option

    @property
    def remembers(self) -> bool:
        """Whether it follows a variable along time."""
        return self.candidate.formula.form.remembers


def elsewhere(candidates: Sequence[Candidate], engine: Engine, most: int = WHERE) -> list[Proposal]:
    """The best form at each of the best places along the best variables; `candidates` likeliest first."""
    best: dict[object, Candidate] = {}
    for c in within_reach(candidates):
        best.setdefault((c.location.name, c.formula.groups), c)
    return [proposal(c, engine) for c in list(best.values())[:most]]


def along_the_same(scan: Scan, laws: Sequence[Proposal], fitted: HypothesisFit) -> list[Proposal]:
    """What may be added to laws at their first one's place, of formulas of the same variables or of some of them, by
    what the fit of these laws leaves. Beforehand one of such formulas is as likely as another, by their priors. What
    remembers is a law by itself: a fit of it takes whole recordings, some times over."""
    if any(p.remembers for p in laws):
        return []
    place, engine = laws[0].candidate.location, fitted.found.evidence.engine
    here = [p.candidate.formula for p in laws if p.candidate.location.name == place.name]
    seen = seen_at(fitted.found, [k for f in reversed(here) for k in f.of])
    of = {k.group: k for k in seen}
    sets = [(k,) for k in of.values()] + list(combinations(of.values(), 2))
    family = [f for s in sets for f in formulas_of(s, scan.known) if not f.form.remembers]
    whole = float(np.log(np.sum([np.exp(f.prior) / f.tried for f in family])))
    scores = scored(fitted.found, fitted.projection, [place], family, -whole)
    known = {p.option.label for p in laws}
    found = [proposal(c, engine) for c in reshaped(fitted, scores, SHAPED)]
    return [p for p in found if p.option.label not in known][:ADDED]


def within_reach(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those that a fit may bring first."""
    if not candidates:
        return []
    reach = candidates[0].weight - REACH - OF_LARGEST * candidates[0].statistic
    return [c for c in candidates if c.weight > reach and possible(c)]


def proposal(candidate: Candidate, engine: Engine) -> Proposal:
    """The law of a candidate as an option, under a name of its own among laws at that place."""
    formula = candidate.formula
    name = "_".join((formula.form.name, *(k.variable.name for k in formula.of)))
    return carrying(candidate, proposed(candidate, parameter_at(candidate.location, engine), name))


def carrying(candidate: Candidate, effect: Effect) -> Proposal:
    """A candidate by the effect that is its law."""
    driver = candidate.formula.of[0].variable.driver
    return Proposal(
        candidate, Option(FORMULA_OPTION, effect.label, candidate.location.component, driver, Hypothesis((effect,)))
    )
