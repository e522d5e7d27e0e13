"""The states of an engine that moves: rotors, slow actuators, and the memories of dynamic effects.

A state is a quantity x with dx/dt = f(x, …) that is fixed while the rest of the engine is in balance. In a *stage* of
the integration x is implicit, x = base + step · f: the network finds it, and reads the leaves `<state>.base` and
`step_s`. Where the state is *given* (at recorded points) the leaf `<state>` contains it.

- Rotor: I ω dω/dt is the power of its turbines minus that of everything they drive.
- Actuator: the position of a fuel valve, vanes or a nozzle that does not follow at once.
- Memory: the states of the filter of an effect. A term declares one filter. Along a recording it filters recorded
  values; here its states move with those of the engine, and its signal is the value in the network.

`MovingNetwork` has the same components as the network, with states in place of some balances. `TransientInputs` are the
inputs of a run along time, straight between corners.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine.controls import (
    AT_LIMIT,
    Control,
    Governor,
    Pace,
    SetPointControl,
    minimum,
    select_middle,
    select_surplus,
)
from enginediag_cli.engine.dual import Array, Value, maximum, value
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.evaluation import Evaluation, Hooks
from enginediag_cli.engine.filters import DynamicFilter, FilterClock, IntegratedFilter, TrackingFilter
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.recall import Memory, demanded_power
from enginediag_cli.parameters import spelled
from enginediag_cli.units import RAD_S_PER_RPM

STEP = "step_s"
"""Leaf with γ h of a stage, s."""
ELAPSED = "elapsed_s"
"""Leaf with the time since the beginning of the step, s."""


class TransientState(ABC):
    """One state, called `name`, in `unit`."""

    name: str
    unit: str
    words: str
    coarser = 1.0
    """Times as far from right as a rotor's speed it may be."""
    follows = False
    """Whether it goes with the rest of the engine at once, as far as it can from where it stood at the beginning of the
    step: that is then its base, and what is given of it."""

    @property
    def base(self) -> str:
        """The leaf from which a stage begins."""
        return f"{self.name}.base"

    @property
    def fixed_leaf(self) -> str:
        """The leaf with what is known of it at a record."""
        return self.base if self.follows else self.name

    @abstractmethod
    def install(self, hooks: Hooks, network: Network) -> None:
        """Where it takes hold of the network, in stages and where it is given."""

    @abstractmethod
    def value(self, e: Evaluation) -> Value:
        """x (N,) at the solution of a stage, or of a steady engine."""

    @property
    def model_column(self) -> str:
        """Model column, where the state is given, with how fast it changes; of what follows, with what it is."""
        return f"{self.name}.known"

    per_given = 1.0
    """By how much the leaf changes that it sets, where it is given."""

    @abstractmethod
    def slope(self, e: Evaluation) -> Value:
        """dx/dt (N,) at a solution where it is given."""

    def represents(self, memory: Memory) -> bool:
        """Whether it is the memory of an effect."""
        return False

    def power(self, x: Array, slope: Array) -> Array:
        """Energy (N,) [W] that the state takes up while it changes by `slope` (N,) per second; a signal takes none."""
        return np.zeros_like(x)

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        """By how much x (k, N), at rising `time` (k, N), moved further than it can: the error (N,) of what follows.
        `leaves`: inputs and parameters of the step."""
        return np.zeros(x.shape[1])

    def extrapolate(self, x: Array, names: Sequence[str], before: Array, after: Array) -> Array:
        """x (N,) behind a last small move of the unknowns `names`, from `before` (nx, N) to `after`."""
        return x


class RotorState(TransientState):
    """P_turbine η_m = P_compressor + P_offtake + I ω dω/dt; the state is ω, rad/s.

    Source: Walsh and Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8.
    """

    unit = "rad/s"
    per_given = 1.0 / RAD_S_PER_RPM

    def __init__(self, shaft: str, inertia_kg_m2: float):
        self.shaft, self.inertia_kg_m2 = shaft, inertia_kg_m2
        self.name, self.words = f"{shaft}.omega", f"{shaft} speed"

    def install(self, hooks: Hooks, network: Network) -> None:
        hooks.leaves.setdefault(f"{self.shaft}.power_offtake_W", []).append(self._offtake)

    def represents(self, memory: Memory) -> bool:
        return memory.rotor_shaft == self.shaft

    def value(self, e: Evaluation) -> Value:
        return e.shaft(self.shaft).speed_rpm * RAD_S_PER_RPM

    def power(self, x: Array, slope: Array) -> Array:
        return self.inertia_kg_m2 * x * slope

    def extrapolate(self, x: Array, names: Sequence[str], before: Array, after: Array) -> Array:
        k = names.index(f"{self.shaft}.corrected_speed")
        return x * (after[k] / before[k])

    def acceleration(self, e: Evaluation) -> Value:
        """dω/dt (N,) in rad/s²: of a stage, or, where the speed is given, from the power that is left over."""
        omega = self.value(e)
        if e.has_leaf(self.base):
            return (omega - e[self.base]) / e[STEP]
        return e.outputs[surplus_column(self.shaft)] / (omega * self.inertia_kg_m2)

    def slope(self, e: Evaluation) -> Value:
        return self.acceleration(e)

    def _offtake(self, e: Evaluation, load_W: Value) -> Value:
        if not e.has_leaf(self.base):
            return load_W
        omega = self.value(e)
        return load_W + omega * ((omega - e[self.base]) / e[STEP]) * self.inertia_kg_m2


def surplus_column(shaft: str) -> str:
    """Model column with the power that accelerates a shaft, where its speed is given."""
    return f"{shaft}_surplus_W"


class ActuatorState(TransientState):
    """τ d ln x/dt = −F of fuel, τ du/dt = −F of a position u between stops, and |dx/dt| at most the rate; F, which the
    control brings to zero, rises with the position. With a rate alone F = 0 holds wherever it can be reached from where
    the actuator stood at the beginning of the step. Where neither is given there is no state."""

    coarser = 20.0
    """Its rate jumps where a limit takes over, and a step across that is only of first order."""

    def __init__(self, control: Control, network: Network):
        self.control, self.governs = control, isinstance(control, Governor)
        self.name, self.words = f"{control.name}.stands", f"{control.name} actuator"
        self.unit = control.actuator.unit
        self._way = 1.0
        if not self.governs:
            stops = getattr(control, "stops", None)
            if stops is None or not control.unknowns():
                raise ValueError(
                    f"{control.name}: what is recorded, or follows an input of the engine, has no time constant or "
                    "rate of its own"
                )
            self._unknown, self._way = stops.unknown, stops.high - stops.low
        self.follows = not control.pace.time_constant_s
        self._rate = control.pace.rate_per_s / self._way

    def install(self, hooks: Hooks, network: Network) -> None:
        """Nothing: it acts through the balance of its control."""

    def value(self, e: Evaluation) -> Value:
        """Fuel flow, kg/s, or the position's unknown, 1 at the low stop to 2."""
        return e.outputs["Wf_kg_s"] if self.governs else e[self._unknown]

    def hurried(self, e: Evaluation, network: Network) -> Array:
        """Where the actuator is on its way as fast as it can (N,); unknown where the control has a time constant."""
        pace, control = self.control.pace, self.control
        if not pace.rate_per_s or pace.time_constant_s or not isinstance(control, (Governor, SetPointControl)):
            return np.zeros(e.size, dtype=bool)
        surplus = value(select_surplus(control.aim, control.limits, e, network))
        stopped = (
            np.any(list(control.stops.acting(e, AT_LIMIT).values()), axis=0)
            if isinstance(control, SetPointControl)
            else False
        )
        return (np.abs(surplus) > AT_LIMIT) & ~np.asarray(stopped)

    def balance(self, e: Evaluation, surplus: Value) -> Value:
        """What is zero: the law, between the positions that can be reached within a stage."""
        x = self.value(e)
        size = x if self.governs else 1.0
        pace = self.control.pace
        if self.follows:
            moved, reach = (x - e[self.base]) / size, e[ELAPSED] * self._rate / size
            return select_middle(moved + reach, reach - moved, surplus)
        if not e.has_leaf(self.base):
            e.signals[self.name] = surplus
            return (x - e[self.name]) / size
        moved = (x - e[self.base]) / size
        total = surplus + moved * (pace.time_constant_s / e[STEP])
        if not pace.rate_per_s:
            return total
        reach = e[STEP] * self._rate / size
        return select_middle(moved + reach, reach - moved, total)

    def slope(self, e: Evaluation) -> Value:
        size = self.value(e) if self.governs else 1.0
        free = e.signals[self.name] * size * (-1.0 / self.control.pace.time_constant_s)
        if not self.control.pace.rate_per_s:
            return free
        return maximum(minimum(free, self._rate), -self._rate)

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        moved = np.abs(np.diff(x, axis=0)) - self._rate * np.diff(time, axis=0)
        return np.asarray(np.maximum(moved.max(axis=0), 0.0))


class MemoryState(TransientState):
    """State `number` of a memory's filter, in the unit of its signal, which it is equal to in equilibrium."""

    def __init__(self, memory: Memory, number: int, network: Network):
        filter = memory.filter
        if not isinstance(filter, DynamicFilter):
            raise TypeError(f"the dynamic effect {memory.name} has no states")
        self.memory, self.number, self.filter = memory, number, filter
        self.follows = isinstance(filter, TrackingFilter)
        self.beside = tuple(f"{memory.name}.state_{k + 1}" for k in range(filter.STATES))
        self.name = self.beside[number]
        self.words, self.unit = spelled(memory.name), ""
        self.leaf = network.input_leaf(memory.column) if memory.column else memory.name

    def install(self, hooks: Hooks, network: Network) -> None:
        if self.number:
            return  # the first one speaks for all
        held = hooks.leaves.setdefault(self.leaf, [])
        filtered = Filtering([MemoryState(self.memory, k, network) for k in range(self.filter.STATES)])
        # inputs of the network come before effects on them, one memory behind the other
        held.insert(sum(isinstance(hook, Filtering) for hook in held), filtered)

    def represents(self, memory: Memory) -> bool:
        return memory is self.memory

    def value(self, e: Evaluation) -> Value:
        if self.name in e.signals:
            return e.signals[self.name]
        return e[self.leaf] if self.memory.column else e.signals[self.memory.name]

    def slope(self, e: Evaluation) -> Value:
        m = self.memory
        assert isinstance(self.filter, IntegratedFilter)
        states = [e.signals[name] for name in self.beside]
        return self.filter.slopes(e.signals[m.name], states, [e[c] for c in m.coefficients])[self.number]

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        assert isinstance(self.filter, TrackingFilter)
        return self.filter.overrun(time, x, [value(leaves[c]) for c in self.memory.coefficients])


class Filtering:
    """Hook on the leaf that a memory sets: what the filter makes of its signal in a stage, or of states that are given.

    `states`: all of one filter."""

    def __init__(self, states: Sequence[MemoryState]):
        self.states, self.memory = tuple(states), states[0].memory

    def __call__(self, e: Evaluation, x: Value) -> Value:
        m, filter = self.memory, self.states[0].filter
        signal = x if m.column else e.signals[m.name]
        coefficients = [e[c] for c in m.coefficients]
        if e.has_leaf(self.states[0].base):
            step = e[ELAPSED] if self.states[0].follows else e[STEP]
            states = filter.stage(signal, [e[s.base] for s in self.states], step, coefficients)
        else:
            states = tuple(e[s.name] for s in self.states)
        e.signals[m.name] = signal
        e.signals |= {s.name: now for s, now in zip(self.states, states, strict=True)}
        change = filter.deviation(signal, states, coefficients)
        return signal + change if m.column else change


def remembered(engine: Engine, varied: Sequence[str] = ()) -> tuple[Memory, ...]:
    """Memories of the terms that an engine carries; `varied`: parameters that will not be at their nominal values."""
    nominal = engine.nominal
    return tuple(
        m for m in engine.network.memories if any(n in varied or nominal[n] != absent for n, absent in m.absent.items())
    )


def transient_states(engine: Engine, varied: Sequence[str] = ()) -> tuple[TransientState, ...]:
    """Rotors whose speed follows from a balance of power, actuators that do not follow at once, and filters of terms.
    What the reading of one sensor remembers is no state: it is filtered along the run. Raises ValueError for an inertia
    that is given twice, and for a term that needs a state and has none."""
    network, found = engine.network, list[TransientState]()
    memories = remembered(engine, varied)
    inertias = {n: s["inertia_kg_m2"] for n, s in network.shafts.items() if s["inertia_kg_m2"] > 0.0}
    for m in memories:
        if m.rotor_shaft in inertias:
            raise ValueError(
                f"{engine.name}: shaft {m.rotor_shaft} has its inertia twice, as inertia_kg_m2 of the shaft and as "
                f"{m.coefficients[0]} of its physics; remove one of them"
            )
        if m.rotor_shaft and set(m.coefficients) & set(varied):
            raise ValueError(f"{engine.name}: {m.coefficients[0]} cannot change while the engine is flown along time")
    inertias |= {m.rotor_shaft: engine.nominal[m.coefficients[0]] for m in memories if m.rotor_shaft}
    for name, shaft in network.shafts.items():
        if name in inertias and shaft["speed"] == "balance":
            found.append(RotorState(name, inertias[name]))
    found += [ActuatorState(c, network) for c in network.controls if c.pace != Pace()]
    for m in memories:
        if m.sensor or any(s.represents(m) for s in found):
            continue
        if not m.filter.STATES and not m.column and not m.recorded:
            raise ValueError(
                f"{engine.name}: the dynamic effect {m.name} acts back on the engine, and its filter has no states to "
                "integrate; take every record as steady with --steady, or remove the term"
            )
        found += [MemoryState(m, k, network) for k in range(m.filter.STATES)]
    return tuple(found)


STRAIGHT = 1e-6
"""Of the largest value of a column: records that lie as near as that to a straight line between others bend nothing."""


@dataclass(frozen=True)
class InputCourse:
    """Corners of all runs one after the other: `time` (C,) s, columns (C,) by name; run r has corners `first[r]` to
    `last[r]`, both included."""

    time: Array
    columns: Mapping[str, Array]
    first: Array
    last: Array

    def evaluate(self, corner: Array, time: Array) -> dict[str, Array]:
        """Columns (n,) at `time` (n,), each between its `corner` (n,) and the next one."""
        span = self.time[corner + 1] - self.time[corner]
        share = (time - self.time[corner]) / span
        return {c: v[corner] + (v[corner + 1] - v[corner]) * share for c, v in self.columns.items()}


def make_course(runs: Sequence[tuple[Array, Mapping[str, Array]]]) -> InputCourse:
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
    return InputCourse(np.concatenate(times), table, np.array(first), np.array(last))


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

    def __init__(self, network: Network, states: Sequence[TransientState]):
        self.__dict__.update(vars(network))
        self.states = tuple(states)
        self.paces = {s.control: s for s in states if isinstance(s, ActuatorState)}
        self.rotors = {s.shaft: s for s in states if isinstance(s, RotorState)}
        carried = network.hooks or Hooks()
        self.hooks = Hooks(
            {k: list(v) for k, v in carried.leaves.items()},
            {k: list(v) for k, v in carried.stations.items()},
            {k: list(v) for k, v in carried.readings.items()},
            [m for m in carried.memories if not any(s.represents(m) for s in states)],
            list(carried.solved),
        )
        # an effect whose memory is a state is there, whatever it remembers
        self._own = {s.memory.name for s in states if isinstance(s, MemoryState)}
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


class FixedStateNetwork(MovingNetwork):
    """The same where all states are given: speeds are no unknowns, and what their balances leave is a column."""

    def __init__(self, network: Network, states: Sequence[TransientState]):
        super().__init__(network, states)
        self.shafts = {n: {**s, "speed": "given"} if n in self.rotors else s for n, s in self.shafts.items()}
        self._unknowns = None
        self.known = {s.model_column: s for s in self.states}

    def inputs(self) -> dict[str, float | None]:
        return super().inputs() | {s.fixed_leaf: None for s in self.states} | {ELAPSED: None}

    def leaves(
        self, inputs: Mapping[str, Value], parameters: Mapping[str, Value], x: Mapping[str, Value]
    ) -> dict[str, Value]:
        found = super().leaves(inputs, parameters, x)
        for name, rotor in self.rotors.items():
            found[f"{name}.speed_rpm"] = inputs[rotor.name] * (1.0 / RAD_S_PER_RPM)
        return found

    def input_leaf(self, column: str) -> str:
        """A rotor that is given sets its shaft's speed."""
        found = next((name for name, rotor in self.rotors.items() if rotor.name == column), None)
        return super().input_leaf(column) if found is None else f"{found}.speed_rpm"

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
class TransientInputs:
    """Inputs of one engine along time: columns (C,) of inputs and, where they are not nominal, parameters at rising
    `time` (C,) s, straight between; `records` (N,): times at which its states are wanted."""

    time: Array
    columns: Mapping[str, Array]
    records: Array


def _numbers(values: Mapping[str, Any], names: Sequence[str]) -> list[float]:
    return [float(np.mean(values[n])) for n in names]


def network_inputs(engine: Engine, flight: TransientInputs) -> tuple[Array, dict[str, Array]]:
    """Times and columns of a flight as the network reads them: the power that a set point asks for, and columns that
    come through a filter without states (a delay)."""
    network, time = engine.network, flight.time
    columns = dict(flight.columns)
    if network.demand is not None:
        time, columns = interpolate_inputs(
            np.interp(np.arange((len(time) - 1) * BEND + 1) / BEND, np.arange(len(time)), time), flight
        )
        theta = {**engine.nominal, **columns}
        asked = dict(zip(network.demand.names, _numbers(theta, network.demand.names), strict=True))
        columns[network.power_setting] = demanded_power(engine, columns, {**theta, **asked}, (), len(time)).value
        del columns[network.demand.column]
    for m in remembered(engine, tuple(columns)):
        if not m.column or m.filter.STATES or m.column not in columns:
            continue
        coefficients = _numbers({**engine.nominal, **columns}, m.coefficients)
        now = TransientInputs(time, columns, flight.records)
        bends = m.filter.kink_times(time, coefficients)
        time, columns = interpolate_inputs(np.union1d(time, bends[(bends > time[0]) & (bends < time[-1])]), now)
        first = np.zeros(len(time), dtype=bool)
        first[0] = True
        signal = columns[m.column]
        columns[m.column] = (
            signal + m.filter(FilterClock(time, first), signal, np.zeros((0, len(time))), coefficients).value
        )
    return time, columns


def interpolate_inputs(time: Array, flight: TransientInputs) -> tuple[Array, dict[str, Array]]:
    return time, {c: np.interp(time, flight.time, v) for c, v in flight.columns.items()}
