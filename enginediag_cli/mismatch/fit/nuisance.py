"""What is identified along with an effect, so that nothing is called missing that identification would absorb.

Health of each engine, sensor errors, and the *model-error floor*: every base model is a little wrong, in the
shapes of its maps above all, and that error repeats on every flight. Each turbomachine's efficiency and flow
capacity may therefore vary as a polynomial of third degree in its corrected speed and of second in its position
on the speed line, each curve of unit mean square with a prior standard deviation equal to the stated accuracy of
the maps; losses, bleeds, areas and mechanical efficiency may be wrong by a constant of that size. Sensors of which no
error is identified have a scale error with its own prior.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping

import numpy as np

from enginediag_cli.drivers import polynomials
from enginediag_cli.engine.engine import Engine
from enginediag_cli.error_model.maps import (
    CURVES,
    QUANTITIES,
    ErrorModel,
    map_coordinates,
    map_error_name,
    turbomachines,
)
from enginediag_cli.identification.nominal import Nominal
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.parameters import Parameter

SPEED_DEGREE, POSITION_DEGREE = 3, 2
"""Degrees of what a map may err by along speed and across it: shapes that a map's author gets wrong. Judgement; the
blind trials' map errors are of other shapes on purpose."""
CONSTANTS = ("pressure_recovery", "pressure_loss", "fraction", "area", "mechanical_efficiency")
"""Quantities of components that may be wrong by a constant as large as the stated error of the maps."""
READ_WRONG = ("bias", "scale")
"""Errors of a sensor that are constant, or may step in time."""


def constants(engine: Engine, accuracy: float, known: Mapping[str, float]) -> dict[str, float]:
    """Prior standard deviations of constants of the model that belong to the floor and are not identified anyway."""
    if accuracy <= 0.0:
        return {}
    own = [p for p in engine.parameters.values() if p.family in ("design", "health")]
    return {p.name: accuracy for p in own if p.name not in known and p.quantity in CONSTANTS}


def scales_not_identified(engine: Engine, recorded: Iterable[str], identified: Collection[str]) -> list[Parameter]:
    """Scales of the recorded sensors of which no error is among the parameters that are `identified`."""
    every = [[p for p in engine.sensors[c].parameters() if p.quantity in READ_WRONG] for c in recorded]
    unknown = [own for own in every if not any(p.name in identified for p in own)]
    return [p for own in unknown for p in own if p.quantity == "scale"]


def read_wrong(engine: Engine, recorded: Iterable[str], known: Mapping[str, float]) -> dict[str, float]:
    """Prior standard deviations of the scale errors of `recorded` sensors of which no error is identified: an
    instrument is a little wrong whether or not that is asked for, however exact the maps are."""
    return {p.name: p.prior_sigma for p in scales_not_identified(engine, recorded, known)}


def map_curves(
    engine: Engine, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float]
) -> Iterator[tuple[str, np.ndarray]]:
    """Per turbomachine, its name and its curves (N, k): polynomials in corrected speed, then in what the corrected
    flow (compressor) or pressure ratio (turbine) has beyond them."""
    for name, at in map_coordinates(engine, inputs, parameters).items():
        speed, position = np.exp(at[:, 0]), at[:, 1]
        first = polynomials(speed, SPEED_DEGREE)
        yield name, np.column_stack([first, polynomials(_beyond(position, first), POSITION_DEGREE)])


def floor(
    engine: Engine, inputs: Mapping[str, np.ndarray], parameters: Mapping[str, float], accuracy: float
) -> tuple[list[Discrepancy], dict[str, np.ndarray]]:
    """The floor's discrepancies and their curves by column; none for an accuracy of 0."""
    found: list[Discrepancy] = []
    curves: dict[str, np.ndarray] = {}
    if accuracy <= 0.0:
        return found, curves
    for name, columns in map_curves(engine, inputs, parameters):
        for j, curve in enumerate(columns.T):
            key = _key(name, j + 1)
            curves[key] = curve
            for quantity in QUANTITIES:
                found.append(Discrepancy(f"{name}.{quantity}", key, accuracy))
    return found, curves


def found_floor(
    engine: Engine, inputs: Mapping[str, np.ndarray], found: ErrorModel
) -> tuple[list[Discrepancy], dict[str, np.ndarray]]:
    """The floor as an identification found it: its own curves, frozen there, and sizes. Map coordinates are those of
    the engine as described, as there (`MapErrorModel`): amounts that were found belong to these."""
    machines = {m.name: m for m in turbomachines(engine)}
    at = map_coordinates(engine, inputs, {})
    discrepancies: list[Discrepancy] = []
    curves: dict[str, np.ndarray] = {}
    for c in found.curves:
        for j, curve in enumerate(c.evaluate(at[c.machine]).T, start=1):
            curves[_key(c.machine, j)] = curve
            discrepancies += [
                Discrepancy(target, _key(c.machine, j), found.sizes[target])
                for target in map(machines[c.machine].parameter, QUANTITIES)
                if target in found.sizes
            ]
    return discrepancies, curves


def amounts_of(engine: Engine, nominal: Nominal) -> dict[str, float]:
    """What the discrepancies of `found_floor` were where they were identified, by name."""
    values, found = nominal.theta0, nominal.error_model
    if found is None:
        return {}
    return {
        Discrepancy(target, _key(machine.name, j), 0.0).name: values[map_error_name(target, j)]
        for machine in turbomachines(engine)
        for target in map(machine.parameter, QUANTITIES)
        if target in found.sizes
        for j in range(1, CURVES + 1)
    }


def _key(machine: str, j: int) -> str:
    return f"map {machine} {j}"


def _beyond(values: np.ndarray, curves: np.ndarray) -> np.ndarray:
    """What is left of the values (N,) after regression on a constant and the curves (N, k)."""
    good = np.isfinite(values)
    A = np.column_stack([np.ones(good.sum()), curves[good]])
    left = np.full(len(values), np.nan)
    left[good] = values[good] - A @ np.linalg.lstsq(A, values[good], rcond=None)[0]
    return left
