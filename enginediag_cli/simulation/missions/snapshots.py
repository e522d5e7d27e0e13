"""Two records a flight, as fleets report them by data link: one at take-off and one in cruise."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.simulation.airspeed import FOOT_M
from enginediag_cli.simulation.missions import atmosphere

SERIES = False

SECTION = Section(
    "snapshots",
    "one take-off and one cruise record per flight",
    (
        Field(
            "airfield_elevation_m",
            "range",
            "altitude of the take-off record, [low, high]",
            (0.0, 900.0),
            unit="m",
            minimum=-100.0,
        ),
        Field("take_off_mach", "range", "Mach number of the take-off record", (0.18, 0.28), minimum=0, maximum=0.6),
        Field("take_off", "range", "take-off power, fraction of the rating", (0.88, 1.0), minimum=0.0, maximum=1.0),
        Field(
            "cruise_levels_ft",
            "numbers",
            "flight levels of the cruise record, one drawn per flight",
            (31000.0, 33000.0, 35000.0, 37000.0),
            unit="ft",
            minimum=5000.0,
        ),
        Field("cruise_mach", "range", "Mach number of the cruise record", (0.77, 0.83), minimum=0.1, maximum=0.95),
        Field("cruise", "range", "cruise power, fraction of the rating", (0.62, 0.8), minimum=0.0, maximum=1.0),
        Field("flight_interval_h", "number", "time from one take-off to the next", 6.0, unit="h", minimum=0.1),
        Field(
            "cruise_delay_min",
            "number",
            "time from the take-off record to the cruise record",
            45.0,
            unit="min",
            minimum=0.1,
        ),
        *atmosphere.FIELDS,
    ),
)


def generate(
    settings: Mapping[str, Any],
    count: int,
    engine: object,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Columns of `count` flights, 2·count records, take-off and cruise in turn."""

    def pair(take_off: NDArray, cruise: NDArray) -> NDArray:
        return np.stack([take_off, cruise], axis=1).reshape(-1)

    def uniform(key: str) -> NDArray[np.float64]:
        low, high = settings[key]
        return rng.uniform(low, high, size=count)

    flight = np.arange(1, count + 1)
    start = 3600.0 * settings["flight_interval_h"] * (flight - 1)
    levels = FOOT_M * rng.choice(np.asarray(settings["cruise_levels_ft"], dtype=float), size=count)
    return {
        "time_s": pair(start, start + 60.0 * settings["cruise_delay_min"]),
        "phase": pair(np.full(count, "take-off"), np.full(count, "cruise")),
        "altitude_m": pair(uniform("airfield_elevation_m"), levels),
        "mach": pair(uniform("take_off_mach"), uniform("cruise_mach")),
        "dT_isa_K": pair(
            atmosphere.day(settings, "ground", rng, count), atmosphere.day(settings, "cruise", rng, count)
        ),
        "power_fraction": pair(uniform("take_off"), uniform("cruise")),
        "flight": pair(flight, flight),
    }
