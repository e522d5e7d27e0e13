"""The free-form map: at every location, "something that depends on this driver is missing here".

A block is one parameter of the engine times a polynomial of second degree in one driver, orthonormal over the
records; its score has as many degrees of freedom as curves that the nuisance leaves. What identification knows
already (a constant) is not in it.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.drivers import Driver, polynomials
from enginediag_cli.mismatch.extended import ExtendedModel
from enginediag_cli.mismatch.identified import Identified
from enginediag_cli.mismatch.projection import Projection, Score, derivatives, lengths
from enginediag_cli.physics.registry import effect, term
from enginediag_cli.physics.term import Effect

DEGREE = 2
PARAMETERS = ("*.efficiency", "*.flow_capacity", "*.area", "*.pressure_loss", "*.pressure_recovery", "*.loss_factor")
LEVERS = ("customer_bleed", "power_offtake")
"""Terms whose amplitude is a location of its own: air or power that leaves where the engine has no parameter."""


@dataclass(frozen=True)
class Location:
    """A place where something may be missing: the parameter that stands for it, its component ("hpc",
    "sensor.T45"), and the effect that brings the parameter in, where the engine itself has none."""

    name: str
    parameter: str
    component: str
    through: Effect | None = None


def locations(found: Identified) -> list[Location]:
    """Every health parameter, loss, nozzle area and cooling flow, every bleed and shaft load, every recorded sensor."""
    engine = found.evidence.engine
    result = []
    for n, p in engine.parameters.items():
        if p.family in ("health", "design") and any(fnmatch.fnmatch(n, x) for x in PARAMETERS):
            result.append(Location(n, n, n.partition(".")[0]))
    for c in engine.network.components:
        for port in c.values.get("ports", ()):
            name = f"{c.name}.{port['name']}.fraction"
            result.append(Location(name, name, c.name))
    for lever in LEVERS:
        for site in term(lever).sites(engine.network):
            e = effect(engine, lever, site.name)
            result.append(Location(e.label, e.amplitudes[0], site.component, e))
    for column in found.problem.sensors:
        quantity = engine.sensors[column].quantity
        result.append(Location(f"sensor.{quantity}", f"sensor.{quantity}.scale", f"sensor.{quantity}"))
    return result


@dataclass(frozen=True)
class Cell:
    """One location × driver of the map; `curves` (N, k) are the driver's polynomials over the fit's records."""

    location: Location
    driver: Driver
    score: Score
    curves: np.ndarray
    columns: np.ndarray

    @property
    def surprise(self) -> float:
        """−ln p, 0 where the nuisance absorbs the block."""
        return 0.0 if self.score.absorbed else self.score.surprise


def free_form(found: Identified, projection: Projection, along: Sequence[Driver]) -> list[Cell]:
    """The map's cells, most surprising first; drivers' values are of all records of the evidence."""
    places = locations(found)
    engine = found.evidence.engine
    there = {e.label for e in (*engine.effects, *found.hypothesis.effects)}
    levers = {p.through.label: p.through for p in places if p.through is not None and p.through.label not in there}
    model = ExtendedModel(
        engine.with_effects((*engine.effects, *found.hypothesis.effects, *levers.values())),
        found.model.discrepancies,
    )
    J = derivatives(found, [p.parameter for p in places], model)
    curves = [polynomials(d.values[found.number], DEGREE) for d in along]
    cells = []
    for i, place in enumerate(places):
        column = J[:, :, i : i + 1]
        all_curves = np.concatenate(curves, axis=1)
        blown = column * all_curves[:, None, :]
        C, full = projection.projected(blown), lengths(projection.frame, blown)
        j = 0
        for d, curve in zip(along, curves, strict=True):
            k = curve.shape[1]
            if k:
                block = C[:, j : j + k]
                cells.append(Cell(place, d, projection.score(block, float(full[j])), curve, block))
            j += k
    return sorted(cells, key=lambda c: -c.surprise)
