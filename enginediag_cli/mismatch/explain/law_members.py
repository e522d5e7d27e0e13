"""Laws as members of a set: formulas at the places where free curves say that something unlisted acts.

A free curve says where and along what; at its place every formula is scored at the same fit, beside all members that
the set has. A law costs what its place, variables and form were chosen from. Beside a law of the same variables at the
same place a further form costs the choice among such forms alone, and the same formula at another place the choice
among the places of that quantity: one law then says what two would.

    price of a set of laws = −Σ ln prior,   the first of each kind whole, what goes with it as its choice

Whole it has the share of probability that unlisted physics has beside effects and changes in time (`currency`).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.currency import FREE_FORM, Offer, Prices
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.elsewhere_too import elsewhere_too, likes
from enginediag_cli.mismatch.laws.fitted import ln_within
from enginediag_cli.mismatch.laws.refined import reshaped
from enginediag_cli.mismatch.laws.scan import (
    Candidate,
    Formula,
    formulas,
    formulas_over,
    known_variables,
    scored,
    seen_at,
)
from enginediag_cli.mismatch.laws.shortlist import Proposal, elsewhere, proposal

PLACES = 4
"""Places of free curves, most promising first, at which formulas are scored."""
OFFERED = 3
"""Laws, of different places or variables, that one trial is offered, and as many that go with a law that it has."""

SHAPED, SHAPED_ALONG = 16, 6
"""Forms of which the shape is sought before they are offered, best by score first, of all places and of one's own
variables."""

Curves = Sequence[Offer]


@dataclass
class LawMembers:
    """Offers laws for what a trial leaves; `prices` tell what all the laws of a set cost. `known`: by label."""

    base: IdentifiedHypothesis
    prices: Prices
    known: dict[str, Proposal] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.where = locations(self.base)
        self.variables = known_variables(self.base)
        self.formulas = list(formulas(self.variables))
        self._whole = {f.what: f.prior for f in self.formulas}
        self.prices.of_laws, self.prices.within = self.price, self.within

    def learn(self, proposals: Iterable[Proposal]) -> None:
        """Laws that were fitted elsewhere may be members, too. Averages and curves of one name are those that were
        fitted last."""
        for p in proposals:
            if p.option.label not in self.known or not p.candidate.formula.form.listed:
                self.known[p.option.label] = p
                self.prices.own[p.option.label] = self.price([p.option])

    def offers(self, trial: HypothesisFit, curves: Curves) -> list[Offer]:
        """Laws beside what a trial has, at the places of these free curves and beside its own laws."""
        carried = [self.known[o.label] for o in trial.options if o.kind == FORMULA_OPTION]
        targets = [d.target for c in curves for d in c.option.hypothesis.discrepancies]
        names = list(dict.fromkeys(targets))[:PLACES]
        here = [p for p in self.where if p.parameter in names]
        scores = self._scored(trial, here, self._usable(trial), self._of_a_place)
        found = elsewhere(reshaped(trial, scores, SHAPED), self._engine, OFFERED)
        for place in {p.candidate.location.name: p.candidate.location for p in carried}.values():
            found += self._along_the_same(trial, place, carried)
        too = elsewhere_too(carried, trial, self.where) if carried else None
        self.learn([*found, *([too] if too else [])])
        own = {o.label for o in trial.options}
        new = {p.option.label: p for p in (*found, *([too] if too else [])) if p.option.label not in own}
        return [self._offer(p, trial) for p in new.values()]

    def price(self, options: Sequence[Option]) -> float:
        """−ln of the probability that these laws are those that act."""
        left = [self.known[o.label].candidate for o in sorted(options, key=lambda o: o.label)]
        paid, taken = 0.0, list[Candidate]()
        while left:
            # the cheapest beside those that are paid for, whatever order they come in
            prior, k = max((self._prior(law, taken), -k) for k, law in enumerate(left))
            taken.append(left.pop(-k))
            paid -= prior
        return paid

    def within(self, trial: HypothesisFit) -> float:
        """What physics says of the laws of a trial: ln, 0 or less."""
        return ln_within([self.known[o.label] for o in trial.options if o.kind == FORMULA_OPTION], trial)

    def _offer(self, p: Proposal, trial: HypothesisFit) -> Offer:
        """Its promise is its weight without the prior that it was scored with, less what it adds to the price."""
        laws = [o for o in trial.options if o.kind == FORMULA_OPTION]
        more = self.price([*laws, p.option]) - self.price(laws)
        return Offer(p.option, self.prices.own[p.option.label], p.candidate.weight - p.candidate.prior - more)

    def _prior(self, law: Candidate, others: Sequence[Candidate]) -> float:
        """ln: of a law by itself, of a further form, or of the same formula at another place."""
        f, place = law.formula, law.location
        if not f.form.listed and any(o.location.name == place.name and not o.formula.form.listed for o in others):
            return f.prior  # a part of one curve, or surface: its place is paid for
        alone = self._whole.get(f.what, f.prior) + self._of_a_place + float(np.log(FREE_FORM))
        if any(o.location.name == place.name and f.groups <= o.formula.groups for o in others):
            groups = next(o.formula.groups for o in others if o.location.name == place.name)
            return max(alone, self._whole.get(f.what, f.prior) - self._family(groups | f.groups))
        machines = [w.name for w in likes(place, self.where)]
        if any(o.formula.what == f.what and o.location.name in machines for o in others):
            return max(alone, -float(np.log(len(machines))))
        return alone

    def _family(self, groups: frozenset[int]) -> float:
        """ln of the probability of all formulas of these variables."""
        return float(np.log(sum(np.exp(f.prior) / f.tried for f in self.formulas if f.groups <= groups)))

    def _along_the_same(self, trial: HypothesisFit, place: Location, carried: Sequence[Proposal]) -> list[Proposal]:
        """Further forms of the variables that its laws at a place have."""
        own = [p.candidate.formula for p in carried if p.candidate.location.name == place.name]
        groups: frozenset[int] = frozenset().union(*(f.groups for f in own))
        family = [f for f in self._usable(trial) if f.groups <= groups]
        scores = self._scored(trial, [place], family, -self._family(groups))
        best = reshaped(trial, scores, SHAPED_ALONG)[:OFFERED]
        known = {f.what for f in own}
        return [proposal(c, self._engine) for c in best if c.formula.what not in known]

    def _scored(
        self, trial: HypothesisFit, where: Sequence[Location], laws: Sequence[Formula], prior: float
    ) -> list[Candidate]:
        return scored(trial.found, trial.projection, where, laws, prior)

    def _usable(self, trial: HypothesisFit) -> list[Formula]:
        """Formulas over the records that the trial has, of variables as it has them."""
        if not np.array_equal(trial.found.number, self.base.number):
            return list(formulas(known_variables(trial.found)))
        return formulas_over(seen_at(trial.found, self.variables), self.variables, self.formulas)

    @property
    def _of_a_place(self) -> float:
        """ln: beforehand one is as likely as another."""
        return -float(np.log(max(len(self.where), 1)))

    @property
    def _engine(self) -> Engine:
        return self.base.evidence.engine
