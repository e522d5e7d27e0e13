"""An engine with states, as simulation sees it: it is flown along records, and then read like any other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.controls.control import Pace
from enginediag_cli.engine.dual import Array, value
from enginediag_cli.engine.engine import Engine, Prediction
from enginediag_cli.engine.network import Network
from enginediag_cli.engine.transient.actuator import Actuator
from enginediag_cli.engine.transient.course import course_of
from enginediag_cli.engine.transient.integrate import TOLERANCE, Track, between, integrate
from enginediag_cli.engine.transient.networks import GivenNetwork, MovingNetwork
from enginediag_cli.engine.transient.rotor import Rotor
from enginediag_cli.engine.transient.state import ELAPSED, State


def states_of(network: Network) -> tuple[State, ...]:
    """The states that an engine file gives: rotors whose speed follows from a balance of power."""
    found: list[State] = []
    for name, shaft in network.shafts.items():
        if shaft["inertia_kg_m2"] > 0.0 and shaft["speed"] == "balance":
            found.append(Rotor(name, shaft["inertia_kg_m2"]))
    found += [Actuator(c, network) for c in network.controls if c.pace != Pace()]
    return tuple(found)


@dataclass(frozen=True)
class Flight:
    """What one engine is asked for: columns (C,) of inputs and, where they are not nominal, parameters at rising
    `time` (C,) s, straight between; `records` (N,): times at which its states are wanted."""

    time: Array
    columns: Mapping[str, Array]
    records: Array


class MovingEngine:
    """`engine` with its states. Raises ValueError for a power setting that says what a state is to be."""

    def __init__(self, engine: Engine, tolerance: float = TOLERANCE):
        self.engine, self.tolerance = engine, tolerance
        network = engine.network
        self.states = states_of(network)
        self.network = MovingNetwork(network, self.states)
        held = network.governor.aim if network.governor is not None else None
        shaft = network.speed_columns.get(held.column, "") if held is not None else ""
        if held is not None and shaft in self.network.rotors and not held.lead_s:
            raise ValueError(
                f"{engine.name}: {held.owner} is to hold {held.column} at once, which no fuel can with an inertia; "
                "give it lead_s, in seconds, for its time constant"
            )
        given = network.given_leaf or ""
        for rotor in self.network.rotors.values():
            if given == f"{rotor.shaft}.speed_rpm":
                raise ValueError(
                    f"{engine.name}: {engine.power_setting} as power setting says how fast {rotor.shaft} turns, so "
                    "that its inertia has nothing to move; let a fuel control meet it (`controls:` with actuator fuel "
                    "and lead_s)"
                )
        self._given = _as_given(engine, GivenNetwork(network, self.states))

    def fly(self, flights: Sequence[Flight]) -> list[tuple[Array, Array]]:
        """What is known at the records of each flight (`between`): states, with the time since the step's beginning (ns
        + 1, N), and unknowns (nx, N), NaN where it did not get; each begins in its steady state. All flights have the
        same columns."""
        follows = np.array([s.follows for s in self.states], dtype=bool)
        return [between(track, f.records, follows) for track, f in zip(self.tracks(flights), flights, strict=True)]

    def tracks(self, flights: Sequence[Flight]) -> list[Track]:
        """The same as it was found, step by step."""
        engine = self.engine
        course = course_of([(f.time, f.columns) for f in flights])
        inputs = (*engine.inputs, *engine.optional_inputs)
        first = {c: v[course.first] for c, v in course.columns.items()}
        begin = engine.predict(
            {c: v for c, v in first.items() if c in inputs},
            {c: v for c, v in first.items() if c not in inputs},
            sensors=(),
        )
        defaults = {**engine.nominal, **engine.optional_inputs}
        theta = {n: v for n, v in defaults.items() if n not in first}
        x = np.where(begin.ok, begin.x, np.nan)
        return integrate(self.network, course, theta, x, self._steady(first, theta, x), self.tolerance)

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any],
        flown: tuple[Array, Array],
        *,
        sensors: Sequence[str],
        also: Sequence[str] = (),
    ) -> Prediction:
        """What the engine shows at records, from what is known of them (`flown`: (ns + 1, n), (nx, n))."""
        states, unknowns = flown
        names = [u.name for u in self.network.unknowns()]
        start = unknowns[[names.index(u.name) for u in self._given.unknowns]]
        given = dict(zip((*(s.given for s in self.states), ELAPSED), states, strict=True))
        return self._given.predict({**inputs, **given}, parameters, sensors=sensors, start=start, also=also)

    def _steady(self, points: Mapping[str, Any], theta: Mapping[str, Any], x: Array) -> Array:
        """States (ns, R) of steady solutions with unknowns x (nx, R)."""
        e = solver.evaluate(self.engine.network, points, theta, x, frozenset())
        return np.stack([np.broadcast_to(value(s.value(e)), (x.shape[1],)) for s in self.states])


def _as_given(engine: Engine, network: GivenNetwork) -> Engine:
    found = Engine(network, engine.declared, engine.path)
    return found.at({n: v for n, v in engine.moved.items() if n in found.parameters})
