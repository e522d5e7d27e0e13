"""Flights of an engine that moves: its states at every record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.engine.engine import Engine, Prediction
from enginediag_cli.engine.transient.moving_engine import Flown, MovingEngine
from enginediag_cli.engine.transient.states import remembered, states_of
from enginediag_cli.engine.transient.told import Flight
from enginediag_cli.errors import DataError
from enginediag_cli.parameters import spelled
from enginediag_cli.simulation.conditions import Conditions, engine_inputs

Columns = Mapping[str, NDArray[np.float64]]


def moves(engine: object, conditions: Conditions, varied: Sequence[str] = ()) -> bool:
    """Whether an engine has states, or remembers anything, and the records follow each other in time."""
    if not (isinstance(engine, Engine) and conditions.series and "time_s" in conditions.columns):
        return False
    return bool(remembered(engine, varied)) or bool(states_of(engine))


def told_states(engine: Engine) -> str:
    """Names of an engine's states, and of what readings remember."""
    states = states_of(engine)
    further = [m for m in remembered(engine) if not any(s.stands_for(m) for s in states)]
    return ", ".join(dict.fromkeys([*(s.words for s in states), *(spelled(m.name) for m in further)]))


@dataclass(frozen=True)
class Flying:
    """What is known of an engine at the records of a recording."""

    engine: MovingEngine
    known: Flown

    def loose(self, piece: slice) -> int:
        """Of the records `piece`, how many are of runs that are only as exact as error-controlled steps are."""
        return int(np.asarray(self.known.loose)[piece].sum())

    def predict(self, inputs: Columns, parameters: Columns, piece: slice) -> Prediction:
        """Of the records `piece`."""
        sensors = tuple(self.engine.engine.sensors)
        return self.engine.predict(inputs, parameters, self.known.at(piece), sensors=sensors)


def flying(engine: Engine, conditions: Conditions, inputs: Columns, values: Columns) -> Flying:
    """Flies the conditions; `inputs` and parameters `values` (N,) are those of the records. Raises DataError for a
    time that does not rise within a flight, and for an engine whose power setting leaves its states no room."""
    try:
        moving = MovingEngine(engine, varied=tuple(values))
    except ValueError as error:
        raise DataError(str(error)) from error
    way = conditions if conditions.way is None else conditions.way
    at_way = inputs if conditions.way is None else engine_inputs(engine, way)
    records, corners = _runs(conditions), _runs(way)
    flights = []
    for name, index in records.items():
        time = _time(conditions)[index]
        on_way = corners[name]
        on_way = on_way[_time(way)[on_way] <= time[-1]]
        t = _time(way)[on_way]
        given = {c: v[on_way] for c, v in at_way.items()} | {n: np.interp(t, time, v[index]) for n, v in values.items()}
        flights.append(Flight(t, given, time))
    found = moving.fly(flights)
    states = np.full((len(moving.states) + 2, len(conditions)), np.nan)
    unknowns = np.full((len(moving.network.unknowns()), len(conditions)), np.nan)
    lost, loose = np.full(len(conditions), "", dtype=object), np.zeros(len(conditions), dtype=bool)
    for index, of in zip(records.values(), found, strict=True):
        states[:, index], unknowns[:, index], lost[index], loose[index] = of
    return Flying(moving, Flown(states, unknowns, lost, loose))


def _time(conditions: Conditions) -> NDArray[np.float64]:
    return np.asarray(conditions.columns["time_s"], dtype=float)


def _runs(conditions: Conditions) -> dict[object, NDArray[np.intp]]:
    """Records of each flight, in the order of the recording."""
    flight = conditions.columns.get("flight", np.zeros(len(conditions)))
    found = {}
    for name in dict.fromkeys(np.asarray(flight).tolist()):
        index = np.flatnonzero(np.asarray(flight) == name)
        steps = np.diff(_time(conditions)[index])
        if not (steps > 0.0).all():
            k = int(np.flatnonzero(~(steps > 0.0))[0])
            raise DataError(
                f"flight {name}: time_s does not rise behind its record {k + 1}, so that an engine with states cannot "
                "be flown along it; mend the column, or take every record as steady with --steady"
            )
        found[name] = index
    return found
