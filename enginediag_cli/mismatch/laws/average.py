"""The average of what a law may be, where none of its forms is settled: one law in the place of all.

    f̄ = Σ_i p_i f_i      p_i: probability of a law among those of the same variables at one place

with the coefficients that each has been fitted with, or sought at the fit that carries a law there. Several forms that
are nearly as likely err each in its own way, and their average less than the likeliest of them: in a linear twin of the
search (`tests/benchmarks/law_twin.py`) it is within noise of the truth in two per cent more of all laws, and in four
per cent more of those of two variables that no form of the grammar is. Where the likeliest form has most of what all
listed ones have, or these flights do not tell it from the average, it is told as it stands: its coefficients say more
to a reader than an average does. That is so in three of four, and costs half a per cent.

Source: J. A. Hoeting et al., Statistical Science 14 (1999) 382–417.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.term import Coefficient, Effect, Term
from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.laws.band import summed
from enginediag_cli.mismatch.laws.finding import Share
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.grammar import Form
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.proposed import AMPLITUDE, DIGITS, acting, place_of, statement_of
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, Known
from enginediag_cli.mismatch.laws.shortlist import Proposal, carrying, proposal
from enginediag_cli.physics.laws.expression import LONGEST, Expression
from enginediag_cli.physics.laws.law import Law

SETTLED = 0.7
"""Share of all listed forms from which one is told as it stands. Judgement: three of four."""
THE_SAME = 0.5
"""Non-centrality below which these flights do not tell the likeliest form from the average: the form is told."""
LEAST = 0.01
"""Probability from which a form is part of the average."""
MISSED = 0.1
"""Probability of forms for which a formula has no room, up to which the others are still an average of all."""

BESIDE = 4 * DIGITS
"""Letters of a form's weight, its sign and parentheses, about."""

AVERAGE = Form("average", "as the average of the likely forms of", "")


@dataclass(frozen=True)
class Averaged:
    """An average as a law that can be fitted, its forms, likeliest first, and their ln evidence together."""

    law: Proposal
    forms: tuple[Share, ...]
    evidence: float

    def fitted(self, found: Fitted, beside: float) -> Fitted:
        """The average as it was fitted, as likely as all its forms together: they have paid for shapes that it has no
        more."""
        prior = self.evidence - found.evidence
        law = replace(self.law, candidate=replace(self.law.candidate, prior=prior, weight=self.evidence))
        return replace(found, laws=(law,), evidence=self.evidence, beside=beside, forms=self.forms)


@dataclass(frozen=True)
class Member:
    """What may be: `curve` (N,) over the records, ln evidence, whether it is a single listed form."""

    words: tuple[str, ...]
    text: str
    curve: np.ndarray
    evidence: float
    listed: bool


@dataclass(frozen=True)
class Mean:
    """`curve` (N,) of an average, of these members with their probabilities, likeliest first."""

    of: tuple[tuple[Member, float], ...]
    curve: np.ndarray


def mean_of(members: Sequence[Member], says: AnyCurve) -> Mean | None:
    """The average of laws of the same variables at one place, of which it says this. None where a form is
    settled, or is the average as far as it was flown, or a formula has no room for enough of them."""
    evidence = [m.evidence for m in members]
    best = members[int(np.argmax(evidence))]
    if shares([m.evidence for m in members if m.listed or not best.listed]).max() >= SETTLED:
        return None
    chosen, room = list[tuple[Member, float]](), LONGEST
    for q, m in sorted(zip(shares(evidence), members, strict=True), key=lambda x: -x[0]):
        own = len(m.text) + BESIDE
        if q >= LEAST and own <= room:
            chosen.append((m, float(q)))
            room -= own
    told = sum(q for _, q in chosen)
    if told < 1.0 - MISSED:
        return None
    curve = np.sum([q * m.curve for m, q in chosen], axis=0) / told
    if not np.std(curve) or says.apart(best.curve, curve) < THE_SAME:
        return None
    return Mean(tuple(chosen), curve)


def average_of(
    first: Fitted, fitted: Sequence[Fitted], sought: Sequence[Candidate], known: Sequence[Known], says: AnyCurve
) -> Averaged | None:
    """The average of laws of the first one's variables at its place, `fitted` or only `sought`; `says`: what that place
    does. None where there is none that is better told than a form."""
    members = _members(first, fitted, sought, known)
    mean = mean_of(members, says)
    if mean is None:
        return None
    forms = tuple(Share(m.words, m.text, q) for m, q in mean.of)
    together = float(np.logaddexp.reduce([m.evidence for m in members]))
    return Averaged(_proposal(first, forms, mean.curve, known), forms, together)


def _members(
    first: Fitted, fitted: Sequence[Fitted], sought: Sequence[Candidate], known: Sequence[Known]
) -> list[Member]:
    place, names = first.where[0], _names(first)
    values, found, forms = {k.variable.name: k.values for k in known}, list[Member](), set[tuple[str, ...]]()
    for f in fitted:
        if f.where[0] != place or not f.at_one_place or _names(f) != names:
            continue
        c = {n: value for n, (value, _) in f.trial.coefficients.items()}
        curve = summed(f.effects, values, c)
        listed = len(f.laws) == 1 and f.laws[0].candidate.formula.form.listed
        forms |= {f.laws[0].candidate.formula.what} if listed else set()
        words = tuple(p.candidate.formula.form.words for p in f.laws)
        found.append(Member(words, _text(f.effects, c), curve, f.evidence, listed))
    for k in sought:
        if (
            k.location.name == place
            and {x.variable.name for x in k.formula.of} == names
            and k.formula.what not in forms
        ):
            (effect,) = proposal(k, first.trial.found.evidence.engine).option.hypothesis.effects
            shape = {effect.parameter_name(n): v for n, v in {**k.formula.shape, AMPLITUDE: k.amplitude}.items()}
            curve = k.amplitude * k.formula.curve
            found.append(Member((k.formula.form.words,), _text([effect], shape), curve, k.weight, True))
    return found


def _names(f: Fitted) -> frozenset[str]:
    """Variables of what acts at the first one's place."""
    return frozenset(k.variable.name for p in f.laws for k in p.candidate.formula.of)


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


def _proposal(first: Fitted, forms: Sequence[Share], mean: np.ndarray, known: Sequence[Known]) -> Proposal:
    """The average as a law; what its size multiplies has a standard deviation of 1 over the records."""
    place, engine = first.laws[0].candidate.location, first.trial.found.evidence.engine
    size = float(np.std(mean))
    over = size * sum(x.probability for x in forms)
    text = " + ".join(f"{x.probability / over:.{DIGITS}g} * ({x.text})" for x in forms)
    of = tuple(k for k in known if k.variable.name in _names(first))
    parameter = place_of(place, engine)
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
