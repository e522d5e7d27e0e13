"""The mean of what a law may be (`mean`) as one law that an engine file carries: a sum of formulas with numbers in the
places of their coefficients, times one size.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Coefficient, Effect, Term
from enginediag_cli.mismatch.fit.freeform import parameter_at
from enginediag_cli.mismatch.laws.additive import additive_of
from enginediag_cli.mismatch.laws.finding import Share
from enginediag_cli.mismatch.laws.fitted import LIKELIER, Fitted, Where
from enginediag_cli.mismatch.laws.grammar import Form
from enginediag_cli.mismatch.laws.mean import Along, Mean, Member, mean_of
from enginediag_cli.mismatch.laws.proposed import AMPLITUDE, DIGITS, acting, statement_of
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, KnownVariable, number_of_groups
from enginediag_cli.mismatch.laws.shortlist import Proposal, carrying, proposal
from enginediag_cli.mismatch.laws.smooth import prior_of_variables
from enginediag_cli.mismatch.laws.steps import OWN, Bends
from enginediag_cli.physics.law import Expression, Law

MOST_VARIABLES = 2
"""Of a law: of more no smooth curves are weighed."""
MOST_SETS, LIKELY = 4, 0.01
"""Of variables, likeliest first, whose laws are parts of an average, and how likely they must be beside the first."""
SUM = "as a sum of smooth curves of"
AVERAGE = Form("average", "as the average of the likely forms of", "")


@dataclass(frozen=True)
class Averaged:
    """An average as a law that can be fitted, its forms, likeliest first, and the ln evidence of those of the `where`
    that it is told for, of which `place` is ln of the prior of a place."""

    law: Proposal
    forms: tuple[Share, ...]
    where: Where
    evidence: float
    place: float

    def fitted(self, found: Fitted, beside: float) -> Fitted:
        """The average as it was fitted, as likely as all its forms together: they have paid for shapes that it has no
        more."""
        prior = self.evidence - found.evidence
        formula = replace(self.law.candidate.formula, prior=prior - self.place)
        candidate = replace(self.law.candidate, formula=formula, prior=prior, weight=self.evidence)
        law = replace(self.law, candidate=candidate)
        return replace(found, laws=(law,), evidence=self.evidence, beside=beside, forms=self.forms, told_for=self.where)


def average_of(first: Fitted, along: Sequence[Along], says: Says, prior: float) -> Averaged | None:
    """The average of what a law at the first one's place may be `along` its variables, and others after these, and of
    all smooth curves of each; `says`: what that place does, `prior`: ln, of the place. None where there is none that is
    better told than a form."""
    whole = [with_smooth(a, says, prior) for a in along]
    alone = None if _is_curve(first) else first.curve(says.known)
    mean = mean_of(whole, alone, says.any)
    if mean is None:
        return None
    together = float(np.logaddexp.reduce([m.evidence for m in whole[0].members]))
    return Averaged(_proposal(first, mean), _shares(mean), first.where, together, prior)


def with_smooth(along: Along, says: Says, prior: float) -> Along:
    """And along all smooth curves of these variables; `prior`: ln, of the place."""
    of = _named(frozenset(k.variable.name for k in along.of), says.known)
    if len(of) > MOST_VARIABLES:
        return along
    return replace(along, of=of, members=(*along.members, smooth_member(says, of, number_of_groups(says.known), prior)))


def _shares(mean: Mean) -> tuple[Share, ...]:
    return tuple(
        Share(x.member.words, x.member.text, x.probability, tuple(k.variable for k in x.of), x.weight > 0.0)
        for x in mean.of
    )


def smooth_member(says: Says, of: Sequence[KnownVariable], groups: int, prior: float) -> Member:
    """All smooth curves of variables, of so many groups in all, as one of what may be, as likely beforehand as laws
    that have no listed form are; `prior`: ln, of the place."""
    smooth = additive_of(says, of)
    whole = smooth.evidence + prior_of_variables(of, groups) + prior
    return Member((OWN.words if len(of) == 1 else SUM,), smooth.text, smooth.curve, whole)


@dataclass(frozen=True)
class Sought:
    """What a search knows: laws `fitted`, likeliest first, or only `sought`, and how finely smooth curves bend."""

    fitted: Sequence[Fitted]
    sought: Sequence[Candidate]
    bends: Mapping[Where, Bends]

    def along(
        self, where: Where, known: Sequence[KnownVariable], totals: Mapping[Where, float], engine: Engine
    ) -> list[Along]:
        """What a law at a place may be along the variables of `where`, and then along others of which anything is
        known there and that are likely enough to be a part; `totals`: ln evidence of each place and variables."""
        of: dict[Where, tuple[KnownVariable, ...]] = {}
        for f in self.fitted:
            if f.at_one_place and not f.remembers:
                of.setdefault(f.where, _named(f.names, known))
        for c in self.sought:
            if not c.formula.form.remembers:
                of.setdefault((c.location.name, c.formula.groups), c.formula.of)
        for w, b in self.bends.items():
            of.setdefault(w, b.of)
        least = totals[where] + float(np.log(LIKELY))
        others = (w for w in of if w[0] == where[0] and w != where and totals.get(w, -np.inf) > least)
        kept = [where, *sorted(others, key=lambda w: -totals[w])][:MOST_SETS]
        return [Along(of[w], totals[w], tuple(self.members(w[0], of[w], known, engine))) for w in kept]

    def members(
        self, place: str, of: Sequence[KnownVariable], known: Sequence[KnownVariable], engine: Engine
    ) -> list[Member]:
        """Laws at a place along these variables, single smooth curves apart."""
        names = {k.variable.name for k in of}
        found, forms = list[Member](), set[tuple[str, ...]]()
        for f in self.fitted:
            if f.where[0] != place or not f.at_one_place or f.names != names or _is_curve(f) or f.remembers:
                continue
            if any(_predicts_instead(g, f) for g in self.fitted):
                continue
            listed = len(f.laws) == 1 and f.laws[0].candidate.formula.form.listed
            forms |= {f.laws[0].candidate.formula.what} if listed else set()
            words = tuple(p.candidate.formula.form.words for p in f.laws)
            found.append(Member(words, _text(f.effects, f.trial.values), f.curve(known), f.evidence))
        for c in self.sought:
            if (
                c.location.name == place
                and {x.variable.name for x in c.formula.of} == names
                and c.formula.what not in forms
                and not c.formula.form.remembers
            ):
                (effect,) = proposal(c, engine).option.hypothesis.effects
                shape = {effect.parameter_name(n): v for n, v in {**c.formula.shape, AMPLITUDE: c.amplitude}.items()}
                curve = c.amplitude * c.formula.curve
                found.append(Member((c.formula.form.words,), _text([effect], shape), curve, c.weight))
        return found


def _named(names: frozenset[str], known: Sequence[KnownVariable]) -> tuple[KnownVariable, ...]:
    return tuple(k for k in known if k.variable.name in names)


def _predicts_instead(more: Fitted, fewer: Fitted) -> bool:
    """Whether it is the same with a further form that prediction has asked for, and as likely for that reason alone."""
    options = {o.label for o in fewer.options}
    return options < {o.label for o in more.options} and more.evidence <= fewer.evidence + LIKELIER


def _is_curve(f: Fitted) -> bool:
    """Whether it is a smooth curve, or a sum of one of each of two: of all of them together there is a member."""
    return all(p.candidate.formula.form is OWN for p in f.laws)


def _text(effects: Sequence[Effect], c: Mapping[str, float]) -> str:
    """The formula of laws together, with numbers in the places of their coefficients; `c`: by parameter name."""
    return " + ".join(
        _with_numbers(e.term, {k.name: c[e.parameter_name(k.name)] for k in e.term.COEFFICIENTS}) for e in effects
    )


def _with_numbers(law: Term, values: Mapping[str, float]) -> str:
    assert isinstance(law, Law)
    letters = "|".join(map(re.escape, values))
    return re.sub(rf"\b({letters})\b", lambda m: _number(values[m[0]]), law.expression.text)


def _number(x: float) -> str:
    return f"{x:.{DIGITS}g}" if x >= 0.0 else f"({x:.{DIGITS}g})"


def _proposal(first: Fitted, mean: Mean) -> Proposal:
    """The average as a law; what its size multiplies has a standard deviation of 1 over the records."""
    place, engine = first.laws[0].candidate.location, first.trial.found.evidence.engine
    # those that it is told for lead
    parts = sorted(mean.written, key=lambda x: {k.variable.name for k in x.of} != first.names)
    of = tuple({k.variable.name: k for x in parts for k in x.of}.values())
    size = float(np.std(mean.curve))
    text = " + ".join(f"{x.weight / size:.{DIGITS}g} * ({x.member.text})" for x in parts)
    parameter = parameter_at(place, engine)
    acts, unit = acting(place, parameter)
    law = Law(
        "_".join((AVERAGE.name, *(k.variable.name for k in of))),
        acts,
        Expression.parse(f"{AMPLITUDE} * ({text})"),
        {k.variable.name: k.variable for k in of},
        (Coefficient(AMPLITUDE, unit, "size", lower=-np.inf, upper=np.inf, sigma=place.scale, typical=size),),
        statement_of(place, parameter, AVERAGE, of),
    )
    candidate = Candidate(place, Formula(AVERAGE, of, {}, mean.curve / size, 0.0), size, 0.0, 0.0, 0.0)
    return carrying(candidate, Effect(law, acts.site, {}))
