"""Concealed formulas: location, variables and form at random, and a size that the readings show.

Forms are some of the grammar that the search tries, and more that it does not have. In a form's text x and y are the
variables, x0 and y0 their values at the design point, u and v both less a place within the records, over a width, and s
is u limited to −1 and 1. The form is 0 at the design point and multiplied by the size a.

The size gives the non-centrality wanted. With c the column ∂y/∂θ · f/a at the engine without the formula, and c⊥ its
part that identification does not absorb,

    λ = a² |c⊥|²,     corrected once by the λ of flights that have the formula: a → a √(λ wanted/λ)

The free curve that a formula is compared with is a natural cubic spline: knots t₁ … t_K at quantiles of the variable
over the fitted records, straight beyond the outer knots. In the basis of T. Hastie, R. Tibshirani, J. Friedman, The
Elements of Statistical Learning, 2nd ed. (2009), eq. 5.4–5.5,

    N₁ = x,   N_{k+1} = d_k − d_{K−1},   d_k = ((x − t_k)³₊ − (x − t_K)³₊)/(t_K − t_k)
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.fit.columns import Columns as FormulaColumns
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Location, list_locations
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.options import effect_option, fault_options, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.grammar import FORMS, Form, span
from enginediag_cli.mismatch.laws.scan import KnownVariable, known_variables
from enginediag_cli.physics.law import Expression, ExpressionError, Law, LawPlace, Variable
from enginediag_cli.validation.trial_flights import (
    VISIBLE,
    draw_higher,
    drawable_effects,
    noise_free_fit,
    true_readings,
)

Columns = Mapping[str, np.ndarray]


@dataclass(frozen=True)
class ConcealedFormula:
    """`effect`: the law with its size; `place`: where it acts; `form`, `outside`: by name, and whether no grammar holds
    it; `higher`: inputs of flights four kilometres above the others, `at_ceiling`: share of their records that the
    engine's envelope keeps lower."""

    effect: Effect
    place: Location
    form: str
    outside_grammar: bool
    higher: tuple[Columns, ...] = ()
    ceiling_share: float = 0.0

    @property
    def law(self) -> Law:
        return formula_term(self.effect)

    @property
    def values(self) -> dict[str, float]:
        """Its size by the name of the parameter."""
        return {self.effect.parameter_name(c): v for c, v in self.effect.values.items()}


def formula_term(effect: Effect) -> Law:
    """The law that an effect is. Raises TypeError for any other effect."""
    if not isinstance(effect.term, Law):
        raise TypeError(f"{effect.label} is no law")
    return effect.term


def evaluate_variables(
    engine: Engine, inputs: Columns, theta: Mapping[str, Any], of: Sequence[Variable]
) -> dict[str, np.ndarray]:
    """Values (N,) of variables at operating points of an engine, by name; NaN where it has no solution."""
    columns = tuple(dict.fromkeys(c for v in of if not v.recorded for c in v.columns))
    at: dict[str, np.ndarray] = {c: np.asarray(x, float) for c, x in inputs.items()}
    n = len(next(iter(at.values())))
    if columns:
        known = {c: x for c, x in inputs.items() if c in engine.inputs or c in engine.optional_inputs}
        own = {k: v for k, v in theta.items() if k in engine.parameters}
        p = engine.predict(known, own, sensors=(), also=columns)
        at |= dict(zip(columns, np.where(p.ok[:, None], p.also, np.nan).T, strict=True))
    return {v.name: np.broadcast_to(v.values(at), (n,)) for v in of}


def evaluate_formula(effect: Effect, values: Mapping[str, np.ndarray]) -> np.ndarray:
    """f (N,) of a law where its variables have these values."""
    law = formula_term(effect)
    numbers = {c.name: effect.values.get(c.name, c.absent) for c in law.COEFFICIENTS}
    n = len(next(iter(values.values()))) if values else 1
    with np.errstate(all="ignore"):
        f = np.asarray(value(law.expression.evaluate({**{k: values[k] for k in law.variables}, **numbers})), float)
    return np.broadcast_to(f, (n,))


INSIDE = (0.1, 0.9)
"""Quantiles of a variable over the records between which a place lies."""
WIDTH = (0.2, 0.8)
"""Widths of a form, over the range of its variable, from and to, evenly in the logarithm."""
SATURATION = (0.5, 6.0)
"""b of x²/(1 + b x²), from and to, evenly in the logarithm: x is 1 at the design point."""
SHARE = (0.3, 1.0)
"""Of a second form in a sum, from and to; of either sign."""
ODD = (-3, -1, 1, 3)
"""Exponents of a sum of powers."""
DIGITS = 5
"""Of the numbers in a formula; those that make it 0 at the design point have all."""

SINE = "s * (1 - s ** 2) * (3.14159 - 2.0094 * s ** 2 + 0.4386 * s ** 4)"
"""sin πs over −1 ≤ s ≤ 1, to 0.2 %: its zeros, its slopes there and its peaks."""

OUTSIDE: Mapping[str, str] = {
    "sine": SINE,
    "odd bump": "u ** 3 * exp(-u ** 2)",
    "flat bump": "exp(-max(u, -u) ** 3)",
    "rational": "x ** 2 / (1 + b * x ** 2)",
    "ramp": "min(max(u, -1), 1)",
    "uneven step": "exp(-exp(-u))",
    "growth": "exp(u)",
    "step and slope": "tanh(u) + q * u",
    "bump and slope": "exp(-u ** 2) + q * u",
    "cubic": "u ** 3 - u",
    "Runge": "1 / (1 + u ** 2)",
    "odd powers": "x ** n + q * y ** m",
    "saddle": "u * v / (1 + max(u * v, -u * v))",
    "ratio with offset": "x / (1 + b * y)",
    "Keijzer 12": "u ** 4 - u ** 3 + v ** 2 / 2 - v",
    "Keijzer 14": "1 / (2 + u ** 2 + v ** 2)",
    "Keijzer 15": "u ** 3 / 5 + v ** 3 / 2 - v - u",
    "Pagie": "u ** 4 / (1 + u ** 4) + v ** 4 / (1 + v ** 4)",
    "Kotanchek": "exp(-u ** 2) / (1.2 + v ** 2)",
}
"""Forms that no grammar holds, by name; of two variables where they contain y or v. Those with the name of a person
are of lists on which others have tried symbolic regression: C. Runge (1901); M. Keijzer, EuroGP (2003) 70–82; L. Pagie,
P. Hogeweg, Evol. Comput. 5 (1997) 401–418; E. Vladislavleva et al., IEEE Trans. Evol. Comput. 13 (2009) 333–349."""
RATIOS = ("rational", "odd powers", "ratio with offset")
"""Those whose variables must be above 0."""


@dataclass(frozen=True)
class FormText:
    """A form with numbers in it: `text` in the names of its variables and the size a, `outside` the grammar or not."""

    name: str
    outside_grammar: bool
    text: str


def draw_grammar_form(of: Sequence[KnownVariable], rng: np.random.Generator) -> FormText:
    """A form that the search has, with a shape that it need not try."""
    pairs = len(of) == 2
    static = (f for f in FORMS if not f.remembers)  # marks compare curves over what variables are
    usable = [f for f in static if f.pairs == pairs and not (f.ratios and _has_recorded(of))]
    form = usable[int(rng.integers(len(usable)))]
    return FormText(form.name, False, _substitute(form.text, of, _shape(form, of, rng)))


def draw_foreign_form(of: Sequence[KnownVariable], rng: np.random.Generator) -> FormText:
    """A form that the grammar does not have."""
    pairs = len(of) == 2
    usable = [
        n for n, t in OUTSIDE.items() if _has_two_variables(t) == pairs and not (n in RATIOS and _has_recorded(of))
    ]
    name = usable[int(rng.integers(len(usable)))]
    text = re.sub(r"\bs\b", "max(min(u, 1), -1)", OUTSIDE[name])
    letters = {n: draw(rng) for n, draw in _LETTERS.items()}
    for letter, known in zip("uv", of, strict=False):
        variable = "xy"["uv".index(letter)]
        place, width = _place(known, rng), _width(known, rng)
        text = re.sub(rf"\b{letter}\b", f"(({variable} - {place:.{DIGITS}g}) / {width:.{DIGITS}g})", text)
    text = _substitute(text, of, letters)
    names = {k.variable.name: k.variable.reference for k in of}
    there = float(np.asarray(Expression.parse(text).evaluate(names)))
    return FormText(name, True, f"a * ({text} - ({there!r}))")


def _shape(form: Form, of: Sequence[KnownVariable], rng: np.random.Generator) -> dict[str, str]:
    """Numbers for a grammar's letters, between the least and the largest that a search begins with."""
    found = {}
    for s in form.shapes:
        tries = s.tries(of[s.of].values)
        low, high = min(tries), max(tries)
        drawn = np.exp(rng.uniform(np.log(low), np.log(high))) if low > 0.0 else rng.uniform(low, high)
        found[s.letter] = f"{drawn:.{DIGITS}g}"
    return found


_LETTERS: Mapping[str, Callable[[np.random.Generator], str]] = {
    "b": lambda rng: f"{np.exp(rng.uniform(*np.log(SATURATION))):.{DIGITS}g}",
    "q": lambda rng: f"({rng.choice((-1, 1)) * rng.uniform(*SHARE):.{DIGITS}g})",
    "n": lambda rng: f"({int(rng.choice(ODD))})",
    "m": lambda rng: f"({int(rng.choice(ODD))})",
}
"""Letter of a form outside the grammar → the number in its place."""


def _place(x: KnownVariable, rng: np.random.Generator) -> float:
    return float(np.quantile(x.values, rng.uniform(*INSIDE)))


def _width(x: KnownVariable, rng: np.random.Generator) -> float:
    return float(span(x.values) * np.exp(rng.uniform(*np.log(WIDTH))))


def _substitute(text: str, of: Sequence[KnownVariable], letters: Mapping[str, str]) -> str:
    """With variables by their names and letters by their numbers."""
    by = {letter: k.variable for letter, k in zip("xy", of, strict=False)}
    words = dict(letters) | {n: v.name for n, v in by.items()} | {f"{n}0": f"{v.reference!r}" for n, v in by.items()}
    return re.sub(r"\b[a-z]\d?\b", lambda m: words.get(m[0], m[0]), text)


def _has_two_variables(text: str) -> bool:
    return bool(re.search(r"\b[yv]\b", text))


def _has_recorded(of: Sequence[KnownVariable]) -> bool:
    return any(k.variable.recorded for k in of)


KNOTS = (0.05, 0.35, 0.65, 0.95)
"""Quantiles, as is usual for four knots: F. E. Harrell, Regression Modeling Strategies (2015), table 2.3."""
MANY_KNOTS = (0.02, 0.15, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 0.98)
"""Of a curve that is to follow whatever one variable can say."""


def spline_basis(x: np.ndarray, fitted: np.ndarray | None = None, knots: Sequence[float] = KNOTS) -> np.ndarray:
    """Its functions (N, K − 1) of a variable (N,), each of mean 0 and standard deviation 1 over the records `fitted`
    (all of them when not given), whose quantiles the knots are."""
    own = x if fitted is None else fitted
    t = np.nanquantile(own, knots)
    middle, width = 0.5 * (t[0] + t[-1]), max(float(t[-1] - t[0]), 1e-300)
    at = (t - middle) / width
    B, known = (_functions((v - middle) / width, at) for v in (x, own))
    return np.asarray((B - np.nanmean(known, axis=0)) / np.maximum(np.nanstd(known, axis=0), 1e-12))


def _functions(x: np.ndarray, t: np.ndarray) -> np.ndarray:
    def d(k: int) -> np.ndarray:
        cubes = np.maximum(x - t[k], 0.0) ** 3 - np.maximum(x - t[-1], 0.0) ** 3
        return np.asarray(cubes / max(t[-1] - t[k], 1e-9))

    last = d(len(t) - 2)
    return np.column_stack([x, *(d(k) - last for k in range(len(t) - 2))])


NAME = "concealed"
"""Of the law: nobody is shown it."""
SIZE = "a"
LAMBDA = (60.0, 1500.0)
"""Non-centrality, from and to, evenly in the logarithm."""
TWO, OUTSIDE_SHARE = 0.3, 0.6
"""Shares of laws of two variables, and of forms that no grammar holds."""
MOVES = 0.02
"""Range of a variable over its size below which it hardly moves in these flights."""
LARGEST, LARGEST_ABOVE = 3.0, 6.0
"""Of a law over the flights, and four kilometres higher, over what its place plausibly roams."""
CLEAR = 40.0
"""λ_sep, by projection, from what the library has: what is nearer is no law that it lacks."""
TRIES, FLOWN = 400, 40
"""Laws that are drawn, and of those with a plausible size flown, at most."""
KEPT = 60
"""Laws that are drawn of as many variables, in the grammar or out of it, and of one λ: what fails more often is not
rarer for it."""


class NothingVisibleError(DataError):
    """The flights of a trial show nothing that it could conceal: others may."""


@dataclass(frozen=True)
class FormulaDesign:
    """What laws are drawn on: an engine, the fit to its flights without noise, places, and what moves."""

    engine: Engine
    fit: IdentifiedHypothesis
    projection: Projection
    columns: FormulaColumns
    places: tuple[Location, ...]
    variables: tuple[KnownVariable, ...]

    @staticmethod
    def from_flights(engine: Engine, flights: Sequence[Mapping[str, np.ndarray]], model_error: float) -> FormulaDesign:
        """Of the flights that are not held back. Raises NothingShownError where nothing can be fitted or nothing
        moves."""
        found = noise_free_fit(engine, flights, model_error)
        places = tuple(p for p in list_locations(engine, found.problem.sensors) if p.through is None)
        known = tuple(k for k in known_variables(found) if span(k.values) > MOVES * max(np.ptp(k.values), _size(k)))
        if not found.converged or not known or not places:
            raise NothingVisibleError(f"{engine.name}: laws need variables that move, and a fit that converges")
        columns = FormulaColumns(found, [p.parameter for p in places], [])
        return FormulaDesign(engine, found, Projection(found), columns, places, known)

    def gram(self, place: Location, curves: np.ndarray) -> np.ndarray:
        """Products (k, k) of the place's derivative times curves (N, k), after projection."""
        k = curves.shape[1]
        family = grid([place.parameter], curves, [list(range(k))])
        return Sums(self.projection, self.columns, family).gram(np.column_stack([np.zeros(k, int), np.arange(k)]))


def draw_formula(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    training: int,
    model_error: float,
    rng: np.random.Generator,
) -> ConcealedFormula:
    """A law that these flights show, with a plausible size, that no effect or fault of the library says as well.

    Raises NothingShownError where none is found.
    """
    design = FormulaDesign.from_flights(engine, flights[:training], model_error)
    higher, at_ceiling = draw_higher(engine, rng)
    flown, sort = 0, FormulaRequest.draw(rng)
    for k in range(TRIES):
        sort = FormulaRequest.draw(rng) if k % KEPT == KEPT - 1 else sort
        drawn = draft_formula(design, sort, rng)
        if drawn is None:
            continue
        flown += 1
        found = _correct_size(design, drawn, flights[:training], model_error, sort.target_lambda)
        if found is not None and _is_plausible_in_flight(engine, found, (*flights, *higher)):
            return replace(found, higher=higher, ceiling_share=at_ceiling)
        if flown >= FLOWN:
            break
    raise NothingVisibleError(f"{engine.name}: no law was found that these flights show and the library lacks")


@dataclass(frozen=True)
class FormulaRequest:
    """What is decided first: of two variables or of one, whether no grammar holds the form, the λ wanted."""

    two_variables: bool
    outside_grammar: bool
    target_lambda: float

    @staticmethod
    def draw(rng: np.random.Generator) -> FormulaRequest:
        return FormulaRequest(
            bool(rng.random() < TWO), bool(rng.random() < OUTSIDE_SHARE), float(np.exp(rng.uniform(*np.log(LAMBDA))))
        )


def draft_formula(design: FormulaDesign, sort: FormulaRequest, rng: np.random.Generator) -> ConcealedFormula | None:
    """One place, one or two variables, one form, and the size of the λ wanted by projection; None where the law would
    be implausible, says nothing, or, of two variables, one would do."""
    place = design.places[int(rng.integers(len(design.places)))]
    of = _variables(design.variables, sort.two_variables, rng)
    sign = float(rng.choice((-1.0, 1.0)))
    try:
        shaped = (draw_foreign_form if sort.outside_grammar else draw_grammar_form)(of, rng)
        unit = _build_formula(design, place, of, shaped, 1.0, 1.0)
    except ExpressionError:  # too long
        return None
    f = evaluate_formula(unit.effect, {k.variable.name: k.values for k in of})
    if not np.isfinite(f).all() or np.ptp(f) < 1e-9:
        return None
    length = design.gram(place, f[:, None])[0, 0]
    if length <= 0.0:
        return None
    size = sign * float(np.sqrt(sort.target_lambda / length))
    if not _is_plausible(design.engine, place, size * f):
        size = -size
    if not _is_plausible(design.engine, place, size * f) or (
        len(of) == 2 and _one_variable_suffices(design, place, of, size * f)
    ):
        return None
    return _build_formula(design, place, of, shaped, size, float(np.std(f)))


def _variables(known: Sequence[KnownVariable], two: bool, rng: np.random.Generator) -> tuple[KnownVariable, ...]:
    """One variable, or two that the records separate, every group of them equally often."""
    groups = list(dict.fromkeys(k.group for k in known))
    count = min(2 if two else 1, len(groups))
    found = []
    for g in rng.choice(len(groups), count, replace=False):
        own = [k for k in known if k.group == groups[int(g)]]
        found.append(own[int(rng.integers(len(own)))])
    return tuple(found)


def _build_formula(
    design: FormulaDesign, place: Location, of: Sequence[KnownVariable], shaped: FormText, size: float, spread: float
) -> ConcealedFormula:
    """`spread`: standard deviation of the formula of size 1 over the records."""
    p = design.engine.parameters[place.parameter]
    factor = p.nominal == 1.0 and p.unit in ("", "1")
    unit = "1" if factor else p.unit or "1"
    coefficient = Coefficient(
        SIZE, unit, "size", lower=-np.inf, upper=np.inf, sigma=place.scale / max(spread, 1e-300), typical=size
    )
    acts = LawPlace(p.name, p.component, unit, factor)
    variables = {k.variable.name: k.variable for k in of}
    law = Law(NAME, acts, Expression.parse(shaped.text), variables, (coefficient,))
    return ConcealedFormula(Effect(law, acts.site, {SIZE: size}), place, shaped.name, shaped.outside_grammar)


def _is_plausible(engine: Engine, place: Location, f: np.ndarray, most: float = LARGEST) -> bool:
    """Whether a change f (N,) at a place is plausible, and leaves the parameter within its bounds."""
    p = engine.parameters[place.parameter]
    value = p.nominal + f
    return bool(np.abs(f).max() <= most * place.scale and p.lower <= value.min() and value.max() <= p.upper)


def _one_variable_suffices(design: FormulaDesign, place: Location, of: Sequence[KnownVariable], f: np.ndarray) -> bool:
    """Whether a free curve of one variable, its own or any group's, leaves too little of a formula of two variables to
    show that both are needed."""
    firsts = [
        next(k for k in design.variables if k.group == g) for g in dict.fromkeys(k.group for k in design.variables)
    ]
    for x in (k.values for k in (*of, *firsts)):
        G = design.gram(place, np.column_stack([f, np.ones(len(f)), spline_basis(x, knots=MANY_KNOTS)]))
        a, B = G[0, 1:], G[1:, 1:]
        if G[0, 0] - a @ np.linalg.pinv(B, rcond=1e-10, hermitian=True) @ a < VISIBLE:
            return True
    return False


def _correct_size(
    design: FormulaDesign,
    drawn: ConcealedFormula,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    wanted: float,
) -> ConcealedFormula | None:
    """The law with the size that leaves that λ; None where it cannot be flown, or where the library says the same."""
    engine = design.engine
    truth = engine.replace_effects((*engine.effects, drawn.effect))
    found = noise_free_fit(engine, flights, model_error, true_readings(truth, flights, {}))
    if not found.converged:
        return None
    projection = Projection(found)
    total = projection.objective
    options = [*map(effect_option, drawable_effects(engine)), *fault_options(found)]
    scores = option_scores(found, projection, options)
    # what identification takes nearly all of is no rival that anybody would believe
    best = max((s.score.statistic for s in scores if s.score.dof and s.feasible), default=0.0)
    if total - best < CLEAR:
        return None
    size = drawn.effect.values[SIZE] * float(np.sqrt(wanted / total))
    return replace(drawn, effect=replace(drawn.effect, values={SIZE: size}))


def _is_plausible_in_flight(
    engine: Engine, drawn: ConcealedFormula, flights: Sequence[Mapping[str, np.ndarray]]
) -> bool:
    """Whether the law is plausible over all these flights, those that nobody is shown included."""
    for flight in flights:
        inputs = {c: flight[c] for c in engine.inputs}
        f = evaluate_formula(drawn.effect, evaluate_variables(engine, inputs, {}, tuple(drawn.law.variables.values())))
        if not np.isfinite(f).any() or not _is_plausible(engine, drawn.place, f[np.isfinite(f)], LARGEST_ABOVE):
            return False
    return True


def _size(k: KnownVariable) -> float:
    return float(np.mean(np.abs(k.values)))
