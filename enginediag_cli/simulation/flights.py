"""Simulated flights: the flight file, the missions it may name, and the operating conditions, record by record."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import REQUIRED, Field, Section, Variants
from enginediag_cli.config.hints import near
from enginediag_cli.engine.atmosphere import standard_atmosphere
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import DataError
from enginediag_cli.simulation.missions import (
    AIRLINER,
    FOOT_M,
    GROUND,
    MANOEUVRES,
    SNAPSHOTS,
    SWEEP,
    UNRECORDED,
    draw_snapshots,
    draw_sweep,
    fly_airliner,
    fly_manoeuvres,
    run_on_ground,
)
from enginediag_cli.simulation.noise import NOISE

Columns = dict[str, NDArray]


@dataclass(frozen=True)
class Mission:
    """A kind of mission: its keys in a flight file, and what makes the columns of so many flights.

    The columns are `flight`, `time_s`, `phase`, `altitude_m`, `mach`, `dT_isa_K` and `power_fraction`. series: whether
    records follow each other in time; then there may be a column UNRECORDED, 1 at points that bend the course but are
    not recorded.
    """

    section: Section
    generate: Callable[[Mapping[str, Any], int, EngineLike, np.random.Generator], Columns]
    series: bool = True


MISSIONS = {
    "airliner": Mission(AIRLINER, fly_airliner),
    "snapshots": Mission(SNAPSHOTS, draw_snapshots, series=False),
    "sweep": Mission(SWEEP, draw_sweep, series=False),
    "ground": Mission(GROUND, run_on_ground),
    "manoeuvres": Mission(MANOEUVRES, fly_manoeuvres),
}
MISSION = Variants("mission", "kind of mission", {name: m.section for name, m in MISSIONS.items()})

FLIGHT_FILE = Section(
    "flight",
    "flights to simulate, and how noisily they are recorded",
    (
        Field("kind", "choice", "kind of file", "flight", choices=("flight",)),
        Field("description", "text", "what these flights are", ""),
        Field("source", "text", "where the numbers come from", ""),
        Field("flights", "integer", "flights (days on the ground), if the command does not say", 1, minimum=1),
        Field("mission", "section", "what a flight looks like", section=MISSION),
        Field("constants", "number_map", "further inputs of the engine, each at one value", {}),
        Field("noise", "section", "sensor noise, if the command does not say", {}, section=NOISE),
    ),
)


LABELS = ("flight", "time_s", "phase")
"""Columns that place a record in a recording; never inputs of an engine."""


@dataclass(frozen=True)
class FlightConditions:
    """Columns of equal length N in the order in which they are written; `flight` and `phase` may be text.

    `series`: whether records follow each other in time, rather than being points that were drawn one by one. `way`:
    what is flown between them, too, where that has corners: the same columns at more points of time.
    """

    columns: Mapping[str, NDArray]
    series: bool = True
    path: FlightConditions | None = None

    def __post_init__(self) -> None:
        lengths = {name: len(values) for name, values in self.columns.items()}
        if len(set(lengths.values())) > 1:
            raise ValueError(f"columns differ in length: {lengths}")

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def slice(self, start: int, stop: int) -> FlightConditions:
        """Records `start` to `stop` (exclusive, counted from 0)."""
        cut = {name: values[start:stop] for name, values in self.columns.items()}
        return FlightConditions(cut, self.series, self.path)


def engine_inputs(engine: EngineLike, conditions: FlightConditions) -> dict[str, NDArray[np.float64]]:
    """The engine's input columns, (N,) each: all required ones, and the optional ones that are given.

    Raises DataError naming the missing column and a near match among those that are there.
    """
    inputs = {}
    for column in engine.inputs:
        if column not in conditions.columns:
            raise DataError(
                f"engine {engine.name!r} needs the column {column!r}, which the conditions lack "
                f"({near(column, conditions.columns)})"
            )
        inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    for column in engine.optional_inputs:
        if column in conditions.columns:
            inputs[column] = np.asarray(conditions.columns[column], dtype=float)
    return inputs


def outside_envelope(engine: EngineLike, conditions: FlightConditions) -> dict[str, int]:
    """Column → number of records outside the engine's declared envelope; empty where all are inside."""
    counts = {}
    for column, (low, high) in engine.envelope.items():
        if column in conditions.columns:
            values = np.asarray(conditions.columns[column], dtype=float)
            margin = 1e-9 * max(abs(low), abs(high))
            outside = int(np.count_nonzero((values < low - margin) | (values > high + margin)))
            if outside:
                counts[column] = outside
    return counts


MAX_FLIGHTS_FOR_RECORDS = 100_000
"""Flights that are made for a wanted number of records at most: a stop for what should not happen."""


def generate_flights(
    plan: Mapping[str, Any],
    engine: EngineLike,
    rng: np.random.Generator,
    *,
    flights: int | None = None,
    records: int | None = None,
) -> FlightConditions:
    """Operating conditions of flights described by a flight file.

    Flight k is the same however many flights follow it, in the missions that draw flight by flight (airliner).

    Parameters
    ----------
    plan : values of a flight file
    engine : whose inputs are made
    rng : of all random draws
    flights : number of flights; default: the file's
    records : end after so many records; without `flights`, as many flights are flown as that takes

    Raises
    ------
    DataError
        The engine has an input that the flights do not give.
    """
    mission = plan["mission"]
    kind = MISSIONS[mission["type"]]
    count = flights if flights is not None else plan["flights"]
    if records is not None and flights is None:
        first = kind.generate(mission, 1, engine, deepcopy(rng))
        count = min(1 + records // max(len(first["time_s"]) // 2, 1), MAX_FLIGHTS_FOR_RECORDS)
    columns = kind.generate(mission, count, engine, rng)
    conditions = _recorded(complete_inputs(columns, engine, plan["constants"]), columns, kind.series)
    return conditions if records is None else conditions.slice(0, records)


def complete_inputs(
    columns: Mapping[str, NDArray], engine: EngineLike, constants: Mapping[str, float]
) -> FlightConditions:
    """The engine's columns from generated ones: power fraction → power setting, unknown columns dropped."""
    n = len(columns["time_s"])
    temperature, pressure = standard_atmosphere(columns["altitude_m"])
    given = {
        "ambient_temperature_K": np.asarray(temperature) + columns["dT_isa_K"],
        "ambient_pressure_Pa": np.asarray(pressure),
        **columns,
        **{name: np.full(n, value) for name, value in constants.items()},
    }
    unknown = [name for name in constants if name not in (*engine.inputs, *engine.optional_inputs)]
    if unknown:
        raise DataError(
            f"constants of the flight file that engine {engine.name!r} has no input for: "
            f"{', '.join(unknown)}; its inputs are {', '.join(engine.inputs)}"
        )
    known = {name: given[name] for name in (*engine.inputs, *engine.optional_inputs) if name in given}
    power = engine.power_from_fraction(columns["power_fraction"], known)
    given[engine.power_setting] = np.broadcast_to(np.asarray(power, dtype=float), (n,))
    missing = [name for name in engine.inputs if name not in given]
    if missing:
        raise DataError(
            f"the flight file gives no {', '.join(missing)}, which engine {engine.name!r} needs; "
            "hold it under 'constants:' or simulate with --conditions"
        )
    inputs = (*engine.inputs, *(name for name in engine.optional_inputs if name in given))
    return FlightConditions({name: given[name] for name in (*LABELS, *inputs)})


def _recorded(way: FlightConditions, columns: Mapping[str, NDArray], series: bool) -> FlightConditions:
    """The records among all points that a mission gives."""
    if UNRECORDED not in columns:
        return FlightConditions(way.columns, series)
    kept = columns[UNRECORDED] == 0
    return FlightConditions({name: values[kept] for name, values in way.columns.items()}, series, way)


AIRLINER_FLIGHTS = 5
"""Flights of an engine for which none are described: some thousand records."""
GROUND_DAYS = 30
"""Days of an engine on the ground: a month's weather."""
MARGIN_M = 100.0
"""Kept from the ceiling of the engine's envelope, so that no record is outside by rounding."""


def default_plan(engine: EngineLike) -> dict[str, Any]:
    """Values of a flight file: airliner flights within the engine's envelope, or days on the ground for an
    engine that knows no altitude."""
    flies = "altitude_m" in engine.inputs
    kind = "airliner" if flies else "ground"
    mission = {"type": kind, **_defaults(MISSIONS[kind].section)}
    if flies:
        _keep_inside(mission, engine)
    return {
        "flights": AIRLINER_FLIGHTS if flies else GROUND_DAYS,
        "mission": mission,
        "constants": {},
        "noise": _defaults(NOISE),
    }


def _keep_inside(mission: dict[str, Any], engine: EngineLike) -> None:
    """Lower cruise Mach number and levels to what the engine's envelope allows, step climbs included."""
    fastest = engine.envelope.get("mach", (0.0, 1.0))[1]
    low, high = mission["cruise_mach"]
    mission["cruise_mach"] = [low * min(1.0, fastest / high), min(high, fastest)]
    steps = 60.0 * mission["cruise_duration_min"][1] // (60.0 * mission["step_interval_min"])
    ceiling = engine.envelope.get("altitude_m", (0.0, 20000.0))[1] - MARGIN_M
    highest = ceiling / FOOT_M - steps * mission["step_climb_ft"]
    mission["cruise_levels_ft"] = sorted({min(level, highest) for level in mission["cruise_levels_ft"]})


def _defaults(section: Section) -> dict[str, Any]:
    """Values of a section of which the file gives none; tuples become lists as a file would give them."""
    assert all(field.default is not REQUIRED for field in section.fields)
    return {
        field.name: list(field.default) if isinstance(field.default, tuple) else field.default
        for field in section.fields
    }
