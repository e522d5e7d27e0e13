"""Every place with every formula, by linearisation: which laws are worth fitting.

A formula at a place is one column, ∂y/∂θ times its curve over the records, scored beside everything that
identification may absorb. With an amplitude a ~ N(0, τ²) its evidence against nothing is that of a linear model,

    ln B = ½ g² τ²/(1 + G τ²) − ½ ln(1 + G τ²),    g = c⊥ᵀe,  G = c⊥ᵀc⊥,    τ = scale of the place / rms of the curve

Source: D. J. C. MacKay, Neural Computation 4 (1992) 415–447.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations, product

import numpy as np

from enginediag_cli.drivers import SAME
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.filters import FilterClock
from enginediag_cli.engine.term import STILL
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.extended import ExtendedModel
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.grammar import FORMS, Form, Shape
from enginediag_cli.mismatch.laws.past import clock_of, past_along
from enginediag_cli.mismatch.laws.within import Room, ends_of
from enginediag_cli.physics.law import Past, Variable, formula_variables
from enginediag_cli.progress import stage

PAIRS = 0.25
"""Prior share of laws of two variables. Judgement."""
MOVED = 0.01
"""Of a variable's standard deviation over the records, by which one may differ between two fits and be the same."""


@dataclass(frozen=True)
class KnownVariable:
    """A variable with its values in the fit's records (N,); `group`: variables of one number cannot be told apart
    there; `clock`: of these records, None where they are no course; `tries`: of shapes, and of finer ones, once they
    were asked for."""

    variable: Variable
    values: np.ndarray
    group: int
    clock: FilterClock | None = field(default=None, compare=False, repr=False)
    tries: dict[tuple[Shape, bool], tuple[float, ...]] = field(default_factory=dict, compare=False, repr=False)

    def tried(self, shape: Shape, finer: bool) -> tuple[float, ...]:
        """Values of a shape to begin with."""
        if (shape, finer) not in self.tries:
            self.tries[shape, finer] = (shape.finer if finer and shape.finer else shape.tries)(self.values)
        return self.tries[shape, finer]


@dataclass(frozen=True)
class Formula:
    """A form of one or two variables with its shape, amplitude 1; `curve` (N,) over the fit's records; `prior`: ln of
    that of form and variables, which the `tried` shapes share."""

    form: Form
    of: tuple[KnownVariable, ...]
    shape: Mapping[str, float]
    curve: np.ndarray
    prior: float
    tried: int = 1

    @property
    def groups(self) -> frozenset[int]:
        return frozenset(k.group for k in self.of)

    @property
    def what(self) -> tuple[str, ...]:
        """Its form and variables, whatever its shape."""
        return (self.form.name, *(k.variable.name for k in self.of))


@dataclass(frozen=True)
class Candidate:
    """A formula at a place: `amplitude` by one step, `weight`: ln evidence against nothing, priors included, of which
    `prior` is that of place, variables and form."""

    location: Location
    formula: Formula
    amplitude: float
    statistic: float
    weight: float
    prior: float


def known_variables(found: IdentifiedHypothesis) -> list[KnownVariable]:
    """Variables that move in the fit's records, in groups that these cannot tell apart."""
    result, clock = list[KnownVariable](), clock_of(found)
    for v, x in _values(found, list(formula_variables(found.evidence.engine.network).values())):
        if np.std(x) <= STILL * max(1e-300, float(np.mean(np.abs(x)))):
            continue
        alike = (k.group for k in result if abs(float(np.corrcoef(k.values, x)[0, 1])) > SAME)
        result.append(KnownVariable(v, x, next(alike, 1 + max((k.group for k in result), default=-1)), clock))
    return result


def seen_at(found: IdentifiedHypothesis, known: Sequence[KnownVariable]) -> tuple[KnownVariable, ...]:
    """The same variables, in the same groups, as another fit of the same records has them: a model without a large law
    is worn where it lacks it, and computes other pressures and temperatures. As they are where nothing has moved, or
    the records are others."""
    if any(len(k.values) != len(found.number) for k in known):
        return tuple(known)
    at = {v.name: x for v, x in _values(found, [k.variable for k in known])}
    return tuple(
        k
        if np.abs(at[k.variable.name] - k.values).max() <= MOVED * np.std(k.values)
        else replace(k, values=at[k.variable.name], tries={})
        for k in known
    )


def _values(found: IdentifiedHypothesis, variables: Sequence[Variable]) -> Iterator[tuple[Variable, np.ndarray]]:
    """Variables that the inputs and the fitted engine tell, with all that it was fitted with, over the fit's records
    (N,): what is in the gas path, whatever sensors read of it."""
    columns = tuple(dict.fromkeys(c for v in variables if not v.recorded for c in v.columns))
    at = {c: np.asarray(x, float) for c, x in found.problem.inputs.items()}
    if columns:
        # by itself: how a fit goes on does not depend on who has looked at it
        model = ExtendedModel(found.model.engine, found.model.discrepancies)
        p = model.predict(found.problem.inputs, found.theta, sensors=(), also=columns)
        at = dict(zip(columns, np.where(p.ok[:, None], p.also, np.nan).T, strict=True)) | at
    for v in variables:
        if all(c in at for c in v.columns):
            x = np.broadcast_to(v.values(at), found.number.shape)
            yield v, np.where(np.isfinite(x), x, np.nanmedian(x))


def formulas(known: Sequence[KnownVariable], forms: Sequence[Form] = FORMS) -> Iterator[Formula]:
    """All forms of all variables, and of those that stand for their groups in pairs."""
    firsts = [next(k for k in known if k.group == g) for g in dict.fromkeys(k.group for k in known)]
    for of in (*((k,) for k in known), *combinations(firsts, 2)):
        yield from formulas_of(of, known, forms)


def formulas_of(
    of: Sequence[KnownVariable], known: Sequence[KnownVariable], forms: Sequence[Form] = FORMS, finer: bool = False
) -> Iterator[Formula]:
    """All forms of one variable, or of two together, with their prior among all of the variables `known`: variables
    that cannot be told apart have that of their group. `finer`: with more tries of their shapes."""
    own = forms_of(of, forms)
    share = share_of_variables(len(of), number_of_groups(known))
    orders = {f.name: (of, of[::-1]) if f.turned else (of,) for f in own}
    for form in own:
        for order in orders[form.name]:
            part = share * share_of_form(form, own) / len(orders[form.name])
            yield from _shaped(form, tuple(order), part, finer)


def forms_of(of: Sequence[KnownVariable], forms: Sequence[Form] = FORMS) -> list[Form]:
    """Those of one variable, or of two, whose values over the records may have them."""
    return [f for f in forms if f.pairs == (len(of) == 2) and not (f.remembers and of[0].clock is None)]


def share_of_form(form: Form, own: Sequence[Form]) -> float:
    """Prior of a form among those that variables may have."""
    return form.weight / sum(f.weight for f in own)


def formulas_over(seen: Sequence[KnownVariable], known: Sequence[KnownVariable], own: list[Formula]) -> list[Formula]:
    """All formulas of variables as another fit has them; `own`, those of `known`, where nothing has moved."""
    return own if all(k is as_it_was for k, as_it_was in zip(seen, known, strict=True)) else list(formulas(seen))


def number_of_groups(known: Sequence[KnownVariable]) -> int:
    """Of variables that cannot be told apart."""
    return len({k.group for k in known})


def share_of_variables(count: int, groups: int) -> float:
    """Prior of one variable, or of two, of so many groups."""
    return (1.0 - PAIRS) / groups if count == 1 else PAIRS / (groups * (groups - 1) / 2.0)


def _shaped(form: Form, of: tuple[KnownVariable, ...], share: float, finer: bool) -> Iterator[Formula]:
    if form.ratios and any(k.variable.recorded for k in of):
        return
    tried = list(product(*(of[s.of].tried(s, finer) for s in form.shapes)))
    letters, together = [s.letter for s in form.shapes], np.array(tried).T[:, :, None]  # (letters, tries, 1)
    curves = np.atleast_2d(over_records(form, of, dict(zip(letters, together, strict=True))))
    with np.errstate(over="ignore", invalid="ignore"):  # what is too large to square is no law
        spread = np.std(curves, axis=1)
    there = np.isfinite(curves).all(axis=1) & np.isfinite(spread) & (spread > 0.0)
    for k in np.flatnonzero(there):
        shape = dict(zip(letters, tried[k], strict=True))
        yield Formula(form, of, shape, curves[k], float(np.log(share)), len(tried))


@dataclass(frozen=True)
class Scan:
    """`candidates`, likeliest first, and the variables that they are of."""

    candidates: tuple[Candidate, ...]
    known: tuple[KnownVariable, ...]

    @property
    def formulas(self) -> list[Formula]:
        """All that were scored, once."""
        return list({id(c.formula): c.formula for c in self.candidates}.values())


def over_records(form: Form, of: Sequence[KnownVariable], shape: Mapping[str, float | np.ndarray]) -> np.ndarray:
    """A form of variables over their records (N,), amplitude 1; (tries, N) where its shape has (tries, 1) each; not
    finite where it is nothing."""
    with np.errstate(all="ignore"):
        return np.asarray(form.expression.evaluate({**letters_of(of), **shape, "a": 1.0}, past_of(of)), float)


def past_of(known: Sequence[KnownVariable]) -> Past | None:
    """Of formulas of variables over their records."""
    return past_along(known[0].clock) if known else None


def letters_of(of: Sequence[KnownVariable]) -> dict[str, Value]:
    """What the letters of a form's variables stand for over their records (N,), shape and amplitude apart."""
    letters: dict[str, Value] = {n: k.values for n, k in zip("xy", of, strict=False)}
    return letters | {f"{n}0": k.variable.reference for n, k in zip("xy", of, strict=False)}


def prior_of_shape(formula: Formula) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (k,) and standard deviation (k,) of the prior of a form's shape, and its bounds (2, k) in standard
    deviations from the mean."""
    of = [(s, formula.of[s.of].values) for s in formula.form.shapes]
    centre, sigma = np.array([s.centre(x) for s, x in of]), np.array([s.sigma(x) for s, x in of])
    bounds = np.array([s.bounds(x) for s, x in of]).reshape(-1, 2).T
    return centre, sigma, (bounds - centre) / sigma


@stage("scoring laws")
def scanned(found: IdentifiedHypothesis, projection: Projection) -> Scan:
    """Every formula at every place."""
    known = known_variables(found)
    share = prior_of_a_place(found)
    return Scan(tuple(scored(found, projection, locations(found), list(formulas(known)), share)), tuple(known))


def prior_of_a_place(found: IdentifiedHypothesis) -> float:
    """ln: beforehand one is as likely as another."""
    return -float(np.log(max(len(locations(found)), 1)))


def scored(
    found: IdentifiedHypothesis,
    projection: Projection,
    where: Sequence[Location],
    laws: Sequence[Formula],
    prior: float,
) -> list[Candidate]:
    """These formulas at these places, likeliest first; `prior`: ln, of a place."""
    if not laws or not where:
        return []
    columns = Columns(found, [p.parameter for p in where], [p.through for p in where if p.through is not None])
    names = list(dict.fromkeys(p.parameter for p in where))
    rms = np.array([np.std(law.curve) for law in laws])
    curves = np.column_stack([law.curve for law in laws]) / rms
    sums = Sums(projection, columns, grid(names, curves, [[k] for k in range(len(laws))]))
    result = []
    for place in where:
        l = names.index(place.parameter)
        g = sums.pull[l]
        G = sums.alone(l)
        narrowed = 1.0 + G * place.scale**2
        weight = 0.5 * g**2 * place.scale**2 / narrowed - 0.5 * np.log(narrowed)
        step = g * place.scale**2 / narrowed
        T = g**2 / np.maximum(G, 1e-300)
        weight += Room.at(found, place).of_curves(step, ends_of(curves), T)
        for k, law in enumerate(laws):
            told = float(weight[k]) + law.prior + prior - float(np.log(law.tried))
            result.append(Candidate(place, law, float(step[k] / rms[k]), float(T[k]), told, law.prior + prior))
    return sorted(result, key=lambda c: -c.weight)


def of_same_groups(formula: Formula, known: Sequence[KnownVariable]) -> list[Formula]:
    """A formula's form with every other choice of variables that the records cannot tell from its own."""
    groups = [[k for k in known if k.group == of.group] for of in formula.of]
    found: list[Formula] = []
    for of in product(*groups):
        if any(k is not own for k, own in zip(of, formula.of, strict=True)):
            found += _shaped(formula.form, of, float(np.exp(formula.prior)), finer=True)
    return found


def of_same_variables(formula: Formula) -> list[Formula]:
    """A formula's form and variables with every shape that is tried."""
    return list(_shaped(formula.form, formula.of, float(np.exp(formula.prior)), finer=True))
