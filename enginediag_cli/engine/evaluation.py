"""One evaluation of the network: the leaves it reads, and the flows, powers and balances that it makes.

Everything that a model reads is a *leaf*: an input column, a parameter, or an unknown, or it is `derived` from such
leaves when it is first read, as the position of an actuator that a control sets. A leaf named in `wrt` becomes a
direction of differentiation when it is first read, so directions follow the gas path.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from enginediag_cli.engine.dual import Array, Dual, Value
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.gas import Gas
from enginediag_cli.engine.hooks import Hooks, Stations

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
