"""A recording of an engine that flies given conditions, with given faults and sensor noise."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.model import EngineLike, PredictionLike
from enginediag_cli.errors import DataError
from enginediag_cli.faults.component_faults import FaultSet, check_faults, parameter_values
from enginediag_cli.faults.laws import Clocks, clocks_of
from enginediag_cli.faults.sensor_faults import BEFORE_NOISE, SensorFaultState, sensor_truth
from enginediag_cli.simulation.conditions import LABELS, Conditions, engine_inputs
from enginediag_cli.simulation.moving import Flying, flying, moves
from enginediag_cli.simulation.noise import ColumnNoise, noise_sources

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
    conditions: Conditions,
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
    conditions: Conditions,
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
    Raises ConfigError for a fault on something that the engine does not have, DataError for a missing input
    column or a parameter beyond its bounds, before the first piece.
    """
    check_faults(faults, engine)
    inputs = engine_inputs(engine, conditions)
    instruments = Instruments(noise, faults, rng, {*engine.sensors, *conditions.columns})
    clocks = clocks_of(conditions.columns, len(conditions))
    values = parameter_values(faults.components, engine.parameters, clocks)
    hidden = {
        **{name: conditions.columns[name] for name in LABELS if name in conditions.columns},
        **values,
        **sensor_truth(faults.sensors, clocks),
    }
    flown = None
    if not steady and moves(engine, conditions, tuple(values)):
        assert isinstance(engine, Engine)
        flown = flying(engine, conditions, inputs, values)
    return _pieces(engine, _Course(conditions, inputs, values, hidden, clocks, flown), instruments, chunk)


@dataclass(frozen=True)
class _Course:
    """What is set for every record: conditions, the engine's inputs and parameters, what is true of them, the time, and
    the states of an engine that moves."""

    conditions: Conditions
    inputs: Mapping[str, NDArray[np.float64]]
    values: Mapping[str, NDArray[np.float64]]
    hidden: Mapping[str, NDArray]
    clocks: Clocks
    flown: Flying | None = None

    def predict(self, engine: EngineLike, piece: slice) -> PredictionLike:
        """What the engine shows at records `piece`."""
        inputs = {name: column[piece] for name, column in self.inputs.items()}
        values = {name: value[piece] for name, value in self.values.items()}
        if self.flown is not None:
            return self.flown.predict(inputs, values, piece)
        return engine.predict(inputs, values, sensors=tuple(engine.sensors))


class Instruments:
    """What stands between the engine and the recording: sensor faults and noise, with their memories."""

    def __init__(
        self,
        noise: Mapping[str, ColumnNoise],
        faults: FaultSet,
        rng: np.random.Generator,
        recorded: set[str],
    ) -> None:
        wanted = (*noise, *(fault.column for fault in faults.sensors))
        absent = sorted({column for column in wanted if column not in recorded})
        if absent:
            raise DataError(f"noise or a fault is wanted on {', '.join(absent)}, which the recording does not have")
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


def _pieces(engine: EngineLike, course: _Course, instruments: Instruments, chunk: int) -> Iterator[Simulated]:
    for start in range(0, max(len(course.conditions), 1), chunk):
        piece = slice(start, start + chunk)
        given = course.conditions.slice(start, start + chunk).columns
        prediction = course.predict(engine, piece)
        outputs = dict(zip(prediction.columns, np.asarray(prediction.y).T, strict=True))
        recorded = instruments.read({**given, **outputs}, course.clocks.slice(start, start + chunk))
        status = np.asarray(prediction.status)
        recorded["status"] = STATUS_WORDS[status]
        if isinstance(engine, Engine) and engine.controlled:
            recorded["active_limit"] = prediction.active_limit  # type: ignore[attr-defined]
        reasons = Counter(_reason(prediction.reason(int(k))) for k in np.flatnonzero(status))
        hidden = {name: value[piece] for name, value in course.hidden.items()}
        loose = course.flown.loose(piece) if course.flown is not None else 0
        yield Simulated(recorded, hidden, dict(reasons), loose)
