"""One evaluation of the network: the leaves it reads, and the flows, powers and balances that it makes.

Everything that a model reads is a *leaf*: an input column, a parameter, or an unknown, or it is `derived` from such
leaves when it is first read, as the position of an actuator that a control sets. A leaf named in `wrt` becomes a
direction of differentiation when it is first read, so directions follow the gas path.

Where an effect takes hold of the network: a leaf, a station or a reading.

Components know nothing of effects. What a component reads (`e["hpc.efficiency"]`) passes through the leaf hooks
of that name, the flow that it delivers through the hooks of its station, and what a sensor reads through those
of its column. A network without effects has no hooks and is untouched to the last digit.

Quantities of the gas path that several terms vary with, from an evaluation under way.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING
from weakref import ref

import numpy as np

from enginediag_cli.engine.atmosphere import P_ISA, T_ISA
from enginediag_cli.engine.dual import Array, Dual, Value, power, sqrt
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.gas import Gas

if TYPE_CHECKING:
    from enginediag_cli.engine.moving.recall import Memory


ValueHook = Callable[["Evaluation", Value], Value]
FlowHook = Callable[["Evaluation", "Flow"], "Flow"]


@dataclass(frozen=True)
class Solved:
    """An unknown `name` that stands for what `read` gives at the end of a pass, above 0: x / read = 1; `start`: of the
    iteration."""

    name: str
    read: Callable[[Evaluation], Value]
    start: float


@dataclass
class Hooks:
    """Functions by the name of the leaf, the station or the sensor column that they change, in order; what is
    remembered and what is solved for."""

    leaves: dict[str, list[ValueHook]] = field(default_factory=dict)
    stations: dict[str, list[FlowHook]] = field(default_factory=dict)
    readings: dict[str, list[ValueHook]] = field(default_factory=dict)
    memories: list[Memory] = field(default_factory=list)
    solved: list[Solved] = field(default_factory=list)

    def leaf(self, e: Evaluation, name: str, x: Value) -> Value:
        for hook in self.leaves.get(name, ()):
            x = hook(e, x)
        return x

    def reading(self, e: Evaluation, column: str, x: Value) -> Value:
        for hook in self.readings.get(column, ()):
            x = hook(e, x)
        return x


class Stations(dict[str, "Flow"]):
    """Flows by station; a flow passes through its station's hooks when it is delivered.

    The evaluation that owns it is held weakly: a ring of the two would keep all derivatives until the collector runs.
    """

    def __init__(self, e: Evaluation, hooks: Hooks):
        super().__init__()
        self._e, self._hooks = ref(e), hooks

    def __setitem__(self, station: str, flow: Flow) -> None:
        for hook in self._hooks.stations.get(station, ()):
            e = self._e()
            assert e is not None  # its owner is delivering the flow
            flow = hook(e, flow)
        super().__setitem__(station, flow)


Exchange = Callable[["Evaluation", Flow], Flow]
"""What a heat exchanger makes of the flow that enters its hot side."""


@dataclass
class Shaft:
    """What turns together: rotational speed and the powers put in and taken out so far [W]: by turbines, by
    compressors, and by what it drives outside the gas path."""

    speed_rpm: Value
    supply_W: Value = 0.0
    demand_W: Value = 0.0
    load_W: Value = 0.0


@dataclass
class Evaluation:
    """State of one pass through the network for N operating points."""

    gas: Gas
    size: int
    leaves: Mapping[str, Value]
    wrt: frozenset[str] = frozenset()
    directions: dict[str, int] = field(default_factory=dict)
    flows: dict[str, Flow] = field(default_factory=dict)
    bleeds: dict[str, Flow] = field(default_factory=dict)
    exchanges: dict[str, Exchange] = field(default_factory=dict)  # by the exchanger whose cold side has been passed
    shafts: dict[str, Shaft] = field(default_factory=dict)
    balances: dict[str, Value] = field(default_factory=dict)
    outputs: dict[str, Value] = field(default_factory=dict)
    outside: dict[str, Array] = field(default_factory=dict)
    theta2: Value = 1.0
    delta2: Value = 1.0
    make_shaft: Callable[[Evaluation, str], Shaft] | None = None
    hooks: Hooks | None = None
    derived: Mapping[str, Callable[[Evaluation], Value]] = field(default_factory=dict)
    signals: dict[str, Value] = field(default_factory=dict)  # of what is remembered, by the name of the memory
    _read: dict[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.hooks is not None and self.hooks.stations:
            self.flows = Stations(self, self.hooks)

    def __getitem__(self, name: str) -> Value:
        """A leaf's value, as the effects on it leave it; a direction of differentiation if it is asked for."""
        if name in self._read:
            return self._read[name]
        x = self.derived[name](self) if name in self.derived else self.leaves[name]
        if name in self.wrt:
            k = self.directions[name] = len(self.directions)
            d = np.zeros((k + 1, self.size))
            d[k] = 1.0
            x = Dual(np.broadcast_to(np.asarray(x, dtype=float), (self.size,)), d)
        if self.hooks is not None:
            x = self.hooks.leaf(self, name, x)
        self._read[name] = x
        return x

    def shaft(self, name: str) -> Shaft:
        """A shaft, its speed read when it is first met in the gas path."""
        if name not in self.shafts:
            assert self.make_shaft is not None
            self.shafts[name] = self.make_shaft(self, name)
        return self.shafts[name]

    def has(self, name: str) -> bool:
        return name in self.leaves

    def add_output(self, name: str, x: Value) -> None:
        """Adds to an output that several components contribute to (thrust, power)."""
        self.outputs[name] = self.outputs[name] + x if name in self.outputs else x

    def mark_outside(self, component: str, mask: Array, what: str = "") -> None:
        """Points (N,) that lie outside `what`, by default the map of a component."""
        self.outside[what or f"the map of {component}"] = mask


SUTHERLAND_K = 110.4  # Sutherland's constant of air


def viscosity_ratio(T_K: Value) -> Value:
    """μ(T)/μ(288.15 K) by Sutherland's law, μ ∝ T^1.5/(T + 110.4 K) (U.S. Standard Atmosphere 1976, eq. 51)."""
    t = T_K * (1.0 / T_ISA)
    return power(t, 1.5) * ((T_ISA + SUTHERLAND_K) / (T_K + SUTHERLAND_K))


def reynolds_index(flow: Flow) -> Value:
    """RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T): Reynolds number at equal Mach numbers over that at ISA sea level."""
    return reynolds_index_of(flow.T, flow.P)


def corrected_flow(flow: Flow) -> Value:
    """W √θ/δ [kg/s]."""
    return flow.W * sqrt(flow.T * (1.0 / T_ISA)) / (flow.P * (1.0 / P_ISA))


def reynolds_index_of(T_K: Value, P_Pa: Value) -> Value:
    """RNI at total temperature [K] and pressure [Pa]."""
    return P_Pa * (1.0 / P_ISA) / (viscosity_ratio(T_K) * sqrt(T_K * (1.0 / T_ISA)))
