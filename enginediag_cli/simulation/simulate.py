"""The recording of an engine that flies given conditions, with faults and sensor noise.

For an engine with states (rotors, slow actuators) the run is integrated, and its states are known at every record.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.engine.engine import Engine, Prediction
from enginediag_cli.engine.transient.moving_engine import FlightSolution, MovingEngine
from enginediag_cli.engine.transient.states import TransientInputs, remembered, transient_states
from enginediag_cli.engine.wrapped import EngineLike, NominalEngine, PredictionLike
from enginediag_cli.errors import DataError
from enginediag_cli.faults.catalogue import (
    BEFORE_NOISE,
    Clocks,
    FaultSet,
    SensorFaultState,
    check_faults,
    clocks_from_columns,
    parameter_values,
    sensor_truth,
)
from enginediag_cli.parameters import spelled
from enginediag_cli.recordings.table import Recording
from enginediag_cli.simulation.flights import LABELS, ColumnNoise, FlightConditions, engine_inputs, noise_sources

Columns = Mapping[str, NDArray[np.float64]]


def moving_part(engine: object) -> object:
    """What flies along time: of an engine as identified the engine alone."""
    return engine.engine if isinstance(engine, NominalEngine) else engine


def is_dynamic(engine: object, conditions: FlightConditions, varied: Sequence[str] = ()) -> bool:
    """Whether an engine has states, or memory, and the records follow each other in time."""
    engine = moving_part(engine)
    if not (isinstance(engine, Engine) and conditions.series and "time_s" in conditions.columns):
        return False
    return bool(remembered(engine, varied)) or bool(transient_states(engine))


def describe_states(flying: object) -> str:
    """Names of an engine's states, and of the memory of readings."""
    engine = moving_part(flying)
    assert isinstance(engine, Engine)
    states = transient_states(engine)
    further = [m for m in remembered(engine) if not any(s.represents(m) for s in states)]
    return ", ".join(dict.fromkeys([*(s.words for s in states), *(spelled(m.name) for m in further)]))


@dataclass(frozen=True)
class DynamicFlight:
    """An engine with states at the records of its flights."""

    engine: MovingEngine
    known: FlightSolution

    def loose(self, piece: slice) -> int:
        """Of the records `piece`, how many are of runs that are only as exact as error-controlled steps are."""
        return int(np.asarray(self.known.loose)[piece].sum())

    def predict(self, inputs: Columns, parameters: Columns, piece: slice) -> Prediction:
        """Of the records `piece`."""
        sensors = tuple(self.engine.engine.sensors)
        return self.engine.predict(inputs, parameters, self.known.select(piece), sensors=sensors)


def fly_dynamically(engine: Engine, conditions: FlightConditions, inputs: Columns, values: Columns) -> DynamicFlight:
    """Fly the conditions. `inputs` and parameters `values` (N,) are those of the records. Raises DataError for a
    time that does not rise within a flight, and for an engine whose power setting leaves its states no room."""
    try:
        moving = MovingEngine(engine, varied=tuple(values))
    except ValueError as error:
        raise DataError(str(error)) from error
    way = conditions if conditions.path is None else conditions.path
    at_way = inputs if conditions.path is None else engine_inputs(engine, way)
    records, corners = _runs(conditions), _runs(way)
    flights = []
    for name, index in records.items():
        time = _time(conditions)[index]
        on_way = corners[name]
        on_way = on_way[_time(way)[on_way] <= time[-1]]
        t = _time(way)[on_way]
        given = {c: v[on_way] for c, v in at_way.items()} | {n: np.interp(t, time, v[index]) for n, v in values.items()}
        flights.append(TransientInputs(t, given, time))
    found = moving.fly(flights)
    states = np.full((len(moving.states) + 2, len(conditions)), np.nan)
    unknowns = np.full((len(moving.network.unknowns()), len(conditions)), np.nan)
    lost, loose = np.full(len(conditions), "", dtype=object), np.zeros(len(conditions), dtype=bool)
    for index, of in zip(records.values(), found, strict=True):
        states[:, index], unknowns[:, index], lost[index], loose[index] = of
    return DynamicFlight(moving, FlightSolution(states, unknowns, lost, loose))


def _time(conditions: FlightConditions) -> NDArray[np.float64]:
    return np.asarray(conditions.columns["time_s"], dtype=float)


def _runs(conditions: FlightConditions) -> dict[object, NDArray[np.intp]]:
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
                "be flown along it; correct the column, or take every record as steady with --steady"
            )
        found[name] = index
    return found


CHUNK = 2000
"""Records solved together; small enough that the first rows come out at once, large enough for the solver."""

STATUS_WORDS = np.array(["ok", "outside-map", "not-converged", "invalid-input"])
"""What the `status` column says for the engine's status 0 to 3."""


@dataclass(frozen=True)
class Simulated:
    """Records of a recording, and what is true of them and must not be in it.

    columns: what is recorded, (N,) each, in the order of writing; truth: changed parameters and sensor
    faults, (N,) each; reasons: why points have no value or lie outside the maps → how many; loose: of how many
    records the states could be integrated with ordinary accuracy only.
    """

    columns: Mapping[str, NDArray]
    truth: Mapping[str, NDArray]
    reasons: Mapping[str, int] = field(default_factory=dict)
    loose: int = 0

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))


def simulate(
    engine: EngineLike,
    conditions: FlightConditions,
    faults: FaultSet,
    noise: Mapping[str, ColumnNoise],
    rng: np.random.Generator,
    *,
    chunk: int = CHUNK,
) -> Simulated:
    """All records at once; see `simulate_in_chunks`."""
    parts = list(simulate_in_chunks(engine, conditions, faults, noise, rng, chunk=chunk))
    reasons: Counter[str] = Counter()
    for part in parts:
        reasons.update(part.reasons)
    return Simulated(
        {name: np.concatenate([part.columns[name] for part in parts]) for name in parts[0].columns},
        {name: np.concatenate([part.truth[name] for part in parts]) for name in parts[0].truth},
        dict(reasons),
        sum(part.loose for part in parts),
    )


def simulate_in_chunks(
    engine: EngineLike,
    conditions: FlightConditions,
    faults: FaultSet,
    noise: Mapping[str, ColumnNoise],
    rng: np.random.Generator,
    *,
    chunk: int = CHUNK,
    steady: bool = False,
) -> Iterator[Simulated]:
    """The recording in pieces of at most `chunk` records, one at least; the noise does not depend on `chunk`.

    A reading is made in this order: engine output, sensor bias, scale and scatter, noise and rounding, stuck or
    dropped. A point that the engine cannot solve keeps its row, with NaN readings and the reason in `status`.
    An engine with states flies along the time of its records, unless every record is to be `steady`; a point
    that its flight does not reach has no readings either.

    Parameters
    ----------
    engine
        The engine, healthy.
    conditions
        Operating conditions of N records.
    faults
        Faults that act on the engine and on its instruments.
    noise
        Column → noise of its readings.
    rng
        Random numbers of the noise and of scattering faults.
    chunk
        Most records of a piece.
    steady
        Whether every record is in equilibrium, also of an engine with states.

    Yields
    ------
    Simulated
        Readings and truth of the next records.

    Raises
    ------
    ConfigError
        For a fault on something that the engine does not have.
    DataError
        For a missing input column or a parameter beyond its bounds; both before the first piece.
    """
    check_faults(faults, engine)
    inputs = engine_inputs(engine, conditions)
    instruments = SimulatedInstruments(noise, faults, rng, {*engine.sensors, *conditions.columns})
    clocks = clocks_from_columns(conditions.columns, len(conditions))
    values = parameter_values(faults.components, engine.parameters, clocks)
    hidden = {
        **{name: conditions.columns[name] for name in LABELS if name in conditions.columns},
        **values,
        **sensor_truth(faults.sensors, clocks),
    }
    flown = None
    if not steady and is_dynamic(engine, conditions, tuple(values)):
        moving = moving_part(engine)
        assert isinstance(moving, Engine)
        flown = fly_dynamically(moving, conditions, inputs, values)
    return _pieces(engine, _SimulationRun(conditions, inputs, values, hidden, clocks, flown), instruments, chunk)


@dataclass(frozen=True)
class _SimulationRun:
    """What is set for every record: conditions, the engine's inputs and parameters, what is true of them, the time, and
    the states of an engine that moves."""

    conditions: FlightConditions
    inputs: Mapping[str, NDArray[np.float64]]
    values: Mapping[str, NDArray[np.float64]]
    hidden: Mapping[str, NDArray]
    clocks: Clocks
    flown: DynamicFlight | None = None

    def predict(self, engine: EngineLike, piece: slice) -> PredictionLike:
        """What the engine shows at records `piece`."""
        inputs = {name: column[piece] for name, column in self.inputs.items()}
        values = {name: value[piece] for name, value in self.values.items()}
        if self.flown is not None:
            found = self.flown.predict(inputs, values, piece)
            if isinstance(engine, NominalEngine):
                found = replace(found, y=found.y + engine.model_error(inputs, values, found.columns))
            return found
        return engine.predict(inputs, values, sensors=tuple(engine.sensors))


class SimulatedInstruments:
    """What stands between the engine and the recording: sensor faults and noise, with their memories."""

    def __init__(
        self, noise: Mapping[str, ColumnNoise], faults: FaultSet, rng: np.random.Generator, recorded: set[str]
    ) -> None:
        wanted = (*noise, *(fault.column for fault in faults.sensors))
        missing = sorted({column for column in wanted if column not in recorded})
        if missing:
            raise DataError(f"noise or a fault on {', '.join(missing)}, which the recording does not have")
        self._sources = noise_sources(noise, rng)
        scatters = any(fault.effect["type"] == "noise" for fault in faults.sensors)
        entropy = rng.integers(0, 2**32, size=4).tolist() if scatters else ()
        states = [SensorFaultState(fault, entropy) for fault in faults.sensors]
        self._before = [state for state in states if state.fault.effect["type"] in BEFORE_NOISE]
        self._after = [state for state in states if state.fault.effect["type"] not in BEFORE_NOISE]

    def read(self, true: Mapping[str, NDArray], clocks: Clocks) -> dict[str, NDArray]:
        """The recorded columns (n,) of the next records from the true ones."""
        recorded = dict(true)
        for state in self._before:
            recorded[state.fault.column] = state.apply(_floats(recorded[state.fault.column]), clocks)
        for column, source in self._sources.items():
            recorded[column] = source.apply(_floats(recorded[column]))
        for state in self._after:
            recorded[state.fault.column] = state.apply(_floats(recorded[state.fault.column]), clocks)
        return recorded


def _reason(text: str) -> str:
    """A reason without its numbers in brackets, so that like points are counted together."""
    return text.partition(" (")[0]


def _floats(column: NDArray) -> NDArray[np.float64]:
    return np.asarray(column, dtype=float)


def _pieces(
    engine: EngineLike, run: _SimulationRun, instruments: SimulatedInstruments, chunk: int
) -> Iterator[Simulated]:
    for start in range(0, max(len(run.conditions), 1), chunk):
        piece = slice(start, start + chunk)
        given = run.conditions.slice(start, start + chunk).columns
        prediction = run.predict(engine, piece)
        outputs = dict(zip(prediction.columns, np.asarray(prediction.y).T, strict=True))
        recorded = instruments.read({**given, **outputs}, run.clocks.slice(start, start + chunk))
        status = np.asarray(prediction.status)
        recorded["status"] = STATUS_WORDS[status]
        if getattr(engine, "controlled", False):
            recorded["active_limit"] = prediction.active_limit  # type: ignore[attr-defined]
        reasons = Counter(_reason(prediction.reason(int(k))) for k in np.flatnonzero(status))
        hidden = {name: value[piece] for name, value in run.hidden.items()}
        loose = run.flown.loose(piece) if run.flown is not None else 0
        yield Simulated(recorded, hidden, dict(reasons), loose)


def to_conditions(recording: Recording) -> FlightConditions:
    """Operating conditions with the columns of a recording in their order; text stays text."""
    numbers, text = recording.columns, recording.text
    return FlightConditions(
        {name: numbers[name] if name in numbers else np.asarray(text[name], dtype=str) for name in recording.order}
    )


def to_recording(columns: Mapping[str, NDArray]) -> Recording:
    """A recording of columns (N,): numbers as float64, everything else as text."""
    numbers = {
        name: np.asarray(values, dtype=float)
        for name, values in columns.items()
        if np.issubdtype(values.dtype, np.number)
    }
    text = {name: [str(cell) for cell in values.tolist()] for name, values in columns.items() if name not in numbers}
    return Recording(numbers, text, tuple(columns))
