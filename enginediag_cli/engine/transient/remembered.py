"""What a term with memory remembers, in a simulation: the states of the filter by which it reads recordings.

A term declares one filter for both. Along a recording the filter is called with what was recorded; here its states move
with those of the engine, and its signal is what the network has there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from enginediag_cli.engine.dual import Array, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.hooks import Hooks
from enginediag_cli.engine.moving.filters.base import Following, Integrated, WithStates
from enginediag_cli.engine.moving.memory import Memory
from enginediag_cli.engine.transient.state import ELAPSED, STEP, State
from enginediag_cli.parameters import spelled

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class Remembered(State):
    """State `number` of a memory's filter, in the unit of its signal, which it is equal to in equilibrium."""

    def __init__(self, memory: Memory, number: int, network: Network):
        filter = memory.filter
        if not isinstance(filter, WithStates):
            raise TypeError(f"what {memory.name} remembers has no states")
        self.memory, self.number, self.filter = memory, number, filter
        self.follows = isinstance(filter, Following)
        self.beside = tuple(f"{memory.name}.state_{k + 1}" for k in range(filter.STATES))
        self.name = self.beside[number]
        self.words, self.unit = spelled(memory.name), ""
        self.leaf = network.leaf_of(memory.column) if memory.column else memory.name

    def install(self, hooks: Hooks, network: Network) -> None:
        if self.number:
            return  # the first one speaks for all
        held = hooks.leaves.setdefault(self.leaf, [])
        filtered = Filtering([Remembered(self.memory, k, network) for k in range(self.filter.STATES)])
        # what the network is told comes before effects on it, one memory behind the other
        held.insert(sum(isinstance(hook, Filtering) for hook in held), filtered)

    def stands_for(self, memory: Memory) -> bool:
        return memory is self.memory

    def value(self, e: Evaluation) -> Value:
        if self.name in e.signals:
            return e.signals[self.name]
        return e[self.leaf] if self.memory.column else e.signals[self.memory.name]

    def slope(self, e: Evaluation) -> Value:
        m = self.memory
        assert isinstance(self.filter, Integrated)
        states = [e.signals[name] for name in self.beside]
        return self.filter.slopes(e.signals[m.name], states, [e[c] for c in m.coefficients])[self.number]

    def overrun(self, time: Array, x: Array, leaves: Mapping[str, Value]) -> Array:
        assert isinstance(self.filter, Following)
        return self.filter.overrun(time, x, [value(leaves[c]) for c in self.memory.coefficients])


class Filtering:
    """Hook on the leaf that a memory sets: what the filter makes of its signal in a stage, or of states that are given.

    `states`: all of one filter."""

    def __init__(self, states: Sequence[Remembered]):
        self.states, self.memory = tuple(states), states[0].memory

    def __call__(self, e: Evaluation, x: Value) -> Value:
        m, filter = self.memory, self.states[0].filter
        signal = x if m.column else e.signals[m.name]
        coefficients = [e[c] for c in m.coefficients]
        if e.has(self.states[0].base):
            step = e[ELAPSED] if self.states[0].follows else e[STEP]
            states = filter.stage(signal, [e[s.base] for s in self.states], step, coefficients)
        else:
            states = tuple(e[s.name] for s in self.states)
        e.signals[m.name] = signal
        e.signals |= {s.name: now for s, now in zip(self.states, states, strict=True)}
        change = filter.deviation(signal, states, coefficients)
        return signal + change if m.column else change
