"""The mean of what a law may be (`mean`) as one law that an engine file carries: a sum of formulas with numbers in the
places of their coefficients, times one size.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Coefficient, Effect, Term
from enginediag_cli.mismatch.fit.freeform import parameter_at
from enginediag_cli.mismatch.laws.additive import additive_of
from enginediag_cli.mismatch.laws.finding import Share
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.grammar import Form
from enginediag_cli.mismatch.laws.mean import Member, mean_of
from enginediag_cli.mismatch.laws.proposed import AMPLITUDE, DIGITS, acting, statement_of
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, Known, number_of_groups
from enginediag_cli.mismatch.laws.shortlist import Proposal, carrying, proposal
from enginediag_cli.mismatch.laws.smooth import prior_of_variables
from enginediag_cli.mismatch.laws.steps import OWN
from enginediag_cli.physics.laws.expression import Expression
from enginediag_cli.physics.laws.law import Law

MOST_VARIABLES = 2
"""Of a law: of more no smooth curves are weighed."""
SUM = "as a sum of smooth curves of"
AVERAGE = Form("average", "as the average of the likely forms of", "")


@dataclass(frozen=True)
class Averaged:
    """An average as a law that can be fitted, its forms, likeliest first, and their ln evidence together, of which
    `place` is ln of the prior of a place."""

    law: Proposal
    forms: tuple[Share, ...]
    evidence: float
    place: float

    def fitted(self, found: Fitted, beside: float) -> Fitted:
        """The average as it was fitted, as likely as all its forms together: they have paid for shapes that it has no
        more."""
        prior = self.evidence - found.evidence
        formula = replace(self.law.candidate.formula, prior=prior - self.place)
        candidate = replace(self.law.candidate, formula=formula, prior=prior, weight=self.evidence)
        law = replace(self.law, candidate=candidate)
        return replace(found, laws=(law,), evidence=self.evidence, beside=beside, forms=self.forms)


def average_of(first: Fitted, forms: Sequence[Member], says: Says, prior: float) -> Averaged | None:
    """The average of `forms` of the first one's variables at its place (`members_of`), and of all smooth curves of
    these; `says`: what that place does, `prior`: ln, of the place. None where there is none that is better told than a
    form."""
    if first.remembers:
        return None  # what it was before is no function of what its variables are now
    members = [*forms]
    known = says.known
    of = tuple(k for k in known if k.variable.name in first.names)
    if len(of) <= MOST_VARIABLES:
        members.append(smooth_member(says, of, number_of_groups(known), prior))
    alone = None if _is_curve(first) else first.curve(known)
    mean = mean_of(members, alone, says.any)
    if mean is None:
        return None
    told = tuple(Share(m.words, m.text, q) for m, q in mean.of)
    together = float(np.logaddexp.reduce([m.evidence for m in members]))
    return Averaged(_proposal(first, told, mean.curve, of), told, together, prior)


def smooth_member(says: Says, of: Sequence[Known], groups: int, prior: float) -> Member:
    """All smooth curves of variables, of so many groups in all, as one of what may be, as likely beforehand as laws
    that have no listed form are; `prior`: ln, of the place."""
    smooth = additive_of(says, of)
    whole = smooth.evidence + prior_of_variables(of, groups) + prior
    return Member((OWN.words if len(of) == 1 else SUM,), smooth.text, smooth.curve, whole)


def members_of(
    first: Fitted, fitted: Sequence[Fitted], sought: Sequence[Candidate], known: Sequence[Known]
) -> list[Member]:
    """Laws of the first one's variables at its place, `fitted` or only `sought`, single smooth curves apart."""
    place, names = first.where[0], first.names
    found, forms = list[Member](), set[tuple[str, ...]]()
    for f in fitted:
        if f.where[0] != place or not f.at_one_place or f.names != names or _is_curve(f) or f.remembers:
            continue
        listed = len(f.laws) == 1 and f.laws[0].candidate.formula.form.listed
        forms |= {f.laws[0].candidate.formula.what} if listed else set()
        words = tuple(p.candidate.formula.form.words for p in f.laws)
        found.append(Member(words, _text(f.effects, f.trial.values), f.curve(known), f.evidence))
    for k in sought:
        if (
            k.location.name == place
            and {x.variable.name for x in k.formula.of} == names
            and k.formula.what not in forms
            and not k.formula.form.remembers
        ):
            (effect,) = proposal(k, first.trial.found.evidence.engine).option.hypothesis.effects
            shape = {effect.parameter_name(n): v for n, v in {**k.formula.shape, AMPLITUDE: k.amplitude}.items()}
            curve = k.amplitude * k.formula.curve
            found.append(Member((k.formula.form.words,), _text([effect], shape), curve, k.weight))
    return found


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


def _proposal(first: Fitted, forms: Sequence[Share], mean: np.ndarray, of: tuple[Known, ...]) -> Proposal:
    """The average as a law; what its size multiplies has a standard deviation of 1 over the records."""
    place, engine = first.laws[0].candidate.location, first.trial.found.evidence.engine
    size = float(np.std(mean))
    over = size * sum(x.probability for x in forms)
    text = " + ".join(f"{x.probability / over:.{DIGITS}g} * ({x.text})" for x in forms)
    parameter = parameter_at(place, engine)
    acts, unit = acting(place, parameter)
    law = Law(
        "_".join((AVERAGE.name, *(k.variable.name for k in of))),
        acts,
        Expression.parsed(f"{AMPLITUDE} * ({text})"),
        {k.variable.name: k.variable for k in of},
        (Coefficient(AMPLITUDE, unit, "size", 0.0, -np.inf, np.inf, place.scale, size),),
        statement_of(place, parameter, AVERAGE, of),
    )
    candidate = Candidate(place, Formula(AVERAGE, of, {}, mean / size, 0.0), size, 0.0, 0.0, 0.0)
    return carrying(candidate, Effect(law, acts.site, {}))
