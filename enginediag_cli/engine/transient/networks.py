"""The network of an engine that moves: the same components, with states in place of some balances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.engine.controls.control import Control
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.hooks import Hooks
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.transient.actuator import Actuator
from enginediag_cli.engine.transient.remembered import Remembered
from enginediag_cli.engine.transient.rotor import Rotor, surplus_column
from enginediag_cli.engine.transient.state import ELAPSED, State
from enginediag_cli.units import RAD_S_PER_RPM


class MovingNetwork(Network):
    """A network in a stage of the integration: its unknowns and balances are those of the steady engine, the balances
    with what the states take up."""

    def __init__(self, network: Network, states: Sequence[State]):
        self.__dict__.update(vars(network))
        self.states = tuple(states)
        self.paces = {s.control: s for s in states if isinstance(s, Actuator)}
        self.rotors = {s.shaft: s for s in states if isinstance(s, Rotor)}
        carried = network.hooks or Hooks()
        self.hooks = Hooks(
            {k: list(v) for k, v in carried.leaves.items()},
            {k: list(v) for k, v in carried.stations.items()},
            {k: list(v) for k, v in carried.readings.items()},
            [m for m in carried.memories if not any(s.stands_for(m) for s in states)],
            list(carried.solved),
        )
        # an effect whose memory is a state is there, whatever it remembers
        self._own = {s.memory.name for s in states if isinstance(s, Remembered)}
        for state in states:
            state.install(self.hooks, self)

    def rate(self, e: Evaluation, column: str) -> Value:
        """d(column)/dt of a shaft's speed."""
        shaft = self.speed_columns.get(column, "")
        return self.rotors[shaft].acceleration(e) * (1.0 / RAD_S_PER_RPM) if shaft in self.rotors else 0.0

    def paced(self, control: Control, e: Evaluation, surplus: Value) -> Value:
        return self.paces[control].balance(e, surplus) if control in self.paces else surplus

    def leaves(
        self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Mapping[str, Value]
    ) -> dict[str, Value]:
        return super().leaves(inputs, parameters, x) | {name: np.zeros(()) for name in self._own}

    def power(self, states: Array, slopes: Array) -> Array:
        """What each state takes up (ns, N) [W] while it changes by `slopes` (ns, N) per second."""
        return np.reshape([s.power(x, d) for s, x, d in zip(self.states, states, slopes, strict=True)], states.shape)


class GivenNetwork(MovingNetwork):
    """The same where all states are given: speeds are no unknowns, and what their balances leave is a column."""

    def __init__(self, network: Network, states: Sequence[State]):
        super().__init__(network, states)
        self.shafts = {n: {**s, "speed": "given"} if n in self.rotors else s for n, s in self.shafts.items()}
        self._unknowns = None
        self.known = {s.known: s for s in self.states}

    def inputs(self) -> dict[str, float | None]:
        return super().inputs() | {s.given: None for s in self.states} | {ELAPSED: None}

    def leaves(
        self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Mapping[str, Value]
    ) -> dict[str, Value]:
        found = super().leaves(inputs, parameters, x)
        for name, rotor in self.rotors.items():
            found[f"{name}.speed_rpm"] = inputs[rotor.name] * (1.0 / RAD_S_PER_RPM)
        return found

    def leaf_of(self, column: str) -> str:
        """A rotor that is given sets its shaft's speed."""
        found = next((name for name, rotor in self.rotors.items() if rotor.name == column), None)
        return super().leaf_of(column) if found is None else f"{found}.speed_rpm"

    def read(self, e: Evaluation, column: str) -> Value:
        state = self.known.get(column)
        if state is None:
            return super().read(e, column)
        return state.value(e) if state.follows else state.slope(e)

    def acting(self, e: Evaluation) -> dict[str, Array]:
        rates = {f"{control.name}.rate": s.hurried(e, self) for control, s in self.paces.items()}
        return super().acting(e) | {name: mask for name, mask in rates.items() if mask.any()}

    def open_loop(self, e: Evaluation) -> None:
        super().open_loop(e)
        for name in self.rotors:
            e.outputs[surplus_column(name)] = e.balances.pop(f"{name} power") * e.shaft(name).supply_W
