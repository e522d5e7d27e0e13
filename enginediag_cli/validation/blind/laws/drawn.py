"""What a trial of a law conceals: place, variables and form at random, and a size that the readings show.

The size a is that of the non-centrality wanted: with c the column ∂y/∂θ · f/a at the engine without the law, and c⊥
what identification leaves of it,

    λ = a² |c⊥|²,     corrected once by the λ that flights with the law really leave: a → a √(λ wanted/λ)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Location, locations_of
from enginediag_cli.mismatch.fit.identified import Identified
from enginediag_cli.mismatch.fit.options import effect_option, fault_options, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.laws.grammar import span
from enginediag_cli.mismatch.laws.scan import Known, known_variables
from enginediag_cli.physics.laws.expression import Expression, ExpressionError
from enginediag_cli.physics.laws.law import Acts, Law
from enginediag_cli.validation.blind.laws.forms import Shaped, of_grammar, of_none
from enginediag_cli.validation.blind.laws.higher import draw_higher
from enginediag_cli.validation.blind.laws.spline import MANY_KNOTS, spline
from enginediag_cli.validation.blind.laws.truth import LawTruth, along, curve
from enginediag_cli.validation.blind.visible import VISIBLE, drawable, noise_free_fit, true_readings

NAME = "concealed"
"""Of the law: nobody is shown it."""
SIZE = "a"
LAMBDA = (60.0, 1500.0)
"""Non-centrality, from and to, evenly in the logarithm."""
TWO, OUTSIDE = 0.3, 0.6
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


class NothingShownError(DataError):
    """The flights of a trial show nothing that it could conceal: others may."""


@dataclass(frozen=True)
class Ground:
    """What laws are drawn on: an engine, the fit to its flights without noise, places, and what moves."""

    engine: Engine
    found: Identified
    projection: Projection
    columns: Columns
    places: tuple[Location, ...]
    known: tuple[Known, ...]

    @staticmethod
    def of(engine: Engine, flights: Sequence[Mapping[str, np.ndarray]], model_error: float) -> Ground:
        """Of the flights that are not held back. Raises NothingShownError where nothing can be fitted or nothing
        moves."""
        found = noise_free_fit(engine, flights, model_error)
        places = tuple(p for p in locations_of(engine, found.problem.sensors) if p.through is None)
        known = tuple(k for k in known_variables(found) if span(k.values) > MOVES * max(np.ptp(k.values), _size(k)))
        if not found.converged or not known or not places:
            raise NothingShownError(f"{engine.name}: laws need variables that move, and a fit that converges")
        columns = Columns(found, [p.parameter for p in places], [])
        return Ground(engine, found, Projection(found), columns, places, known)

    def gram(self, place: Location, curves: np.ndarray) -> np.ndarray:
        """Products (k, k) of the place's derivative times curves (N, k), after projection."""
        k = curves.shape[1]
        family = grid([place.parameter], curves, [list(range(k))])
        return Sums(self.projection, self.columns, family).gram(np.column_stack([np.zeros(k, int), np.arange(k)]))


def draw_law(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    training: int,
    model_error: float,
    rng: np.random.Generator,
) -> LawTruth:
    """A law that these flights show, with a plausible size, that no effect or fault of the library says as well.

    Raises NothingShownError where none is found.
    """
    ground = Ground.of(engine, flights[:training], model_error)
    higher, at_ceiling = draw_higher(engine, rng)
    flown, sort = 0, Sort.drawn(rng)
    for k in range(TRIES):
        sort = Sort.drawn(rng) if k % KEPT == KEPT - 1 else sort
        drawn = shaped_law(ground, sort, rng)
        if drawn is None:
            continue
        flown += 1
        found = _corrected(ground, drawn, flights[:training], model_error, sort.wanted)
        if found is not None and _plausible_at(engine, found, (*flights, *higher)):
            return replace(found, higher=higher, at_ceiling=at_ceiling)
        if flown >= FLOWN:
            break
    raise NothingShownError(f"{engine.name}: no law was found that these flights show and the library lacks")


@dataclass(frozen=True)
class Sort:
    """What is decided first: of two variables or of one, whether no grammar holds the form, the λ wanted."""

    two: bool
    outside: bool
    wanted: float

    @staticmethod
    def drawn(rng: np.random.Generator) -> Sort:
        return Sort(bool(rng.random() < TWO), bool(rng.random() < OUTSIDE), float(np.exp(rng.uniform(*np.log(LAMBDA)))))


def shaped_law(ground: Ground, sort: Sort, rng: np.random.Generator) -> LawTruth | None:
    """One place, one or two variables, one form, and the size of the λ wanted by projection; None where the law would
    be implausible, says nothing, or, of two variables, one would do."""
    place = ground.places[int(rng.integers(len(ground.places)))]
    of = _variables(ground.known, sort.two, rng)
    sign = float(rng.choice((-1.0, 1.0)))
    try:
        shaped = (of_none if sort.outside else of_grammar)(of, rng)
        unit = _law(ground, place, of, shaped, 1.0, 1.0)
    except ExpressionError:  # too long
        return None
    f = curve(unit.effect, {k.variable.name: k.values for k in of})
    if not np.isfinite(f).all() or np.ptp(f) < 1e-9:
        return None
    length = ground.gram(place, f[:, None])[0, 0]
    if length <= 0.0:
        return None
    size = sign * float(np.sqrt(sort.wanted / length))
    if not _within(ground.engine, place, size * f):
        size = -size
    if not _within(ground.engine, place, size * f) or (len(of) == 2 and _one_would_do(ground, place, of, size * f)):
        return None
    return _law(ground, place, of, shaped, size, float(np.std(f)))


def _variables(known: Sequence[Known], two: bool, rng: np.random.Generator) -> tuple[Known, ...]:
    """One variable or two that the records tell apart, every group of them equally often."""
    groups = list(dict.fromkeys(k.group for k in known))
    count = min(2 if two else 1, len(groups))
    found = []
    for g in rng.choice(len(groups), count, replace=False):
        own = [k for k in known if k.group == groups[int(g)]]
        found.append(own[int(rng.integers(len(own)))])
    return tuple(found)


def _law(ground: Ground, place: Location, of: Sequence[Known], shaped: Shaped, size: float, spread: float) -> LawTruth:
    """`spread`: standard deviation of the formula of size 1 over the records."""
    p = ground.engine.parameters[place.parameter]
    factor = p.nominal == 1.0 and p.unit in ("", "1")
    unit = "1" if factor else p.unit or "1"
    coefficient = Coefficient(SIZE, unit, "size", 0.0, -np.inf, np.inf, place.scale / max(spread, 1e-300), size)
    acts = Acts(p.name, p.component, unit, factor)
    variables = {k.variable.name: k.variable for k in of}
    law = Law(NAME, acts, Expression.parsed(shaped.text), variables, (coefficient,))
    return LawTruth(Effect(law, acts.site, {SIZE: size}), place, shaped.name, shaped.outside)


def _within(engine: Engine, place: Location, f: np.ndarray, most: float = LARGEST) -> bool:
    """Whether a change f (N,) at a place is plausible, and leaves the parameter within its bounds."""
    p = engine.parameters[place.parameter]
    value = p.nominal + f
    return bool(np.abs(f).max() <= most * place.scale and p.lower <= value.min() and value.max() <= p.upper)


def _one_would_do(ground: Ground, place: Location, of: Sequence[Known], f: np.ndarray) -> bool:
    """Whether a free curve of one variable, its own or any group's, leaves too little of a law of two to tell that both
    are needed."""
    firsts = [next(k for k in ground.known if k.group == g) for g in dict.fromkeys(k.group for k in ground.known)]
    for x in (k.values for k in (*of, *firsts)):
        G = ground.gram(place, np.column_stack([f, np.ones(len(f)), spline(x, knots=MANY_KNOTS)]))
        a, B = G[0, 1:], G[1:, 1:]
        if G[0, 0] - a @ np.linalg.pinv(B, rcond=1e-10, hermitian=True) @ a < VISIBLE:
            return True
    return False


def _corrected(
    ground: Ground,
    drawn: LawTruth,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    wanted: float,
) -> LawTruth | None:
    """The law with the size that leaves that λ; None where it cannot be flown, or where the library says the same."""
    engine = ground.engine
    truth = engine.with_effects((*engine.effects, drawn.effect))
    found = noise_free_fit(engine, flights, model_error, true_readings(truth, flights, {}))
    if not found.converged:
        return None
    projection = Projection(found)
    total = projection.objective
    options = [*map(effect_option, drawable(engine)), *fault_options(found)]
    scores = option_scores(found, projection, options)
    # what identification takes nearly all of is no rival that anybody would believe
    best = max((s.score.statistic for s in scores if s.score.dof and s.feasible), default=0.0)
    if total - best < CLEAR:
        return None
    size = drawn.effect.values[SIZE] * float(np.sqrt(wanted / total))
    return replace(drawn, effect=replace(drawn.effect, values={SIZE: size}))


def _plausible_at(engine: Engine, drawn: LawTruth, flights: Sequence[Mapping[str, np.ndarray]]) -> bool:
    """Whether the law is plausible over all these flights, those that nobody is shown included."""
    for flight in flights:
        inputs = {c: flight[c] for c in engine.inputs}
        f = curve(drawn.effect, along(engine, inputs, {}, tuple(drawn.law.variables.values())))
        if not np.isfinite(f).any() or not _within(engine, drawn.place, f[np.isfinite(f)], LARGEST_ABOVE):
            return False
    return True


def _size(k: Known) -> float:
    return float(np.mean(np.abs(k.values)))
