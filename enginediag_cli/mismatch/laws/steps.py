"""A smooth curve that an engine file can carry: a sum of steps, for laws of which no listed form is enough.

    f = Σ_k a_k s_k(x)     s_k(x) = tanh((x − c_k)/w) − tanh((x₀ − c_k)/w)     a_k ~ N(0, σ²)

with places c_k evenly over all that was flown and w their distance: any curve that bends no faster, 0 at the design
point, and constant beyond it, where nothing is known. How many steps of one variable there are, and σ, is told by their
evidence: as many as the curve bends. Of two variables their own sums, and the products of steps s_k(x) s_l(y). It has
no shape to fit, its sizes are linear, and their prior keeps them where records tell nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.freeform import Location, parameter_at
from enginediag_cli.mismatch.laws.grammar import EDGES_OF_STEPS, FORMS, Form, span
from enginediag_cli.mismatch.laws.linear import Linear, evidence_of_all
from enginediag_cli.mismatch.laws.proposed import acting, statement_of
from enginediag_cli.mismatch.laws.said import Says
from enginediag_cli.mismatch.laws.scan import Candidate, Formula, KnownVariable, share_of_variables
from enginediag_cli.mismatch.laws.shortlist import Proposal, carrying
from enginediag_cli.mismatch.laws.smooth import prior_of_variables
from enginediag_cli.physics.law import LONGEST, Expression, Law

ALONE = (4, 6, 8, 11, 15)
"""Steps along one variable, of which the likeliest number is taken."""
OF_TWO = ALONE[:4]
"""Steps along each of two variables."""
SHARES = (0.1, 0.3, 1.0)
"""σ, over the standard deviation of the law that a fit carries, likewise."""
BEYOND = 1.0 / 3.0
"""Of these, as many more at most towards either end of what was flown."""
BESIDE, TOGETHER = 4, 3
"""Steps along each of two variables; and along each in their products."""
DIGITS, DIGITS_OF_SIZES = 5, 4
"""Significant digits of places and widths in a formula, and of sizes with numbers in their places."""

CURVE = 0.5
"""Prior weight of a curve among forms of one variable."""
SUM = 0.25
"""Share of laws of two variables that have no listed form which are sums of one of each. In the twin with all of it two
of 175 laws of one variable are told of two, with an eighth or none of it they are not."""

OWN = Form("smooth", "as a smooth curve of", "")
BOTH = Form("smooth_product", "as a smooth surface of", "")


@dataclass(frozen=True)
class Part:
    """One law of a smooth curve: `terms` whose sizes are its coefficients, and what multiplies them, `by`; `number` of
    its name where there are more of the same variables."""

    form: Form
    of: tuple[KnownVariable, ...]
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


def tried_of(says: Says, of: Sequence[KnownVariable]) -> dict[tuple[int, ...], Linear]:
    """All numbers of steps along one variable, or along each of two, with every σ."""
    sizes, found = float(np.std(says.f)) * np.array(SHARES), dict[tuple[int, ...], Linear]()
    for counts in product(ALONE if len(of) == 1 else OF_TWO, repeat=len(of)):
        steps = np.hstack([steps_over(k, n) for k, n in zip(of, counts, strict=True)])
        found[counts] = Linear.of(says, steps, np.repeat(sizes[:, None] ** 2, steps.shape[1], axis=1))
    return found


@dataclass(frozen=True)
class Bends:
    """How finely a curve of one variable bends, or a sum of one of each of two: steps along most of each (`counts`),
    `size` their σ, both the likeliest; `evidence`: ln, of all that were tried, against the fit without the law that is
    carried; `choice`: ln, what having chosen the likeliest costs, 0 or less."""

    of: tuple[KnownVariable, ...]
    counts: tuple[int, ...]
    size: float
    evidence: float
    choice: float


def bends_of(says: Says, of: Sequence[KnownVariable]) -> Bends:
    """Of what a place says of curves of a variable, or of sums of them."""
    tried = tried_of(says, of)
    counts, best = max(tried.items(), key=lambda t: float(t[1].evidence.max()))
    size = float(np.sqrt(best.variances[np.argmax(best.evidence), 0]))
    evidence = evidence_of_all([*tried.values()])
    return Bends(tuple(of), counts, size, says.gain + evidence, evidence - float(best.evidence.max()))


def prior_of_curve(groups: int) -> float:
    """ln, of one variable of so many groups, and of a curve: to be told it is half as likely as any one form. In a
    linear twin of the search (280 laws, place and variable known) curves are within noise as often as where a third of
    all laws is unlisted, and one in twenty of what the grammar has is told as a curve, not a third."""
    weights = CURVE + sum(f.weight for f in FORMS if not (f.pairs or f.remembers))
    return float(np.log(share_of_variables(1, groups) * CURVE / weights))


def prior_of(bends: Bends, groups: int) -> float:
    """ln, of its variables, of so many groups, and of a curve of one, or a sum of curves of two, that is told."""
    return prior_of_curve(groups) if len(bends.of) == 1 else prior_of_all(bends, groups)


def prior_of_all(bends: Bends, groups: int) -> float:
    """ln, of its variables, and of all curves of one, or all sums of curves of two, where variables are weighed."""
    share = 1.0 if len(bends.of) == 1 else SUM
    return prior_of_variables(bends.of, groups) + float(np.log(share))


def as_curve(place: Location, bends: Bends, prior: float, here: float, engine: Engine) -> tuple[Proposal, ...]:
    """The law that is a smooth curve of one variable at a place, or laws that are one of each of two; `prior`: ln, of
    variables, `here` of the place. None where a variable's name makes a formula that is too long."""
    parts = [Part(OWN, (k,), _steps(k, n)) for k, n in zip(bends.of, bends.counts, strict=True)]
    return _proposals(place, parts, bends.size, (prior + bends.choice, here), engine)


def as_surface(
    place: Location, of: tuple[KnownVariable, KnownVariable], size: float, prior: float, here: float, engine: Engine
) -> tuple[Proposal, ...]:
    """Laws that together are a smooth surface of two variables at a place; `size`: standard deviation of a curve there
    over the records, `prior`: ln, of variables, `here` of the place, which the first law bears. None where the
    variables' names make formulas that are too long."""
    x, y = of
    parts = [Part(OWN, (k,), _steps(k, BESIDE, 0.0)) for k in of]
    for number, step in enumerate(_steps(x, TOGETHER, 0.0), start=1):
        parts.append(Part(BOTH, (x, y), _steps(y, TOGETHER, 0.0), f"{step} * ", str(number)))
    return _proposals(place, parts, size, (prior, here), engine)


def _proposals(
    place: Location, parts: Sequence[Part], size: float, priors: tuple[float, float], engine: Engine
) -> tuple[Proposal, ...]:
    if any(len(p.text) > LONGEST for p in parts):
        return ()
    return tuple(_proposal(place, p, size, priors if p is parts[0] else (0.0, 0.0), engine) for p in parts)


def _grid(k: KnownVariable, count: int, beyond: float = BEYOND) -> tuple[list[float], float]:
    """Places of steps of a variable and their width: so many evenly over most of what was flown, and on from there to
    its ends, where few records may lie far from all others."""
    low, high = (float(q) for q in np.quantile(k.values, EDGES_OF_STEPS))
    w = _rounded(max((high - low) / (count - 1), 1e-3 * span(k.values)))
    ends = low - float(np.min(k.values)), float(np.max(k.values)) - high
    before, after = (min(int(np.ceil(end / w)), int(beyond * count)) for end in ends)
    return [_rounded(low + w * j) for j in range(-before, count + after)], w


def steps_over(k: KnownVariable, count: int) -> np.ndarray:
    """Steps of a variable over the records (N, n), n at least `count`."""
    places, w = _grid(k, count)
    c = np.array(places)
    return np.asarray(np.tanh((k.values[:, None] - c) / w) - np.tanh((k.variable.reference - c) / w))


def _steps(k: KnownVariable, count: int, beyond: float = BEYOND) -> tuple[str, ...]:
    """Steps of a variable."""
    name, x0 = k.variable.name, k.variable.reference
    places, w = _grid(k, count, beyond)
    found = []
    for c in places:
        found.append(f"(tanh(({name} - {c!r}) / {w!r}) - ({float(np.tanh((x0 - c) / w))!r}))")
    return tuple(found)


def formula_of(k: KnownVariable, count: int, sizes: np.ndarray) -> str:
    """Steps of a variable with numbers in the places of their sizes (n,), 0 at the design point."""
    (places, w), x0 = _grid(k, count), k.variable.reference
    told = [float(f"{a:.{DIGITS_OF_SIZES}g}") for a in sizes]
    there = sum(a * float(np.tanh((x0 - c) / w)) for a, c in zip(told, places, strict=True))
    terms = [f"({a!r}) * tanh(({k.variable.name} - {c!r}) / {w!r})" for a, c in zip(told, places, strict=True)]
    return " + ".join([*terms, f"({-there!r})"])


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")


def _proposal(place: Location, part: Part, size: float, priors: tuple[float, float], engine: Engine) -> Proposal:
    prior, here = priors
    letters, expression = part.letters, Expression.parse(part.text)
    values = {k.variable.name: k.values for k in part.of}
    curve = np.asarray(expression.evaluate({**values, **dict.fromkeys(letters, 1.0)}), float)
    parameter = parameter_at(place, engine)
    acts, unit = acting(place, parameter)
    coefficients = tuple(
        Coefficient(a, unit, "size", lower=-np.inf, upper=np.inf, sigma=size, typical=0.0) for a in letters
    )
    variables = {k.variable.name: k.variable for k in part.of}
    statement = statement_of(place, parameter, part.form, part.of)
    law = Law(part.name, acts, expression, variables, coefficients, statement)
    formula = Formula(part.form, part.of, {}, curve, prior)
    return carrying(Candidate(place, formula, 0.0, 0.0, prior + here, prior + here), Effect(law, acts.site, {}))
