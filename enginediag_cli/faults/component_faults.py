"""Faults of components: parameters of the engine that change with time."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.hints import near
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import ConfigError, Mark, Problem
from enginediag_cli.faults.laws import STEP, Clocks, activity
from enginediag_cli.faults.sensor_faults import SensorFault
from enginediag_cli.parameters import Parameter

NOWHERE = Mark("fault")


@dataclass(frozen=True)
class ComponentFault:
    """A direction in parameter space, its size at full activity and the law by which it gets there.

    `changes`: parameter → change at severity 1, relative where the nominal value is not 0, else in its unit.
    """

    name: str
    changes: Mapping[str, float]
    severity: float = 1.0
    law: Mapping[str, Any] = field(default_factory=lambda: dict(STEP))
    marks: Mapping[str, Mark] = field(default_factory=dict)
    mark: Mark = NOWHERE
    reference: str = ""
    assumed: bool = False

    def mark_of(self, parameter: str) -> Mark:
        return self.marks.get(parameter, self.mark)


@dataclass(frozen=True)
class FaultSet:
    """Faults that are in an engine together."""

    components: tuple[ComponentFault, ...] = ()
    sensors: tuple[SensorFault, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return (*(fault.name for fault in self.components), *(fault.name for fault in self.sensors))


def check_faults(faults: FaultSet, engine: EngineLike) -> None:
    """Raises ConfigError with every parameter and column that the engine does not have, and a near match."""
    problems: list[Problem] = []
    for fault in faults.components:
        problems += [
            Problem(
                fault.mark_of(name), f"engine {engine.name!r} has no parameter {name!r}", near(name, engine.parameters)
            )
            for name in fault.changes
            if name not in engine.parameters
        ]
    readable = (*engine.sensors, *engine.inputs, *engine.optional_inputs)
    problems += [
        Problem(fault.mark, f"engine {engine.name!r} has no sensor {fault.column!r}", near(fault.column, readable))
        for fault in faults.sensors
        if fault.column not in readable
    ]
    if problems:
        raise ConfigError(problems)


def parameter_values(
    faults: Iterable[ComponentFault],
    parameters: Mapping[str, Parameter],
    clocks: Clocks,
) -> dict[str, NDArray[np.float64]]:
    """Value (N,) of every parameter that a fault changes.

    Faults on one parameter multiply where the nominal value is not 0, θ_k = θ0 Π (1 + severity · change ·
    g_k), and add where it is, θ_k = Σ severity · change · g_k. Raises ConfigError where a value leaves the
    bounds.
    """
    values: dict[str, NDArray[np.float64]] = {}
    for fault in faults:
        grown = fault.severity * activity(fault.law, clocks)
        for name, change in fault.changes.items():
            nominal = parameters[name].nominal
            before = values.get(name, np.full(len(grown), nominal))
            values[name] = before * (1.0 + change * grown) if nominal else before + change * grown
            _check_bounds(fault, parameters[name], values[name])
    return values


def _check_bounds(fault: ComponentFault, parameter: Parameter, values: NDArray[np.float64]) -> None:
    below, above = values < parameter.lower, values > parameter.upper
    beyond = below | above
    if beyond.any():
        k = int(np.argmax(beyond))
        bound = parameter.lower if below[k] else parameter.upper
        raise ConfigError(
            [
                Problem(
                    fault.mark_of(parameter.name),
                    f"fault {fault.name!r} takes {parameter.name} to {values[k]:g} at record {k + 1}, "
                    f"beyond its bound {bound:g}",
                    "lower the severity, or end the fault earlier",
                )
            ]
        )
