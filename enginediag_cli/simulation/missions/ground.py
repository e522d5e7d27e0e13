"""A turbine that stays where it is: power plant, pipeline or ship, through days and seasons."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import P_ISA, standard_atmosphere

SERIES = True

SECTION = Section(
    "ground",
    "a ground or ship turbine: ambient temperature by day and season, load by hour",
    (
        Field("elevation_m", "number", "elevation of the site", 0.0, unit="m", minimum=-400.0, maximum=4500.0),
        Field(
            "pressure_swing_m",
            "number",
            "standard deviation of the pressure altitude with the weather",
            60.0,
            unit="m",
            minimum=0.0,
        ),
        Field(
            "ambient_mean_K",
            "number",
            "mean ambient temperature over the year",
            288.15,
            unit="K",
            minimum=220.0,
            maximum=330.0,
        ),
        Field(
            "season_amplitude_K",
            "number",
            "half the difference between summer and winter means",
            9.0,
            unit="K",
            minimum=0.0,
        ),
        Field(
            "day_amplitude_K", "number", "half the difference between afternoon and night", 4.0, unit="K", minimum=0.0
        ),
        Field(
            "weather_K",
            "number",
            "standard deviation of the weather's temperature over days",
            3.0,
            unit="K",
            minimum=0.0,
        ),
        Field(
            "relative_humidity",
            "range",
            "relative humidity, [afternoon, night]; used by engines that take humidity",
            (0.5, 0.9),
            minimum=0.0,
            maximum=1.0,
        ),
        Field("first_day_of_year", "integer", "day of the year of the first record", 1, minimum=1, maximum=366),
        Field(
            "load_by_hour",
            "numbers",
            "power, fraction of the rating, at evenly spaced hours of the day from midnight; linear between them",
            (1.0,),
            minimum=0.0,
            maximum=1.0,
        ),
        Field(
            "load_scatter", "number", "standard deviation of the load from hour to hour", 0.02, minimum=0.0, maximum=0.3
        ),
        Field(
            "base_load_above", "number", "load from which a record is called base load", 0.95, minimum=0.0, maximum=1.0
        ),
        Field("record_interval_s", "number", "time between records", 3600.0, unit="s", minimum=1.0),
    ),
)

DAY_S = 86400.0
"""In seconds."""
YEAR_DAYS = 365.25
"""Julian year."""
COLDEST_DAY = 20.0
"""Of the year: 20 January, a month after the solstice, as on land of northern middle latitudes."""
WARMEST_HOUR = 15.0
"""Of the day: three hours after noon."""
WEATHER_TIME_S = 2.0 * DAY_S
"""Correlation time of the weather: two days, the passage of fronts."""


def generate(
    settings: Mapping[str, Any],
    count: int,
    engine: object,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Columns of `count` days; `flight` numbers the days."""
    interval = settings["record_interval_s"]
    time = interval * np.arange(int(np.ceil(count * DAY_S / interval)))
    day = settings["first_day_of_year"] + time / DAY_S
    hour = 24.0 * (time / DAY_S % 1.0)
    weather, pressure, load = (
        wander(len(time), np.exp(-interval / tau), rng) for tau in (WEATHER_TIME_S, WEATHER_TIME_S, 3600.0)
    )
    afternoon = np.cos(2.0 * np.pi * (hour - WARMEST_HOUR) / 24.0)
    ambient = (
        settings["ambient_mean_K"]
        - settings["season_amplitude_K"] * np.cos(2.0 * np.pi * (day - COLDEST_DAY) / YEAR_DAYS)
        + settings["day_amplitude_K"] * afternoon
        + settings["weather_K"] * weather
    )
    altitude = settings["elevation_m"] + settings["pressure_swing_m"] * pressure
    profile = np.asarray(settings["load_by_hour"], dtype=float)
    hours = np.linspace(0.0, 24.0, len(profile) + 1)
    wanted = np.interp(hour, hours, np.append(profile, profile[0]))
    power = np.clip(wanted + settings["load_scatter"] * load, 0.0, 1.0)
    dry, damp = settings["relative_humidity"]
    relative_humidity = 0.5 * (dry + damp) + 0.5 * (dry - damp) * afternoon
    return {
        "time_s": time,
        "phase": np.where(power >= settings["base_load_above"], "base-load", "part-load"),
        "altitude_m": altitude,
        "mach": np.zeros(len(time)),
        "dT_isa_K": ambient - np.asarray(standard_atmosphere(altitude)[0]),
        "power_fraction": power,
        "humidity_kg_kg": humidity(relative_humidity, ambient),
        "flight": 1 + (time / DAY_S).astype(int),
    }


def wander(n: int, rho: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Stationary first-order autoregression of unit variance, (n,): x_k = ρ x_{k−1} + √(1 − ρ²) ε_k."""
    from scipy.signal import lfilter

    shocks = rng.standard_normal(n)
    shocks[1:] *= np.sqrt(1.0 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks))


def humidity(
    relative: NDArray[np.float64],
    temperature_K: NDArray[np.float64],
    pressure_Pa: float = P_ISA,
) -> NDArray[np.float64]:
    """Water per dry air, kg/kg, (N,), from relative humidity.

    Saturation pressure over water: e = 611.21 Pa exp[(18.678 − t/234.5) t/(257.14 + t)], t in °C (Buck 1996);
    w = 0.62198 e/(p − e).
    """
    celsius = temperature_K - 273.15
    saturation = 611.21 * np.exp((18.678 - celsius / 234.5) * celsius / (257.14 + celsius))
    vapour = relative * saturation
    return 0.62198 * vapour / (pressure_Pa - vapour)
