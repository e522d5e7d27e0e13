"""Generated flights: operating conditions without a recording to take them from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.engine.atmosphere import standard_atmosphere
from enginediag_cli.engine.model import EngineLike
from enginediag_cli.errors import DataError
from enginediag_cli.simulation.conditions import LABELS, Conditions
from enginediag_cli.simulation.flight_file import MISSIONS
from enginediag_cli.simulation.missions import UNRECORDED

MAX_FLIGHTS_FOR_RECORDS = 100_000
"""Flights that are made for a wanted number of records at most: a stop for what should not happen."""


def generate_flights(
    plan: Mapping[str, Any],
    engine: EngineLike,
    rng: np.random.Generator,
    *,
    flights: int | None = None,
    records: int | None = None,
) -> Conditions:
    """Operating conditions of flights described by the values of a flight file.

    `flights` replaces the file's number of flights. `records` ends the conditions after so many records;
    without `flights`, as many flights are flown as that takes. Flight k is the same however many flights
    follow it, in the missions that draw flight by flight (airliner). Raises DataError when the engine has an
    input that the flights do not give.
    """
    mission = plan["mission"]
    generate = MISSIONS[mission["type"]].generate
    count = flights if flights is not None else plan["flights"]
    if records is not None and flights is None:
        first = generate(mission, 1, engine, _copy(rng))
        count = min(1 + records // max(len(first["time_s"]) // 2, 1), MAX_FLIGHTS_FOR_RECORDS)
    columns = generate(mission, count, engine, rng)
    conditions = _recorded(with_power(columns, engine, plan["constants"]), columns, MISSIONS[mission["type"]].SERIES)
    return conditions if records is None else conditions.slice(0, records)


def with_power(
    columns: Mapping[str, NDArray],
    engine: EngineLike,
    constants: Mapping[str, float],
) -> Conditions:
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
    wanted = (*engine.inputs, *(name for name in engine.optional_inputs if name in given))
    return Conditions({name: given[name] for name in (*LABELS, *wanted)})


def _recorded(way: Conditions, columns: Mapping[str, NDArray], series: bool) -> Conditions:
    """The records among all points that a mission gives."""
    if UNRECORDED not in columns:
        return Conditions(way.columns, series)
    kept = columns[UNRECORDED] == 0
    return Conditions({name: values[kept] for name, values in way.columns.items()}, series, way)


def _copy(rng: np.random.Generator) -> np.random.Generator:
    """A generator in the same state, so that a trial draw leaves the original as it was."""
    bits = type(rng.bit_generator)()
    bits.state = rng.bit_generator.state
    return np.random.Generator(bits)
