"""The two states refitted with everything that is identified: nuisance and amplitude at given states, states at the
new point, in turn, within the physical bounds of the location.

The states' means stand in for the states; that they were read from the same readings makes the amplitude too large
unless their doubt V is counted, a = g·ŝ/(ŝᵀGŝ + V + σ_a⁻²): it is put into the amplitude's prior, σ⁻² = σ_a⁻² + V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.believable import FAST_S, along_driver, hidden
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.extended import Discrepancy, ExtendedModel
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.identified import Hypothesis, IdentifiedHypothesis, Nuisance, identify_with
from enginediag_cli.mismatch.fit.neighbours import neighbours_of
from enginediag_cli.mismatch.fit.projection import Projection, derivatives
from enginediag_cli.mismatch.unrecorded.aircraft import grid_of
from enginediag_cli.mismatch.unrecorded.amplitude import likelihood
from enginediag_cli.mismatch.unrecorded.pieces import judged
from enginediag_cli.mismatch.unrecorded.states import Bounds, States, standard_error, two_states
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction, basis_without, direction
from enginediag_cli.physics.registry import term, term_names

CURVE = "hidden state"
ROUNDS, SETTLED = 4, 0.02
"""Rounds of states and fit at most, and the largest change of a state's probability, on average, that ends them."""


@dataclass(frozen=True)
class Refit:
    """`found`: the last fit, its states given; `coefficient`, `standard_error`: amplitude of on
    against off, in the unit of the location's parameter; `continuous`: ln evidence of a continuous amplitude at the
    same point, to compare with `states.evidence`; both are against `objective`, χ² without the effect there."""

    found: IdentifiedHypothesis
    states: States
    coefficient: float
    standard_error: float
    continuous: float
    objective: float

    @property
    def converged(self) -> bool:
        return self.found.converged


def with_lever(evidence: Dataset, place: Location) -> Dataset:
    """The evidence with an engine that has the location's parameter."""
    e = place.through
    if e is None or e.label in {c.label for c in evidence.engine.effects}:
        return evidence
    return replace(evidence, engine=evidence.engine.replace_effects((*evidence.engine.effects, e)))


def bounds_of(found: IdentifiedHypothesis, place: Location) -> tuple[Bounds, int]:
    """Bounds of the amplitude at the location, and the sign that physics gives it: +1, −1, or 0 for not known. What is
    commanded takes air or power when it is on, beyond what the engine takes anyway."""
    engine = with_lever(found.evidence, place).engine
    p = engine.parameters[place.parameter]
    at = found.theta.get(place.parameter, p.nominal)
    sign = 1 if p.switches or p.lower >= at else -1 if p.upper <= at else 0
    low = 0.0 if sign > 0 else p.lower - at
    high = 0.0 if sign < 0 else p.upper - at
    return Bounds(low, high, min(p.prior_sigma, believed_of(found, [place])[0])), sign


def believed_of(found: IdentifiedHypothesis, places: list[Location]) -> list[float]:
    """Standard deviation of a hidden amplitude at each place, of records as far apart as those of the fit."""
    step_s = neighbours_of(found).step_s
    accuracy, engine = found.evidence.settings.map_accuracy, found.evidence.engine
    leaves = _commanded_leaves(engine)
    return [
        along_driver(p, engine.parameters)
        if step_s <= FAST_S and p.parameter in leaves
        else hidden(p, engine.parameters, accuracy, step_s)
        for p in places
    ]


def _commanded_leaves(engine: Engine) -> set[str]:
    """Parameters that a listed effect changes which somebody commands, such as the clearance of a turbine."""
    terms = [term(name) for name in term_names()]
    return {leaf for t in terms if t.SWITCHES for site in t.sites(engine.network) for leaf in site.targets}


def refit(found: IdentifiedHypothesis, along: Nuisance, place: Location, bounds: Bounds, states: States) -> Refit:
    """Refits from a fit without the effect; look at `converged`."""
    evidence = with_lever(found.evidence, place)
    total = sum(len(next(iter(f.columns.values()))) for f in evidence.flights)
    grid = grid_of(found)
    fit: IdentifiedHypothesis | None = None  # the fit without the effect is bent by it
    curve = np.zeros(total)

    def fitted(on: np.ndarray, doubt: float) -> tuple[IdentifiedHypothesis, _Point | None]:
        """The fit at given states (N,) of the rows, and what is there; None where it did not converge."""
        sigma = (bounds.sigma**-2 + doubt) ** -0.5
        own = Discrepancy(place.parameter, CURVE, sigma, bounds.lower, bounds.upper)
        curve[found.number] = on if grid is None else on[grid.at]
        h = found.hypothesis
        hypothesis = Hypothesis(h.effects, (*h.discrepancies, own), {**h.curves, CURVE: curve.copy()})
        new = identify_with(evidence, hypothesis, along, fit)
        return new, _point(new, place, own.name, curve) if new.converged else None

    for _ in range(ROUNDS):
        fit, at = fitted(states.on, states.doubt)
        if at is None:
            return Refit(fit, states, np.nan, np.nan, -np.inf, np.nan)
        new = two_states(at.of, at.plain, bounds, states.on[None])
        moved = float(np.abs(new.on - states.on).max())
        if moved < SETTLED:
            break
        states = new
    assert at is not None
    told = judged(at.of, at.plain, bounds, new)
    if ((told.on > 0.5) != (new.on > 0.5)).any():
        # a piece that had confirmed itself: its other account needs its own fit
        fit, at = fitted((told.on > 0.5).astype(float), new.doubt)
        if at is None:
            return Refit(fit, states, np.nan, np.nan, -np.inf, np.nan)
    g, believed = at.plain.gathered(at.of.left)[:, None], believed_of(found, [place])[0]
    error = at.error
    if error > 0.0:
        error = standard_error(at.of, at.plain, bounds, replace(new, amplitude=at.coefficient), error)
    told = replace(told, on=at.of.of_records(told.on), changed=at.of.of_records(told.changed))
    told = replace(told, evidence=new.evidence, settled=new.settled and moved < SETTLED)
    continuous = likelihood(at.plain, at.of.gap, g, believed).evidence
    return Refit(at.found, told, at.coefficient, error, continuous, at.of.objective)


@dataclass(frozen=True)
class _Point:
    """A fit at given states: amplitude with its standard error, rows without the amplitude among the nuisance, and the
    location's direction there."""

    found: IdentifiedHypothesis
    coefficient: float
    error: float
    of: Basis
    plain: Direction


def _point(fit: IdentifiedHypothesis, place: Location, name: str, curve: np.ndarray) -> _Point:
    projection = Projection(fit)
    coefficient, error = _coefficient(fit, projection, name)
    column = location_columns(fit, [place])[:, :, 0]
    signal = fit.theta[name] * curve[fit.number]
    of = basis_without(projection, name, _rows_of(projection, column, signal))
    return _Point(fit, coefficient, error, of, direction(of, column))


def _rows_of(projection: Projection, column: np.ndarray, amplitude: np.ndarray) -> np.ndarray:
    """Whitened rows (N, m) that an amplitude (N,) along a column (N, m) makes."""
    found = np.zeros(column.shape)
    found[projection.frame.keep] = projection.frame.rows((column * amplitude[:, None])[:, :, None])[:, 0]
    return found


def _coefficient(fit: IdentifiedHypothesis, projection: Projection, name: str) -> tuple[float, float]:
    """Value and standard error, with the whitened Newton step that the fit has left."""
    j = fit.problem.names.index(name)
    if not projection.free[j]:
        return fit.theta[name], 0.0
    k, scale = int(np.cumsum(projection.free)[j]) - 1, float(fit.problem.prior_sigma[j])
    error = float(np.linalg.norm(np.linalg.solve(projection.R, np.eye(len(projection.R)))[k]))
    return fit.theta[name] + float(projection.step[k]) * scale, error * scale


def location_columns(found: IdentifiedHypothesis, places: list[Location], rows: slice = slice(None)) -> np.ndarray:
    """∂y/∂θ (n, m, k) of the locations' parameters at the fit."""
    engine, carried = found.evidence.engine, found.hypothesis.effects
    there = {e.label for e in (*engine.effects, *carried)}
    levers = {p.through.label: p.through for p in places if p.through is not None and p.through.label not in there}
    effects = (*engine.effects, *carried, *levers.values())
    model = ExtendedModel(engine.replace_effects(effects), found.model.discrepancies)
    return derivatives(found, [p.parameter for p in places], model, rows)
