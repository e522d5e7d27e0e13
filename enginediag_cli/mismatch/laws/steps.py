"""A smooth curve that an engine file can carry: a sum of steps, for laws of which no listed form is enough.

    f = Σ_k a_k s_k(x)     s_k(x) = tanh((x − c_k)/w) − tanh((x₀ − c_k)/w)     a_k ~ N(0, σ²)

with places c_k evenly over what was flown and w their distance: any curve that bends no faster, 0 at the design point,
and constant beyond what was flown, where nothing is known. Of two variables their own sums, and the products of steps
s_k(x) s_l(y). It has no shape to fit, its sizes are linear, and their prior keeps them where records tell nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.laws.grammar import EDGES_OF_STEPS, Form, span
from enginediag_cli.mismatch.laws.proposed import acting, place_of, statement_of
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, Known
from enginediag_cli.mismatch.laws.shortlist import Proposal, carrying
from enginediag_cli.physics.laws.expression import LONGEST, Expression
from enginediag_cli.physics.laws.law import Law

ALONE, BESIDE, TOGETHER = 6, 4, 3
"""Steps along one variable; along each of two; and along each in their products."""
DIGITS = 5
"""Significant digits of places and widths in a formula."""

OWN = Form("smooth", "as a smooth curve of", "")
BOTH = Form("smooth_product", "as a smooth surface of", "")


@dataclass(frozen=True)
class Part:
    """One law of a smooth curve: `terms` whose sizes are its coefficients, and what multiplies them, `by`; `number` of
    its name where there are more of the same variables."""

    form: Form
    of: tuple[Known, ...]
    terms: tuple[str, ...]
    by: str = ""
    number: str = ""

    @property
    def letters(self) -> list[str]:
        return [f"a{k + 1}" for k in range(len(self.terms))]

    @property
    def text(self) -> str:
        total = " + ".join(f"{a} * {t}" for a, t in zip(self.letters, self.terms, strict=True))
        return f"{self.by}({total})" if self.by else total

    @property
    def name(self) -> str:
        return "_".join((self.form.name, *(k.variable.name for k in self.of), *filter(None, [self.number])))


def as_steps(place: Location, of: Sequence[Known], size: float, prior: float, engine: Engine) -> tuple[Proposal, ...]:
    """Laws that together are a smooth curve of one variable or surface of two at a place; `size`: standard deviation
    of a curve there over the records, `prior`: ln, of place and variables, which the first law bears. None where the
    variables' names make formulas that are too long."""
    parts = [Part(OWN, (k,), _steps(k, ALONE if len(of) == 1 else BESIDE)) for k in of]
    if len(of) == 2:
        x, y = of
        for number, step in enumerate(_steps(x, TOGETHER), start=1):
            parts.append(Part(BOTH, (x, y), _steps(y, TOGETHER), f"{step} * ", str(number)))
    if any(len(p.text) > LONGEST for p in parts):
        return ()
    return tuple(_proposal(place, p, size, prior if p is parts[0] else 0.0, engine) for p in parts)


def _steps(k: Known, count: int) -> tuple[str, ...]:
    """Steps of a variable, evenly over what was flown."""
    low, high = (float(q) for q in np.quantile(k.values, EDGES_OF_STEPS))
    name, x0 = k.variable.name, k.variable.reference
    w = _rounded(max((high - low) / (count - 1), 1e-3 * span(k.values)))
    found = []
    for c in map(_rounded, np.linspace(low, high, count)):
        found.append(f"(tanh(({name} - {c!r}) / {w!r}) - ({float(np.tanh((x0 - c) / w))!r}))")
    return tuple(found)


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")


def _proposal(place: Location, part: Part, size: float, prior: float, engine: Engine) -> Proposal:
    letters, expression = part.letters, Expression.parsed(part.text)
    values = {k.variable.name: k.values for k in part.of}
    curve = np.asarray(expression.at({**values, **dict.fromkeys(letters, 1.0)}), float)
    parameter = place_of(place, engine)
    acts, unit = acting(place, parameter)
    coefficients = tuple(Coefficient(a, unit, "size", 0.0, -np.inf, np.inf, size, 0.0) for a in letters)
    variables = {k.variable.name: k.variable for k in part.of}
    statement = statement_of(place, parameter, part.form, part.of)
    law = Law(part.name, acts, expression, variables, coefficients, statement)
    formula = Formula(part.form, part.of, {}, curve, prior)
    return carrying(Candidate(place, formula, 0.0, 0.0, prior, prior), Effect(law, acts.site, {}))
