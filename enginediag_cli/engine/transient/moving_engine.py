"""An engine with states, as simulation sees it: it is flown along records, and then read like any other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.engine import solver
from enginediag_cli.engine.dual import Array, value
from enginediag_cli.engine.engine import NOT_CONVERGED, Engine, Prediction
from enginediag_cli.engine.moving.tape import MOMENT, NO_MOMENT
from enginediag_cli.engine.transient.collocation import made_exact
from enginediag_cli.engine.transient.integrate import TOLERANCE, Track, between, integrate
from enginediag_cli.engine.transient.networks import Course, Flight, GivenNetwork, MovingNetwork, course_of, told
from enginediag_cli.engine.transient.states import ELAPSED, Rotor, remembered, states_of

BETWEEN = 8
"""Points of each step at which what is remembered of readings is followed, beside the records: a probe then errs by a
hundredth of what the gas bends within a step."""


class Flown(NamedTuple):
    """What is known of an engine at N records: states (ns, N), the time since the beginning of the step and the moment
    on the tape of the run, (ns + 2, N) in all, and unknowns (nx, N), NaN where it did not get; `lost`: why it did
    not; `loose`: states of its run are only as exact as error-controlled steps are."""

    states: Array
    unknowns: Array
    lost: Any = ""
    loose: Any = False

    def at(self, piece: slice) -> Flown:
        """Of the records `piece`."""
        lost, loose = (np.asarray(x)[piece] for x in (self.lost, self.loose))
        return Flown(self.states[:, piece], self.unknowns[:, piece], lost, loose)


class MovingEngine:
    """`engine` with its states; `varied`: parameters that flights change. Raises ValueError for a power setting that
    says what a state is to be, for what cannot be followed along time and for what is stated twice."""

    def __init__(self, engine: Engine, tolerance: float = TOLERANCE, varied: Sequence[str] = ()):
        self.engine, self.tolerance = engine, tolerance
        network = engine.network
        self.states = states_of(engine, varied)
        self._follows = np.array([s.follows for s in self.states], dtype=bool)
        # an inertia that a term gives is the rotor's now
        turning = [s for s in self.states if isinstance(s, Rotor)]
        self._theirs = {
            n: absent
            for m in remembered(engine, varied)
            for s in turning
            if s.stands_for(m)
            for n, absent in m.absent.items()
        }
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
        at_records = Engine(GivenNetwork(network, self.states), engine.declared, engine.path)
        known = {**engine.moved, **self._theirs}
        self._given = at_records.at({n: v for n, v in known.items() if n in at_records.parameters})

    def fly(self, flights: Sequence[Flight]) -> list[Flown]:
        """What is known at the records of each flight; each begins in its steady state. All flights have the same
        columns."""
        found = []
        for track, flight in zip(self.tracks(flights), flights, strict=True):
            states, unknowns = between(track, flight.records, self._follows)
            moment = self._moments(track, flight)
            loose = bool(self.network.states) and len(track.time) > 1 and not track.exact
            found.append(Flown(np.vstack([states, moment]), unknowns, _lost(track), loose))
        return found

    def tracks(self, flights: Sequence[Flight]) -> list[Track]:
        """The same step by step."""
        found, course, theta = self.integrated(flights)
        made_exact(self._given, self.network, course, theta, found)
        return found

    def integrated(self, flights: Sequence[Flight]) -> tuple[list[Track], Course, dict[str, Any]]:
        """Runs as error-controlled steps leave them, what they were asked for, and parameters that hold throughout."""
        engine = self.engine
        inputs = (*engine.inputs, *engine.optional_inputs)
        first = {c: np.array([f.columns[c][0] for f in flights]) for c in flights[0].columns}
        begin = engine.predict(
            {c: v for c, v in first.items() if c in inputs},
            {c: v for c, v in first.items() if c not in inputs},
            sensors=(),
        )
        course = course_of([told(engine, f) for f in flights])
        points = {c: v[course.first] for c, v in course.columns.items()}
        defaults = {**engine.nominal, **engine.optional_inputs, **self._theirs}
        theta = {n: v for n, v in defaults.items() if n not in points}
        x = np.where(begin.ok, begin.x, np.nan)
        found = integrate(self.network, course, theta, x, self._steady(points, theta, x), self.tolerance)
        for r in np.flatnonzero(~begin.ok).tolist():
            found[r].why = begin.reason(r)
        return found, course, theta

    def predict(
        self,
        inputs: Mapping[str, Any],
        parameters: Mapping[str, Any],
        flown: Flown,
        *,
        sensors: Sequence[str],
        also: Sequence[str] = (),
    ) -> Prediction:
        """What the engine shows at records, from what is known of them."""
        states, unknowns, lost = flown.states, flown.unknowns, flown.lost
        names = [u.name for u in self.network.unknowns()]
        start = unknowns[[names.index(u.name) for u in self._given.unknowns]]
        given = dict(zip((*(s.given for s in self.states), ELAPSED, MOMENT), states, strict=True))
        if MOMENT not in self._given.optional_inputs:
            del given[MOMENT]
        found = self._given.predict({**inputs, **given}, parameters, sensors=sensors, start=start, also=also)
        away = np.flatnonzero(np.isnan(states[len(self.states)]))
        if not away.size:
            return found
        why = np.broadcast_to(np.asarray(lost), (states.shape[1],))
        status = found.status.copy()
        status[away] = NOT_CONVERGED
        reasons = {k: found.reason(k) for k in np.flatnonzero(status).tolist()}
        return replace(found, status=status, _reasons=reasons | {k: str(why[k]) for k in away.tolist()})

    def _moments(self, track: Track, flight: Flight) -> Array:
        """Where the records of a flight (N,) stand on the tape of its run, whose past readings remember; NO_MOMENT
        where nothing is remembered, or the run did not get."""
        moment = np.full(len(flight.records), NO_MOMENT)
        if not self._given.network.memories or not track.time:
            return moment
        ends = np.asarray(track.time)
        reached = flight.records <= ends[-1]
        within = np.interp(np.arange(BETWEEN * (len(ends) - 1) + 1) / BETWEEN, np.arange(len(ends)), ends)
        time = np.union1d(within, np.concatenate([flight.time[flight.time <= ends[-1]], flight.records[reached]]))
        states, _ = between(track, time, self._follows)
        columns = {c: np.interp(time, flight.time, v) for c, v in flight.columns.items()}
        columns |= dict(zip((*(s.given for s in self.states), ELAPSED), states, strict=True))
        on_tape = self._given.tapes.add({**columns, "time_s": time})
        moment[reached] = on_tape[np.searchsorted(time, flight.records[reached])]
        return moment

    def _steady(self, points: Mapping[str, Any], theta: Mapping[str, Any], x: Array) -> Array:
        """States (ns, R) of steady solutions with unknowns x (nx, R)."""
        e = solver.evaluate(self.engine.network, points, theta, x, frozenset())
        return np.reshape([np.broadcast_to(value(s.value(e)), (x.shape[1],)) for s in self.states], (-1, x.shape[1]))


def _lost(track: Track) -> str:
    if track.stopped == np.inf:
        return ""
    if track.stopped == -np.inf:
        return f"it cannot stand still where its flight begins: {track.why}"
    return f"there is no way beyond {track.stopped:.2f} s: {track.why}; ask for less, or more slowly"
