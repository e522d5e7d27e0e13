"""A formula at a place as a law that an engine file can carry, absent, with its shape as the scan has found it."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.laws.grammar import Form
from enginediag_cli.mismatch.laws.scan import Candidate, KnownVariable
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.physics.law import Expression, Law, LawPlace, changes_variable, effect_place

AMPLITUDE = "a"
"""The letter of every form that is its size."""
DIGITS = 6
"""Significant digits of what stands in a formula as a number."""


def possible(candidate: Candidate) -> bool:
    """Whether its formula can be a law at its place: no input varies with itself."""
    through = candidate.location.through
    return through is None or not any(changes_variable(effect_place(through), k.variable) for k in candidate.formula.of)


def proposed(candidate: Candidate, parameter: Parameter, name: str) -> Effect:
    """The law of a candidate at `parameter`, which is its place's; its amplitude is absent."""
    formula = candidate.formula
    letters = dict(zip("xy", formula.of, strict=False))
    written = {n: k.variable.name for n, k in letters.items()}
    written |= {f"{n}0": f"{k.variable.reference:.{DIGITS}g}" for n, k in letters.items()}
    text = re.sub(r"\b[xy]0?\b", lambda m: written[m[0]], formula.form.text)
    text = re.sub(r"\((\w+) - 0\)", r"\1", text)
    acts, unit = acting(candidate.location, parameter)
    size = candidate.location.scale / float(np.std(formula.curve))
    coefficients = [
        Coefficient(AMPLITUDE, unit, "size", lower=-np.inf, upper=np.inf, sigma=size, typical=candidate.amplitude)
    ]
    for s in formula.form.shapes:
        at, x = formula.shape[s.letter], formula.of[s.of].values
        # a shape at a bound is another form: a threshold beyond what was flown is a straight line
        low, high = s.bounds(x)
        shape = Coefficient(
            s.letter,
            s.unit,
            "shape",
            absent=at,
            lower=low,
            upper=high,
            sigma=s.sigma(x),
            typical=at,
            free=True,
            closed=True,
        )
        coefficients.append(shape)
    variables = {k.variable.name: k.variable for k in formula.of}
    statement = statement_of(candidate.location, parameter, formula.form, formula.of)
    law = Law(name, acts, Expression.parse(text), variables, tuple(coefficients), statement)
    return Effect(law, acts.site, {})


def acting(location: Location, parameter: Parameter) -> tuple[LawPlace, str]:
    """What a law at a place acts on, and the unit of its size."""
    through = location.through
    factor = through is None and parameter.nominal == 1.0 and parameter.unit in ("", "1")
    unit = "1" if factor else parameter.unit or "1"
    return LawPlace(parameter.name, parameter.component, unit, factor) if through is None else effect_place(
        through
    ), unit


def statement_of(location: Location, parameter: Parameter, form: Form, of: Sequence[KnownVariable]) -> str:
    """A law in words."""
    words = " and ".join(k.variable.words for k in of)
    place = (parameter.words if location.through is None else location.words) or spelled(parameter.name)
    return f"{place[0].upper()}{place[1:]} changes {form.words} {words}."
