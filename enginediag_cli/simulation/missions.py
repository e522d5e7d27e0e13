"""What simulated flights look like, a kind of mission each: snapshots, sweeps, ground operation and manoeuvres.

The first part serves all of them: airspeed (the compressible Bernoulli relation of airspeed indicators in the ICAO
standard atmosphere, e.g. Young, Performance of the Jet Transport Airplane, 2018, ch. 6), and how warm the day is.
`airliner.py` holds the largest mission, `flights.py` the list of all.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import P_ISA, R_AIR, T_ISA, standard_atmosphere
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import DataError

UNRECORDED = "unrecorded"
"""Column of a mission: 1 at points that bend the course but are not recorded."""


GAMMA = 1.4
"""Ratio of heat capacities of air that airspeed indicators are calibrated with."""
SOUND_SPEED_ISA_M_S = float(np.sqrt(GAMMA * R_AIR * T_ISA))
KNOT_M_S = 1852.0 / 3600.0
"""International nautical mile of 1852 m an hour."""
FOOT_M = 0.3048
"""International foot of 1959."""


def mach_from_cas(cas_m_s: ArrayLike, altitude_m: ArrayLike) -> NDArray[np.float64]:
    """Mach number of a calibrated airspeed, m/s, at a pressure altitude, m; arguments broadcast.

    The impact pressure qc that an indicator shows as CAS at sea level is the same at altitude:
    qc = p0 [(1 + (CAS/a0)²/5)^3.5 − 1],   M² = 5 [(qc/p + 1)^(1/3.5) − 1]   (subsonic).
    """
    ratio = np.asarray(cas_m_s, dtype=float) / SOUND_SPEED_ISA_M_S
    impact_pressure = P_ISA * ((1.0 + 0.2 * ratio**2) ** 3.5 - 1.0)
    return np.sqrt(5.0 * ((impact_pressure / _pressure(altitude_m) + 1.0) ** (1.0 / 3.5) - 1.0))


def _pressure(altitude_m: ArrayLike) -> NDArray[np.float64]:
    return np.asarray(standard_atmosphere(np.asarray(altitude_m, dtype=float))[1])


DAY_FIELDS = (
    Field("dT_isa_ground_K", "number", "deviation from ISA at the ground, mean over flights", 5.0, unit="K"),
    Field("dT_isa_ground_sigma_K", "number", "its standard deviation over flights", 8.0, unit="K", minimum=0.0),
    Field("dT_isa_cruise_K", "number", "deviation from ISA at 11 km, mean over flights", 0.0, unit="K"),
    Field("dT_isa_cruise_sigma_K", "number", "its standard deviation over flights", 5.0, unit="K", minimum=0.0),
)

REFERENCE_ALTITUDE_M = 11000.0
"""Tropopause of the standard atmosphere: from the ground to it the day's deviation changes linearly."""
DAY_LIMIT_SIGMA = 2.0
"""No day is further out: it would leave the envelope of the engine."""


def deviation_of_days(
    settings: Mapping[str, Any],
    where: str,
    rng: np.random.Generator,
    count: int,
) -> NDArray[np.float64]:
    """Deviations from ISA, K, of `count` days at `where` (ground or cruise): normal, cut at two sigma."""
    mean, sigma = settings[f"dT_isa_{where}_K"], settings[f"dT_isa_{where}_sigma_K"]
    return mean + sigma * np.clip(rng.standard_normal(count), -DAY_LIMIT_SIGMA, DAY_LIMIT_SIGMA)


def deviation_along_flight(
    time_s: NDArray[np.float64],
    altitude_m: NDArray[np.float64],
    ground_K: float,
    cruise_K: float,
    rng: np.random.Generator,
    amplitude_K: float = 1.5,
) -> NDArray[np.float64]:
    """Deviation from ISA, K, (N,): linear in altitude between ground and 11 km, plus slow air-mass waves.

    The waves are two sinusoids of 40–90 min and 10–25 min period with random phases, fading out at the
    ground.
    """
    share = np.clip(altitude_m / REFERENCE_ALTITUDE_M, 0.0, 1.0)
    periods = np.array([rng.uniform(2400.0, 5400.0), rng.uniform(600.0, 1500.0)])
    phases = rng.uniform(0.0, 2.0 * np.pi, size=2)
    waves = np.sin(2.0 * np.pi * time_s[:, None] / periods + phases) @ np.array([0.7, 0.3])
    return ground_K + (cruise_K - ground_K) * share + amplitude_K * share * waves


SNAPSHOTS = Section(
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
        *DAY_FIELDS,
    ),
)


def draw_snapshots(
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
            deviation_of_days(settings, "ground", rng, count), deviation_of_days(settings, "cruise", rng, count)
        ),
        "power_fraction": pair(uniform("take_off"), uniform("cruise")),
        "flight": pair(flight, flight),
    }


SWEEP = Section(
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


def draw_sweep(
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


GROUND = Section(
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


def run_on_ground(
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


SET_POINT = Section(
    "set_point",
    "a corner of the course, straight lines between",
    (
        Field("time_s", "number", "since the beginning", unit="s", minimum=0.0),
        Field("power", "number", "fraction of the rating, 0 idle", minimum=0.0, maximum=1.2),
        Field("phase", "text", "what begins here; default as before", ""),
        Field("altitude_m", "number", "altitude; default as before, from 0", None, unit="m"),
        Field("mach", "number", "Mach number; default as before, from 0", None, minimum=0.0),
        Field("dT_isa_K", "number", "deviation from ISA; default as before, from 0", None, unit="K"),
    ),
)
MANOEUVRES = Section(
    "manoeuvres",
    "throttle manoeuvres: accelerations, decelerations, Bodie manoeuvres, run-ups",
    (
        Field("set_points", "sections", "in the order of time, the first one at 0 s", section=SET_POINT),
        Field("record_interval_s", "number", "time between records", 1.0, unit="s", minimum=0.001),
        Field("flight_interval_s", "number", "from one flight to the next", 3600.0, unit="s", minimum=0.0),
    ),
)


def fly_manoeuvres(
    settings: Mapping[str, Any],
    count: int,
    engine: object,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
    """Columns of `count` flights, all alike: the records, and the corners between them. Raises DataError for set points
    whose times do not rise from 0."""
    points = settings["set_points"]
    times = np.array([p["time_s"] for p in points], dtype=float)
    if len(times) < 2 or times[0] != 0.0 or (np.diff(times) <= 0.0).any():
        raise DataError("the set points of manoeuvres need times that rise from 0 s, two at least")
    records = settings["record_interval_s"] * np.arange(int(times[-1] / settings["record_interval_s"] + 1e-9) + 1)
    every = np.union1d(records, times)
    # a corner beside a record is that record
    corner = ~np.isin(every, records)
    near = corner & (np.abs(every[:, None] - records).min(axis=1) < 1e-9)
    every, corner = every[~near], corner[~near]
    phases = _kept([p["phase"] or None for p in points], "manoeuvre")
    leg = np.clip(np.searchsorted(times, every, side="right") - 1, 0, len(times) - 1)
    columns = {"power_fraction": np.interp(every, times, [p["power"] for p in points])}
    for column in ("altitude_m", "mach", "dT_isa_K"):
        columns[column] = np.interp(every, times, _kept([p[column] for p in points], 0.0))
    shift = max(settings["flight_interval_s"], times[-1] + settings["record_interval_s"]) if count > 1 else 0.0
    flight = np.repeat(np.arange(count), len(every))
    return {
        **{name: np.tile(v, count) for name, v in columns.items()},
        "time_s": np.tile(every, count) + shift * flight,
        "phase": np.tile(np.array(phases)[leg], count),
        "flight": 1 + flight,
        UNRECORDED: np.tile(corner.astype(int), count),
    }


def _kept(values: list[Any], before: Any) -> list[Any]:
    """What is not said is as before."""
    found = []
    for v in values:
        before = before if v is None else v
        found.append(before)
    return found
