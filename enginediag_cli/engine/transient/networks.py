"""The network of an engine that moves: the same components, with states in place of some balances.

What moving engines are asked for along time: runs of records, their inputs straight between corners.

What the network of a moving engine is told along time, from what its flight asks for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.controls.control import Control
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation, Hooks
from enginediag_cli.engine.moving.filters import Clock
from enginediag_cli.engine.moving.recall import asked_for
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.transient.states import (
    ELAPSED,
    Actuator,
    Remembered,
    Rotor,
    State,
    remembered,
    surplus_column,
)
from enginediag_cli.units import RAD_S_PER_RPM

STRAIGHT = 1e-6
"""Of the largest value of a column: records that lie as near as that to a straight line between others bend nothing."""


@dataclass(frozen=True)
class Course:
    """Corners of all runs one after the other: `time` (C,) s, columns (C,) by name; run r has corners `first[r]` to
    `last[r]`, both included."""

    time: Array
    columns: Mapping[str, Array]
    first: Array
    last: Array

    def at(self, corner: Array, time: Array) -> dict[str, Array]:
        """Columns (n,) at `time` (n,), each between its `corner` (n,) and the next one."""
        span = self.time[corner + 1] - self.time[corner]
        share = (time - self.time[corner]) / span
        return {c: v[corner] + (v[corner + 1] - v[corner]) * share for c, v in self.columns.items()}


def course_of(runs: Sequence[tuple[Array, Mapping[str, Array]]]) -> Course:
    """From rising times (C,) and columns (C,) of each run; every run has two corners at least."""
    names = list(runs[0][1])
    scale = {c: max(max(float(np.abs(of[c]).max(initial=0.0)) for _, of in runs), 1e-300) for c in names}
    times, columns, first, last = [], [], [], []
    total = 0
    for time, of in runs:
        kept = corners(time, np.stack([of[c] / scale[c] for c in names]))
        t = time[kept]
        if len(kept) == 1:  # one record alone: it stands still
            kept, t = np.repeat(kept, 2), np.array([t[0], t[0] + 1.0])
        times.append(t)
        columns.append({c: of[c][kept] for c in names})
        first.append(total)
        total += len(kept)
        last.append(total - 1)
    table = {c: np.concatenate([of[c] for of in columns]) for c in names}
    return Course(np.concatenate(times), table, np.array(first), np.array(last))


def corners(time: Array, table: Array) -> Array:
    """Records of (n,) that straight lines must pass through, so that none of `table` (columns, n) lies further off than
    STRAIGHT: the first, the last, and of each stretch between two the one that lies furthest off, until none does
    (Ramer 1972, Douglas and Peucker 1973)."""
    n = len(time)
    kept = np.zeros(n, dtype=bool)
    kept[[0, n - 1]] = True
    open_stretches = [(0, n - 1)]
    while open_stretches:
        a, b = open_stretches.pop()
        if b - a < 2:
            continue
        share = (time[a + 1 : b] - time[a]) / (time[b] - time[a])
        line = table[:, a, None] + (table[:, b] - table[:, a])[:, None] * share
        off = np.abs(table[:, a + 1 : b] - line).max(axis=0, initial=0.0)
        if not off.max() <= STRAIGHT:
            k = a + 1 + int(off.argmax())
            kept[k] = True
            open_stretches += [(a, k), (k, b)]
    return np.flatnonzero(kept)


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


BEND = 16
"""Parts of a stretch between two set points in which a power that is a curve of the set point is taken straight."""


@dataclass(frozen=True)
class Flight:
    """What one engine is asked for: columns (C,) of inputs and, where they are not nominal, parameters at rising
    `time` (C,) s, straight between; `records` (N,): times at which its states are wanted."""

    time: Array
    columns: Mapping[str, Array]
    records: Array


def _numbers(values: Mapping[str, Any], names: Sequence[str]) -> list[float]:
    return [float(np.mean(values[n])) for n in names]


def told(engine: Engine, flight: Flight) -> tuple[Array, dict[str, Array]]:
    """Times and columns of a flight as the network reads them: the power that a set point asks for, and columns that
    come through a filter without states (a delay)."""
    network, time = engine.network, flight.time
    columns = dict(flight.columns)
    if network.demand is not None:
        time, columns = _at(np.interp(np.arange((len(time) - 1) * BEND + 1) / BEND, np.arange(len(time)), time), flight)
        theta = {**engine.nominal, **columns}
        asked = dict(zip(network.demand.names, _numbers(theta, network.demand.names), strict=True))
        columns[network.power_setting] = asked_for(engine, columns, {**theta, **asked}, (), len(time)).value
        del columns[network.demand.column]
    for m in remembered(engine, tuple(columns)):
        if not m.column or m.filter.STATES or m.column not in columns:
            continue
        coefficients = _numbers({**engine.nominal, **columns}, m.coefficients)
        now = Flight(time, columns, flight.records)
        bends = m.filter.bends(time, coefficients)
        time, columns = _at(np.union1d(time, bends[(bends > time[0]) & (bends < time[-1])]), now)
        first = np.zeros(len(time), dtype=bool)
        first[0] = True
        signal = columns[m.column]
        columns[m.column] = signal + m.filter(Clock(time, first), signal, np.zeros((0, len(time))), coefficients).value
    return time, columns


def _at(time: Array, flight: Flight) -> tuple[Array, dict[str, Array]]:
    return time, {c: np.interp(time, flight.time, v) for c, v in flight.columns.items()}
