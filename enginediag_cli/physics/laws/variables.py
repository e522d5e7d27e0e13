"""What a law may vary with: named numbers without a unit, which an evaluation of the engine gives.

All but Mach number and humidity, which have no unit, are over what they are at the engine's design point: 1 there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from enginediag_cli.drivers import (
    AMBIENT_PRESSURE,
    BURNER_TEMPERATURE,
    BYPASS_RATIO,
    COMPRESSOR_PRESSURE,
    CORRECTED_SPEED,
    HUMIDITY,
    INLET_TEMPERATURE,
    MACH,
    NOZZLE_PRESSURE_RATIO,
    POWER,
    REYNOLDS_INDEX,
    SHAFT_SPEED,
)
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.burner import Burner
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.nozzle import Nozzle
from enginediag_cli.engine.driver import Driver
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.similarity import reynolds_index
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

Read = Callable[[Evaluation], Value]


@dataclass(frozen=True)
class Variable:
    """`name` in formulas; `words`: what it is; `driver`: of what kind. `read`: from an evaluation, KeyError as long as
    the gas path has not come so far; `design`: the same at the design point; `ratio`: whether a formula takes it over
    that."""

    name: str
    words: str
    driver: Driver
    read: Read
    design: float
    ratio: bool = True

    @property
    def reference(self) -> float:
        """What a formula takes at the design point."""
        return 1.0 if self.ratio else self.design

    def at(self, e: Evaluation) -> Value:
        """What a formula takes (N,). Raises KeyError as long as the gas path has not come so far."""
        x = self.read(e)
        return x * (1.0 / self.design) if self.ratio else x


def variables_of(network: Network) -> dict[str, Variable]:
    """By the name in formulas, those that the engine has and that are not 0 at its design point."""
    assert network.design_point is not None
    found: dict[str, Variable] = {}
    for name, words, driver, read, ratio in _declared(network):
        try:
            design = scalar(read(network.design_point))
        except KeyError:
            continue
        if design != 0.0 or not ratio:
            found[name] = Variable(name, words, driver, read, design, ratio)
    return found


def _declared(network: Network) -> Iterator[tuple[str, str, Driver, Read, bool]]:
    inlet = network.inlet_exit
    hot = next(c.values["to"] for c in network.components if isinstance(c, Burner))
    yield "mach", MACH.words, MACH, lambda e: e["mach"], False
    yield "humidity", "water in the air, kg/kg", HUMIDITY, lambda e: e["humidity_kg_kg"], False
    yield "ambient_pressure", "ambient pressure", AMBIENT_PRESSURE, _output("P0_Pa"), True
    yield "inlet_temperature", INLET_TEMPERATURE.words, INLET_TEMPERATURE, _temperature(inlet), True
    yield "power", POWER.words, POWER, lambda e: e.flows[hot].T / e.flows[inlet].T, True
    yield "burner_temperature", BURNER_TEMPERATURE.words, BURNER_TEMPERATURE, _temperature(hot), True
    yield "reynolds_index", "Reynolds number index at the inlet", REYNOLDS_INDEX, _reynolds(inlet), True
    yield "turbine_reynolds_index", "Reynolds number index at the turbines", REYNOLDS_INDEX, _reynolds(hot), True
    assert network.design_point is not None
    for station in network.design_point.flows:
        words = f"Reynolds number index at station {station}"
        yield f"reynolds_index_{station}", words, REYNOLDS_INDEX, _reynolds(station), True
    for column, shaft in network.speed_columns.items():
        label = split_column(column)[0]
        yield f"corrected_{label}", f"corrected {label}", CORRECTED_SPEED, _corrected(shaft, inlet), True
        yield label, f"{label}", SHAFT_SPEED, _speed(shaft, inlet), True
    for c in network.components:
        if isinstance(c, Nozzle):
            column = f"{c.name}_pressure_ratio"
            yield column, f"pressure ratio of {c.name}", NOZZLE_PRESSURE_RATIO, _output(column), True
    yield "bypass_ratio", BYPASS_RATIO.words, BYPASS_RATIO, _output("BPR"), True
    behind = [c.values["to"] for c in network.components if isinstance(c, Compressor)]
    if behind:
        yield "compressor_pressure", COMPRESSOR_PRESSURE.words, COMPRESSOR_PRESSURE, _pressure(behind[-1]), True


def _output(column: str) -> Read:
    return lambda e: e.outputs[column]


def _temperature(station: str) -> Read:
    return lambda e: e.flows[station].T


def _pressure(station: str) -> Read:
    return lambda e: e.flows[station].P


def _reynolds(station: str) -> Read:
    return lambda e: reynolds_index(e.flows[station])


def _speed(shaft: str, inlet: str) -> Read:
    def read(e: Evaluation) -> Value:
        e.flows[inlet]  # a shaft that turns is told by the air that has come in
        return e.shaft(shaft).speed_rpm

    return read


def _corrected(shaft: str, inlet: str) -> Read:
    speed = _speed(shaft, inlet)
    return lambda e: speed(e) / sqrt(e.flows[inlet].T)
