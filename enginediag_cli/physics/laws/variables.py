"""What a law may vary with: named numbers without a unit, each a formula of a few columns of the model.

All but Mach number and humidity, which have no unit, are over what they are at the engine's design point: 1 there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import truediv
from typing import TYPE_CHECKING

import numpy as np

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
from enginediag_cli.engine.similarity import reynolds_index_of
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

Formula = Callable[..., Value]


@dataclass(frozen=True)
class Variable:
    """`name` in formulas; `words`: what it is; `driver`: of what kind. It is `of` columns of
    the model over what that is at the design point, `design`; or, `recorded`, an input as it stands."""

    name: str
    words: str
    driver: Driver
    columns: tuple[str, ...]
    of: Formula
    design: float = 1.0
    recorded: bool = False

    @property
    def reference(self) -> float:
        """What a formula takes at the design point."""
        return self.design if self.recorded else 1.0

    def at(self, e: Evaluation, network: Network) -> Value:
        """What a formula takes (N,). Raises KeyError as long as the gas path has not come so far."""
        return self._taken(self._read(e, network))

    def values(self, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """The same of columns (N,) that are known."""
        with np.errstate(all="ignore"):
            return np.asarray(self._taken([columns[c] for c in self.columns]))

    def _taken(self, columns: Sequence[Value]) -> Value:
        x = self.of(*columns)
        return x if self.recorded else x * (1.0 / self.design)

    def _read(self, e: Evaluation, network: Network) -> list[Value]:
        return [e[c] if self.recorded else _column(e, network, c) for c in self.columns]

    def at_design(self, network: Network) -> Variable:
        """The same with its design value. Raises KeyError where the engine has no such columns."""
        assert network.design_point is not None
        with np.errstate(all="ignore"):
            return replace(self, design=scalar(self.of(*self._read(network.design_point, network))))


def variables_of(network: Network) -> dict[str, Variable]:
    """By the name in formulas, those that the engine has and that are something at its design point."""
    point = network.design_point
    assert point is not None
    found: dict[str, Variable] = {}
    for v in _declared(network, tuple(point.flows)):
        try:
            known = v.at_design(network)
        except KeyError:
            continue
        if known.recorded or (np.isfinite(known.design) and known.design != 0.0):
            found[v.name] = known
    return found


def _declared(network: Network, stations: tuple[str, ...]) -> Iterator[Variable]:
    """As if every engine had all of them."""
    hot = next(c.values["to"] for c in network.components if isinstance(c, Burner))
    T2, T4 = f"T{network.inlet_exit}_K", f"T{hot}_K"
    yield Variable("mach", MACH.words, MACH, ("mach",), _itself, recorded=True)
    yield Variable("humidity", "water in the air, kg/kg", HUMIDITY, ("humidity_kg_kg",), _itself, recorded=True)
    yield Variable("ambient_pressure", "ambient pressure", AMBIENT_PRESSURE, ("P0_Pa",), _itself)
    yield Variable("inlet_temperature", INLET_TEMPERATURE.words, INLET_TEMPERATURE, (T2,), _itself)
    yield Variable("power", POWER.words, POWER, (T4, T2), truediv)
    yield Variable("burner_temperature", BURNER_TEMPERATURE.words, BURNER_TEMPERATURE, (T4,), _itself)
    yield _reynolds("reynolds_index", "at the inlet", network.inlet_exit)
    yield _reynolds("turbine_reynolds_index", "at the turbines", hot)
    for station in stations:
        yield _reynolds(f"reynolds_index_{station}", f"at station {station}", station)
    for column in network.speed_columns:
        label = split_column(column)[0]
        yield Variable(f"corrected_{label}", f"corrected {label}", CORRECTED_SPEED, (column, T2), _corrected)
        yield Variable(label, label, SHAFT_SPEED, (column,), _itself)
    for c in network.components:
        if isinstance(c, Nozzle):
            name = f"{c.name}_pressure_ratio"
            yield Variable(name, f"pressure ratio of {c.name}", NOZZLE_PRESSURE_RATIO, (name,), _itself)
    yield Variable("bypass_ratio", BYPASS_RATIO.words, BYPASS_RATIO, ("BPR",), _itself)
    behind = [c.values["to"] for c in network.components if isinstance(c, Compressor)]
    if behind:
        column = f"P{behind[-1]}_Pa"
        yield Variable("compressor_pressure", COMPRESSOR_PRESSURE.words, COMPRESSOR_PRESSURE, (column,), _itself)


def _reynolds(name: str, where: str, station: str) -> Variable:
    columns = (f"T{station}_K", f"P{station}_Pa")
    return Variable(name, f"Reynolds number index {where}", REYNOLDS_INDEX, columns, reynolds_index_of)


def _itself(x: Value) -> Value:
    return x


def _corrected(speed: Value, T_K: Value) -> Value:
    return speed / sqrt(T_K)


def _column(e: Evaluation, network: Network, column: str) -> Value:
    """A column while the gas path is gone along. Raises KeyError for one that is not known yet."""
    if column in network.speed_columns:
        e.flows[network.inlet_exit]  # how fast a shaft turns is told by the air that has come in
        return e.shaft(network.speed_columns[column]).speed_rpm
    return network.read(e, column)
