"""Operating points drawn at random over the engine's envelope: the most that any flying can excite."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.simulation.airspeed import KNOT_M_S, mach_from_cas

SERIES = False

SECTION = Section(
    "sweep",
    "uniform random operating points over the engine's envelope",
    (
        Field("altitude_m", "range", "altitude; the engine's envelope where absent", None, unit="m"),
        Field("mach", "range", "Mach number; the engine's envelope where absent", None, minimum=0.0),
        Field("dT_isa_K", "range", "deviation from ISA; the engine's envelope where absent", None, unit="K"),
        Field("power", "range", "power, fraction of the rating", (0.3, 1.0), minimum=0.0, maximum=1.0),
        Field(
            "cas_kt",
            "range",
            "calibrated airspeeds that the aircraft can fly; the lower one counts from 1500 m upwards",
            (0.0, 400.0),
            unit="kt",
            minimum=0.0,
        ),
        Field("records_per_flight", "integer", "how many points share a flight number", 100, minimum=1),
        Field("record_interval_s", "number", "time between records", 60.0, unit="s", minimum=0.1),
    ),
)

FREE_BELOW_M = 1500.0
"""Below this altitude any speed down to standstill may be flown: take-off and landing."""


def generate(
    settings: Mapping[str, Any],
    count: int,
    engine: EngineLike,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Columns of `count` flights of `records_per_flight` independent points each.

    Mach is uniform over the part of its range in which the calibrated airspeed is one that can be flown, so
    that a point at 12 km and Mach 0.1 does not occur when `cas_kt` says so.
    """
    n = count * settings["records_per_flight"]
    uniform = {}
    for column in ("altitude_m", "mach", "dT_isa_K", "power"):
        # one draw per column whatever its range, so that fixing one range leaves the others' points
        uniform[column] = rng.random(n)
    altitude = _spread(uniform["altitude_m"], *_range(settings, engine, "altitude_m"))
    low, high = _range(settings, engine, "mach")
    cas_low, cas_high = (KNOT_M_S * cas for cas in settings["cas_kt"])
    floor = np.where(altitude > FREE_BELOW_M, mach_from_cas(cas_low, altitude), 0.0)
    ceiling = np.clip(mach_from_cas(cas_high, altitude), low, high)
    record = np.arange(n)
    others = [
        c
        for c in (*engine.inputs, *engine.optional_inputs)
        if c in engine.envelope and c not in (*uniform, engine.power_setting)
    ]
    return {
        **{column: _spread(rng.random(n), *engine.envelope[column]) for column in others},
        "time_s": settings["record_interval_s"] * record,
        "phase": np.full(n, "sweep"),
        "altitude_m": altitude,
        "mach": _spread(uniform["mach"], np.minimum(np.clip(floor, low, high), ceiling), ceiling),
        "dT_isa_K": _spread(uniform["dT_isa_K"], *_range(settings, engine, "dT_isa_K")),
        "power_fraction": _spread(uniform["power"], *settings["power"]),
        "flight": 1 + record // settings["records_per_flight"],
    }


def _spread(
    uniform: NDArray[np.float64],
    low: float | NDArray[np.float64],
    high: float | NDArray[np.float64],
) -> NDArray[np.float64]:
    return low + (high - low) * uniform


def _range(settings: Mapping[str, Any], engine: EngineLike, column: str) -> tuple[float, float]:
    """The file's range, else the engine's, else 0 (an engine that knows no Mach number)."""
    chosen = settings[column] if settings[column] is not None else engine.envelope.get(column, (0.0, 0.0))
    return float(chosen[0]), float(chosen[1])
