"""The free-form map: at every location, "something that depends on this driver is missing here".

A block is one parameter of the engine times a polynomial of second degree in one driver, orthonormal over the
records; its score has as many degrees of freedom as curves that the nuisance leaves. What is not identified beside it
may be wrong by a constant, alone and along every driver: a loss that grows with speed is not zero on average.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.drivers import CONSTANT, SWITCH, TIME, polynomials
from enginediag_cli.engine.components.base import HEALTH_ROAMS
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.term import Driver, DriverValues, Effect
from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Scored, Sums, grid
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.parameters import Parameter, spelled
from enginediag_cli.physics.registry import effect, term
from enginediag_cli.progress import stage

DEGREE = 2
"""Of the free curve along a driver: a slope and a bend, which most effects have; more would take up faults."""
LEVERS = ("customer_bleed", "power_offtake", "tat_probe_heating", "humidity")
"""Terms whose amplitude is a location of its own: air or power that leaves where the engine has no parameter, and
air that is not what it is taken for."""

MACHINE = ("efficiency", "flow_capacity")
"""Quantities of a turbomachine that one effect may move together."""


@dataclass(frozen=True)
class Location:
    """A place where something may be missing: the parameter that stands for it, its component ("hpc",
    "sensor.T45"), and the effect that brings the parameter in, where the engine itself has none. `scale`: how far the
    parameter may plausibly vary along a driver (rms), in its unit. `words`: the place as an engineer says it;
    `quantity` of the parameter; `belongs_to_sensor`: it is an instrument. `also`: the other quantity of a turbomachine,
    where both are moved together."""

    name: str
    parameter: str
    component: str
    through: Effect | None = None
    scale: float = HEALTH_ROAMS
    words: str = ""
    quantity: str = ""
    belongs_to_sensor: bool = False
    also: Location | None = None

    @property
    def parts(self) -> tuple[Location, ...]:
        """Itself, or the two quantities that are moved together."""
        return (self,) if self.also is None else (replace(self, also=None), self.also)


def parameter_at(place: Location, engine: Engine) -> Parameter:
    """The parameter that stands for a place: of the engine, or the size of the effect that brings it in."""
    if place.through is None:
        return engine.parameters[place.parameter]
    return next(p for p in place.through.parameters() if p.name == place.parameter)


def locations(found: IdentifiedHypothesis) -> list[Location]:
    """Every health parameter, loss, nozzle area and cooling flow, every bleed and shaft load, every recorded sensor."""
    return list_locations(found.evidence.engine, found.problem.sensors)


def list_locations(engine: Engine, sensors: Sequence[str]) -> list[Location]:
    """The same for an engine of which these sensor columns are recorded: the parameters that say how far they roam,
    and the effects of LEVERS."""
    known = [p for p in engine.parameters.values() if p.roams is not None]
    result = [_of_parameter(p, p.name) for p in known if not p.belongs_to_sensor]
    for lever in LEVERS:
        for site in term(lever).sites(engine.network):
            e = effect(engine, lever, site.name)
            result.append(of_effect(e, abs(e.term.amplitudes()[0].typical)))
    for column in sensors:
        own = {p.name for p in engine.sensors[column].parameters()}
        result += [_of_parameter(p, p.component) for p in known if p.name in own]
    return result


def _of_parameter(p: Parameter, name: str) -> Location:
    words = p.part if p.belongs_to_sensor else p.words
    return Location(name, p.name, p.component, None, p.roams or 0.0, words, p.quantity, p.belongs_to_sensor)


def of_effect(e: Effect, scale: float = HEALTH_ROAMS) -> Location:
    """The place where a term acts, by its first amplitude."""
    title = e.term.TITLE[0].lower() + e.term.TITLE[1:]
    words = title if e.site.everywhere else f"{title} at {spelled(e.site.name)}"
    return Location(e.label, e.amplitudes[0], e.site.component, e, scale, words)


@dataclass(frozen=True)
class Cell(Scored):
    """One location × driver of the map. `price`: of moving two quantities instead of one, in ln probability."""

    location: Location
    driver: DriverValues
    price: float = 0.0

    @property
    def curves(self) -> np.ndarray:
        """The driver's polynomials over the fit's records, (N, k)."""
        return np.asarray(self.sums.family.curves[:, self.candidates[:, 1]])

    @property
    def surprise(self) -> float:
        """−ln p, 0 where the nuisance absorbs the block."""
        return 0.0 if self.score.absorbed else self.score.surprise

    @property
    def strain(self) -> float:
        """½ Σ (c/scale)²: what it costs, in ln probability, that the parameter must vary by so much. Places that the
        readings hardly tell apart differ in it: a duct that would have to lose many times its loss is not the place."""
        return 0.5 * float(np.sum((self.score.coefficients / self.scales) ** 2)) + self.price

    @property
    def scales(self) -> np.ndarray:
        """Of each coefficient (k,), in its parameter's unit."""
        parts = self.location.parts
        return np.repeat([p.scale for p in parts], len(self.candidates) // len(parts))

    @property
    def varies_with(self) -> Driver:
        """The driver; that of the effect where a constant amplitude of it is the place."""
        through = self.location.through
        if self.driver.driver != CONSTANT or through is None or through.term.DRIVER == SWITCH:
            return self.driver.driver
        return through.term.DRIVER


@stage("scoring places and drivers")
def free_form(
    found: IdentifiedHypothesis, projection: Projection, along: Sequence[DriverValues], columns: Columns | None = None
) -> list[Cell]:
    """The map's cells, most surprising first; drivers' values are of all records of the evidence. `columns`: of at
    least the `locations`, if known."""
    where = locations(found)
    J = columns or Columns(found, [p.parameter for p in where], [p.through for p in where if p.through is not None])
    N = len(found.number)
    known = set(found.problem.names)
    ones = np.ones(len(along[0].values) if along else N)
    drivers = [DriverValues(CONSTANT, CONSTANT.word, ones, "no driver (constant)"), *along]
    curves = [np.ones((N, 1)), *(polynomials(d.values[found.number], DEGREE) for d in along)]
    edges = np.cumsum([0, *(c.shape[1] for c in curves)])
    blocks = [[*range(a, b)] for a, b in pairwise(edges)]
    # what began at some time was not there before: it has no constant of its own
    roaming = [[*b, 0] if b and d.driver not in (CONSTANT, TIME) else b for b, d in zip(blocks, drivers, strict=True)]
    names = list(dict.fromkeys(p.parameter for p in where))
    at = {n: k for k, n in enumerate(names)}
    held = all(p.parameter in known for p in where)
    family = grid(names, np.concatenate(curves, axis=1), blocks if held else roaming, _machines(where, at))
    sums = Sums(projection, J, family)
    cells = []
    for place in where:
        # the constant of what identification fits is not sought
        first, own_blocks = (1, blocks) if place.parameter in known else (0, roaming)
        for d, block in zip(drivers[first:], own_blocks[first:], strict=True):
            if block:
                own = np.array([[at[place.parameter], c] for c in block])
                cells.append(Cell(sums, own, sums.score(own), place, d))
    return sorted(cells, key=lambda c: -c.surprise)


def _machines(where: Sequence[Location], at: Mapping[str, int]) -> list[tuple[int, int]]:
    """Pairs of parameters, by position, that one effect on a turbomachine may move together."""
    found: dict[str, list[int]] = {}
    for place in where:
        if place.quantity in MACHINE:
            found.setdefault(place.component, []).append(at[place.parameter])
    return [(own[0], own[1]) for own in found.values() if len(own) == 2]


def machine_cells(cells: Sequence[Cell]) -> list[Cell]:
    """Efficiency and flow capacity of every turbomachine moved together along every driver: an effect on both matches
    neither alone. The second quantity costs what the first had not to pay, ½ ln|1 + τ²C⊥ᵀC⊥| (the evidence of a linear
    model; D. J. C. MacKay, Neural Computation 4 (1992) 415–447)."""
    machines: dict[tuple[str, str], list[Cell]] = {}
    for c in cells:
        if c.location.quantity in MACHINE and not c.score.absorbed:
            machines.setdefault((c.location.component, c.driver.name), []).append(c)
    found = []
    for both in machines.values():
        if len(both) == 2:
            one, other = sorted(both, key=lambda c: MACHINE.index(c.location.quantity))
            own = np.concatenate([one.candidates, other.candidates])
            words = f"{one.location.words} and {other.location.quantity.replace('_', ' ')}"
            name = f"{one.location.name} + {other.location.name}"
            place = replace(one.location, name=name, words=words, also=other.location)
            cell = Cell(one.sums, own, one.sums.score(own), place, one.driver)
            found.append(replace(cell, price=_told(cell) - max(_told(one), _told(other))))
    return found


def _told(c: Cell) -> float:
    """½ ln|1 + τ²C⊥ᵀC⊥|: by how much readings narrow what is known of the coefficients."""
    scaled = c.scales[:, None] * c.sums.gram(c.candidates) * c.scales
    return 0.5 * float(np.linalg.slogdet(np.eye(len(scaled)) + scaled)[1])


@dataclass(frozen=True)
class Place:
    """One component × driver: the better of its cells and, for a turbomachine, of efficiency and flow capacity
    together (an effect on both matches neither alone)."""

    component: str
    driver: DriverValues
    surprise: float


def places(cells: Sequence[Cell]) -> list[Place]:
    """Components along drivers, most surprising first."""
    found: dict[tuple[str, str], Place] = {}
    machines: dict[tuple[str, str], list[Cell]] = {}
    for c in cells:
        key = (c.location.component, c.driver.name)
        if key not in found or c.surprise > found[key].surprise:
            found[key] = Place(c.location.component, c.driver, c.surprise)
        if c.location.quantity in MACHINE and not c.score.absorbed:
            machines.setdefault(key, []).append(c)
    for key, both in machines.items():
        if len(both) == 2:
            score = both[0].sums.score(np.concatenate([c.candidates for c in both]))
            if score.surprise > found[key].surprise:
                found[key] = Place(key[0], both[0].driver, score.surprise)
    return sorted(found.values(), key=lambda p: -p.surprise)
