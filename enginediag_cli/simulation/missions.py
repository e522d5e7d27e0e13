"""The kinds of simulated flights: airliner, snapshots, sweep, ground and manoeuvres.

All of them use airspeed (the compressible Bernoulli relation of airspeed indicators in the ICAO standard atmosphere,
e.g. Young, Performance of the Jet Transport Airplane, 2018, ch. 6) and the temperature of the day.

Climb and descent of airliners follow a calibrated-airspeed schedule: 250 kt below 10,000 ft, then a faster one, then
the cruise Mach number above the crossover altitude. The rate of climb falls linearly with altitude, so that altitude
against time is an exponential approach. Cruise climbs in steps as fuel is burnt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike, NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.evaluation import P_ISA, R_AIR, T_ISA, standard_atmosphere
from enginediag_cli.engine.wrapped import EngineLike
from enginediag_cli.errors import DataError
from enginediag_cli.units import DAY_S

Settings = Mapping[str, Any]
"""Values of a mission's section in a flight file."""
Columns = dict[str, NDArray]
Array = NDArray[np.float64]

UNRECORDED = "unrecorded"
"""Column of a mission: 1 at points that bend the course but are not recorded."""


def fraction(name: str, kind: str, help: str, default: object) -> Field:
    """A key whose values lie between 0 and 1: a power as a fraction of the rating, a humidity."""
    return Field(name, kind, help, default, minimum=0.0, maximum=1.0)


GAMMA = 1.4
"""Ratio of heat capacities of air that airspeed indicators are calibrated with."""
SOUND_SPEED_ISA_M_S = float(np.sqrt(GAMMA * R_AIR * T_ISA))
KNOT_M_S = 1852.0 / 3600.0
"""International nautical mile of 1852 m an hour."""
FOOT_M = 0.3048
"""International foot of 1959."""


def mach_from_cas(cas_m_s: ArrayLike, altitude_m: ArrayLike) -> Array:
    """Mach number of a calibrated airspeed, m/s, at a pressure altitude, m; arguments broadcast.

    The impact pressure qc that an indicator shows as CAS at sea level is the same at altitude:
    qc = p0 [(1 + (CAS/a0)²/5)^3.5 − 1],   M² = 5 [(qc/p + 1)^(1/3.5) − 1]   (subsonic).
    """
    ratio = np.asarray(cas_m_s, dtype=float) / SOUND_SPEED_ISA_M_S
    pressure = np.asarray(standard_atmosphere(np.asarray(altitude_m, dtype=float))[1])
    impact_pressure = P_ISA * ((1.0 + 0.2 * ratio**2) ** 3.5 - 1.0)
    return np.sqrt(5.0 * ((impact_pressure / pressure + 1.0) ** (1.0 / 3.5) - 1.0))


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


def deviation_of_days(settings: Settings, where: str, rng: Generator, count: int) -> Array:
    """Deviations from ISA, K, of `count` days at `where` (ground or cruise): normal, cut at two sigma."""
    mean, sigma = settings[f"dT_isa_{where}_K"], settings[f"dT_isa_{where}_sigma_K"]
    return mean + sigma * np.clip(rng.standard_normal(count), -DAY_LIMIT_SIGMA, DAY_LIMIT_SIGMA)


def deviation_along_flight(
    time_s: Array, altitude_m: Array, ground_K: float, cruise_K: float, rng: Generator, amplitude_K: float = 1.5
) -> Array:
    """Deviation from ISA, K, (N,): linear in altitude between ground and 11 km, plus slow air-mass waves.

    The waves are two sinusoids of 40–90 min and 10–25 min period with random phases, fading out at the
    ground.
    """
    share = np.clip(altitude_m / REFERENCE_ALTITUDE_M, 0.0, 1.0)
    periods = np.array([rng.uniform(2400.0, 5400.0), rng.uniform(600.0, 1500.0)])
    phases = rng.uniform(0.0, 2.0 * np.pi, size=2)
    waves = np.sin(2.0 * np.pi * time_s[:, None] / periods + phases) @ np.array([0.7, 0.3])
    return ground_K + (cruise_K - ground_K) * share + amplitude_K * share * waves


_LEVELS_FT = (31000.0, 33000.0, 35000.0, 37000.0)
"""Eastbound cruising levels (odd thousands of feet, ICAO Annex 2, appendix 3)."""

SNAPSHOTS = Section(
    "snapshots",
    "one take-off and one cruise record per flight",
    (
        Field(
            "airfield_elevation_m", "range", "of the take-off record, [low, high]", (0.0, 900.0), "m", minimum=-100.0
        ),
        Field("take_off_mach", "range", "Mach number of the take-off record", (0.18, 0.28), minimum=0, maximum=0.6),
        fraction("take_off", "range", "take-off power, fraction of the rating", (0.88, 1.0)),
        Field("cruise_levels_ft", "numbers", "in cruise, one drawn per flight", _LEVELS_FT, "ft", minimum=5000.0),
        Field("cruise_mach", "range", "Mach number of the cruise record", (0.77, 0.83), minimum=0.1, maximum=0.95),
        fraction("cruise", "range", "cruise power, fraction of the rating", (0.62, 0.8)),
        Field("flight_interval_h", "number", "time from one take-off to the next", 6.0, "h", minimum=0.1),
        Field("cruise_delay_min", "number", "time from take-off to the cruise record", 45.0, "min", minimum=0.1),
        *DAY_FIELDS,
    ),
)


def draw_snapshots(settings: Settings, count: int, engine: object, rng: Generator) -> Columns:
    """Columns of `count` flights, 2·count records, take-off and cruise in turn."""

    def pair(take_off: NDArray, cruise: NDArray) -> NDArray:
        return np.stack([take_off, cruise], axis=1).reshape(-1)

    def uniform(key: str) -> Array:
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
        Field("altitude_m", "range", "altitude; default: the engine's envelope", None, "m"),
        Field("mach", "range", "Mach number; default: the engine's envelope", None, minimum=0.0),
        Field("dT_isa_K", "range", "deviation from ISA; default: the engine's envelope", None, "K"),
        fraction("power", "range", "power, fraction of the rating", (0.3, 1.0)),
        Field(
            "cas_kt", "range", "calibrated airspeeds flown; the lower from 1500 m up", (0.0, 400.0), "kt", minimum=0.0
        ),
        Field("records_per_flight", "integer", "points that share a flight number", 100, minimum=1),
        Field("record_interval_s", "number", "time between records", 60.0, "s", minimum=0.1),
    ),
)

FREE_BELOW_M = 1500.0
"""Below this altitude any speed down to standstill may be flown: take-off and landing."""


def draw_sweep(settings: Settings, count: int, engine: EngineLike, rng: Generator) -> Columns:
    """Columns of `count` flights of `records_per_flight` independent points each.

    Mach is uniform over the part of its range in which the calibrated airspeed is one that can be flown, so
    that a point at 12 km and Mach 0.1 does not occur when `cas_kt` says so.
    """
    n = count * settings["records_per_flight"]
    uniform = {}
    for column in ("altitude_m", "mach", "dT_isa_K", "power"):
        # one draw per column whatever its range, so that fixing one range leaves the others' points
        uniform[column] = rng.random(n)
    altitude = _scale(uniform["altitude_m"], *_range(settings, engine, "altitude_m"))
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
        **{column: _scale(rng.random(n), *engine.envelope[column]) for column in others},
        "time_s": settings["record_interval_s"] * record,
        "phase": np.full(n, "sweep"),
        "altitude_m": altitude,
        "mach": _scale(uniform["mach"], np.minimum(np.clip(floor, low, high), ceiling), ceiling),
        "dT_isa_K": _scale(uniform["dT_isa_K"], *_range(settings, engine, "dT_isa_K")),
        "power_fraction": _scale(uniform["power"], *settings["power"]),
        "flight": 1 + record // settings["records_per_flight"],
    }


def _scale(uniform: Array, low: float | Array, high: float | Array) -> Array:
    return low + (high - low) * uniform


def _range(settings: Settings, engine: EngineLike, column: str) -> tuple[float, float]:
    """The file's range, else the engine's, else 0 (an engine that knows no Mach number)."""
    chosen = settings[column] if settings[column] is not None else engine.envelope.get(column, (0.0, 0.0))
    return float(chosen[0]), float(chosen[1])


GROUND = Section(
    "ground",
    "a ground or ship turbine: ambient temperature by day and season, load by hour",
    (
        Field("elevation_m", "number", "elevation of the site", 0.0, "m", minimum=-400.0, maximum=4500.0),
        Field("pressure_swing_m", "number", "standard deviation with the weather", 60.0, "m", minimum=0.0),
        Field("ambient_mean_K", "number", "mean over the year", 288.15, "K", minimum=220.0, maximum=330.0),
        Field("season_amplitude_K", "number", "half of summer minus winter", 9.0, "K", minimum=0.0),
        Field("day_amplitude_K", "number", "half of afternoon minus night", 4.0, "K", minimum=0.0),
        Field("weather_K", "number", "standard deviation from day to day", 3.0, "K", minimum=0.0),
        fraction("relative_humidity", "range", "[afternoon, night], for engines with a humidity input", (0.5, 0.9)),
        Field("first_day_of_year", "integer", "day of the year of the first record", 1, minimum=1, maximum=366),
        fraction("load_by_hour", "numbers", "power at evenly spaced hours from midnight, linear between them", (1.0,)),
        Field("load_scatter", "number", "standard deviation from hour to hour", 0.02, minimum=0.0, maximum=0.3),
        fraction("base_load_above", "number", "load from which a record is called base load", 0.95),
        Field("record_interval_s", "number", "time between records", 3600.0, "s", minimum=1.0),
    ),
)

YEAR_DAYS = 365.25
"""Julian year."""
COLDEST_DAY = 20.0
"""Of the year: 20 January, a month after the solstice, as on land of northern middle latitudes."""
WARMEST_HOUR = 15.0
"""Of the day: three hours after noon."""
WEATHER_TIME_S = 2.0 * DAY_S
"""Correlation time of the weather: two days, the passage of fronts."""


def run_on_ground(settings: Settings, count: int, engine: object, rng: Generator) -> Columns:
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


def wander(n: int, rho: float, rng: Generator) -> Array:
    """Stationary first-order autoregression of unit variance, (n,): x_k = ρ x_{k−1} + √(1 − ρ²) ε_k."""
    from scipy.signal import lfilter

    shocks = rng.standard_normal(n)
    shocks[1:] *= np.sqrt(1.0 - rho**2)
    return np.asarray(lfilter([1.0], [1.0, -rho], shocks))


def humidity(relative: Array, temperature_K: Array, pressure_Pa: float = P_ISA) -> Array:
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


def fly_manoeuvres(settings: Settings, count: int, engine: object, rng: Generator) -> Columns:
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
    phases = _continued([p["phase"] or None for p in points], "manoeuvre")
    leg = np.clip(np.searchsorted(times, every, side="right") - 1, 0, len(times) - 1)
    columns = {"power_fraction": np.interp(every, times, [p["power"] for p in points])}
    for column in ("altitude_m", "mach", "dT_isa_K"):
        columns[column] = np.interp(every, times, _continued([p[column] for p in points], 0.0))
    shift = max(settings["flight_interval_s"], times[-1] + settings["record_interval_s"]) if count > 1 else 0.0
    flight = np.repeat(np.arange(count), len(every))
    return {
        **{name: np.tile(v, count) for name, v in columns.items()},
        "time_s": np.tile(every, count) + shift * flight,
        "phase": np.tile(np.array(phases)[leg], count),
        "flight": 1 + flight,
        UNRECORDED: np.tile(corner.astype(int), count),
    }


def _continued(values: list[Any], first: Any) -> list[Any]:
    """Values in which None stands for the one before."""
    return list(accumulate(values, lambda before, v: before if v is None else v, initial=first))[1:]


class FlightProfile:
    """Legs one after the other; each changes altitude linearly in time and has one phase and a power ramp.

    `times`, `altitudes` are the corners, s and m; leg i runs from corner i to i + 1.
    """

    def __init__(self, altitude_m: float) -> None:
        self.times = [0.0]
        self.altitudes = [altitude_m]
        self.phases: list[str] = []
        self.powers: list[tuple[float, float]] = []

    def go(
        self, phase: str, altitude_m: float, duration_s: float, power: float, power_end: float | None = None
    ) -> None:
        """Add a leg that ends at `altitude_m` after `duration_s`; a leg without duration adds nothing."""
        if duration_s <= 0.0:
            return
        self.times.append(self.times[-1] + duration_s)
        self.altitudes.append(altitude_m)
        self.phases.append(phase)
        self.powers.append((power, power if power_end is None else power_end))

    def hold(self, phase: str, duration_s: float, power: float, power_end: float | None = None) -> None:
        """Add a level leg."""
        self.go(phase, self.altitudes[-1], duration_s, power, power_end)

    def move(self, phase: str, altitude_m: float, rate_m_s: float, power: float) -> None:
        """Add a leg to `altitude_m` at a steady rate of climb or descent (given positive)."""
        self.go(phase, altitude_m, abs(altitude_m - self.altitudes[-1]) / rate_m_s, power)

    def _leg(self, time_s: Array) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.times, time_s, side="right") - 1, 0, len(self.phases) - 1)

    def altitude(self, time_s: Array) -> Array:
        """Altitude, m, (N,)."""
        return np.interp(time_s, self.times, self.altitudes)

    def phase(self, time_s: Array) -> NDArray[np.str_]:
        """Name of the phase, (N,)."""
        return np.asarray(self.phases)[self._leg(time_s)]

    def power(self, time_s: Array, spool_s: float) -> Array:
        """Power fraction, (N,): linear in each leg, reached from the leg before within `spool_s` seconds."""
        leg = self._leg(time_s)
        begin, end = np.asarray(self.powers).T
        times = np.asarray(self.times)
        elapsed = time_s - times[leg]
        wanted = begin[leg] + (end - begin)[leg] * elapsed / np.diff(times)[leg]
        before = np.where(leg > 0, end[np.maximum(leg - 1, 0)], begin[leg])
        return wanted + (before - begin[leg]) * np.clip(1.0 - elapsed / spool_s, 0.0, 1.0)

    def start_time(self, phase: str) -> float:
        """Time, s, at which a phase first begins."""
        return self.times[self.phases.index(phase)]

    def end_time(self, phase: str) -> float:
        """Time, s, at which a phase last ends."""
        return self.times[len(self.phases) - self.phases[::-1].index(phase)]


AIRLINER = Section(
    "airliner",
    "whole flights: ground, take-off, climb, cruise with step climbs, descent",
    (
        Field(
            "airfield_elevation_m",
            "range",
            "of the airfields, [low, high] over flights",
            (0.0, 600.0),
            "m",
            minimum=-100.0,
        ),
        Field(
            "cruise_levels_ft", "numbers", "of first cruise, one drawn per flight", _LEVELS_FT[:3], "ft", minimum=5000.0
        ),
        Field("cruise_mach", "range", "in cruise, [low, high] over flights", (0.78, 0.82), minimum=0.1, maximum=0.95),
        Field(
            "cruise_duration_min", "range", "time in cruise, [low, high] over flights", (40.0, 90.0), "min", minimum=1.0
        ),
        Field("step_climb_ft", "number", "height of a step climb; 0 for none", 2000.0, "ft", minimum=0.0),
        Field("step_interval_min", "number", "level flight before each step climb", 30.0, "min", minimum=1.0),
        Field(
            "climb_cas_kt", "range", "airspeed in climb below and above 10,000 ft", (250.0, 290.0), "kt", minimum=60.0
        ),
        Field("descent_cas_kt", "range", "the same in descent", (250.0, 290.0), "kt", minimum=60.0),
        Field("lift_off_cas_kt", "number", "airspeed at lift-off and touch-down", 155.0, "kt", minimum=40.0),
        Field("climb_rate_m_s", "range", "rate of climb [at 11 km, at sea level]", (3.0, 13.0), "m/s", minimum=0.5),
        Field("descent_rate_m_s", "number", "rate of descent above 3 km", 10.0, "m/s", minimum=0.5),
        Field("taxi_min", "number", "time before take-off; half of it after landing", 8.0, "min", minimum=0.0),
        fraction("ground_idle", "number", "power on the ground, fraction of the rating", 0.05),
        fraction("take_off", "range", "take-off power, [low, high] over flights (derated take-offs)", (0.88, 1.0)),
        fraction("climb", "range", "climb power, [low, high] over flights", (0.82, 0.9)),
        fraction("cruise", "range", "cruise power at the start of a level, [low, high] over flights", (0.66, 0.76)),
        fraction("descent", "range", "descent power, [low, high] over flights", (0.15, 0.25)),
        fraction("approach", "range", "approach power, [low, high] over flights", (0.3, 0.4)),
        Field("cruise_fade_per_h", "number", "loss of cruise power as fuel burns off", 0.04, "1/h", minimum=0.0),
        Field("power_scatter", "number", "standard deviation of slow changes", 0.008, minimum=0.0, maximum=0.1),
        Field("record_interval_s", "number", "time between records", 10.0, "s", minimum=0.1),
        Field("turnaround_min", "number", "time on the ground between flights", 60.0, "min", minimum=0.0),
        *DAY_FIELDS,
    ),
)

LOW_ALTITUDE_M = 10000.0 * FOOT_M
"""Below 10,000 ft airliners fly 250 kt at most (ICAO airspace classes; 14 CFR 91.117)."""
TAKE_OFF_HEIGHT_M = 450.0
"""Where take-off power is reduced to climb power: 1,500 ft, as in noise-abatement procedures (ICAO Doc 8168)."""
CLEAN_HEIGHT_M = 1200.0
"""Where flaps are in and the airspeed of the climb is reached. Judgement."""
APPROACH_HEIGHT_M = 900.0
"""Where the descent ends and the approach begins: 3,000 ft, where glide slopes are met."""
ROLL_S = 40.0
"""Of the take-off run and of the landing run."""
SPOOL_S = 8.0
"""In which power changes from one setting to the next: acceleration of a turbofan from idle (14 CFR 33.73 asks for 5
s), rounded up for a lever that is moved slowly."""
SCATTER_INTERVAL_S = 120.0
"""Between corrections of the thrust by crew or autothrottle. Judgement."""
ISA_TOP_M = 11000.0
"""Of the troposphere of the standard atmosphere, over which the rate of climb falls linearly."""


def fly_airliner(settings: Settings, count: int, engine: object, rng: Generator) -> Columns:
    """Columns of `count` flights one after the other, every flight drawn by a generator of its own."""
    entropy = rng.integers(0, 2**32, size=4)
    flights, start = [], 0.0
    for number in range(1, count + 1):
        own = np.random.default_rng(np.random.SeedSequence([*map(int, entropy), number]))
        columns = one_flight(settings, own)
        columns["flight"] = np.full(len(columns["time_s"]), number)
        length = columns["time_s"][-1]
        columns["time_s"] = columns["time_s"] + start
        start += length + 60.0 * settings["turnaround_min"]
        start = settings["record_interval_s"] * np.ceil(start / settings["record_interval_s"])
        flights.append(columns)
    return {name: np.concatenate([f[name] for f in flights]) for name in flights[0]} if flights else {}


def one_flight(settings: Settings, rng: Generator) -> Columns:
    """Columns of one flight from its first record at time 0."""
    draw = _Draw(settings, rng)
    profile = _profile(settings, draw)
    time = np.arange(0.0, profile.times[-1], settings["record_interval_s"])
    altitude, phase = profile.altitude(time), profile.phase(time)
    ground_K, cruise_K = (float(deviation_of_days(settings, where, rng, 1)[0]) for where in ("ground", "cruise"))
    return {
        "time_s": time,
        "phase": phase,
        "altitude_m": altitude,
        "mach": _mach(settings, draw, profile, time, altitude),
        "dT_isa_K": deviation_along_flight(time, altitude, ground_K, cruise_K, rng),
        "power_fraction": _power(settings, profile, time, phase, rng),
    }


@dataclass
class _Draw:
    """What differs from flight to flight."""

    settings: Settings
    rng: Generator
    values: dict[str, float] = field(default_factory=dict)

    def __getitem__(self, key: str) -> float:
        if key not in self.values:
            low, high = self.settings[key]
            self.values[key] = float(self.rng.uniform(low, high))
        return self.values[key]


def _profile(settings: Settings, draw: _Draw) -> FlightProfile:
    """Altitude and power against time, phase by phase."""
    field_m = draw["airfield_elevation_m"]
    level = FOOT_M * float(draw.rng.choice(np.asarray(settings["cruise_levels_ft"], dtype=float)))
    taxi = 60.0 * settings["taxi_min"]
    profile = FlightProfile(field_m)

    def level_flight(duration: float) -> None:
        power = draw["cruise"]
        profile.hold("cruise", duration, power, power - settings["cruise_fade_per_h"] * duration / 3600.0)

    profile.hold("ground", taxi, settings["ground_idle"])
    profile.hold("take-off", ROLL_S, draw["take_off"])
    _climb(profile, settings, "take-off", field_m + TAKE_OFF_HEIGHT_M, draw["take_off"])
    _climb(profile, settings, "climb", level, draw["climb"])
    left = 60.0 * draw["cruise_duration_min"]
    step, interval = FOOT_M * settings["step_climb_ft"], 60.0 * settings["step_interval_min"]
    while step and left > 1.5 * interval:
        level_flight(interval)
        level, left = level + step, left - interval
        _climb(profile, settings, "climb", level, draw["climb"])
    level_flight(left)
    rate = settings["descent_rate_m_s"]
    profile.move("descent", LOW_ALTITUDE_M, rate, draw["descent"])
    profile.hold("descent", 60.0, draw["descent"])
    profile.move("descent", field_m + APPROACH_HEIGHT_M, 0.7 * rate, draw["descent"])
    profile.move("approach", field_m, 0.4 * rate, draw["approach"])
    profile.hold("ground", ROLL_S + 0.5 * taxi, settings["ground_idle"])
    return profile


def _climb(profile: FlightProfile, settings: Settings, phase: str, top_m: float, power: float) -> None:
    """Climb to `top_m` at dh/dt = r(h), r linear in h: t = ∫ dh / r(h) on a grid of 60 altitudes."""
    at_top, at_ground = settings["climb_rate_m_s"]
    altitude = np.linspace(profile.altitudes[-1], max(top_m, profile.altitudes[-1]), 60)
    rate = np.maximum(at_ground + (at_top - at_ground) * altitude / ISA_TOP_M, 1.0)
    slowness = 1.0 / rate
    steps = np.diff(altitude) * 0.5 * (slowness[1:] + slowness[:-1])
    for height, duration in zip(altitude[1:], steps, strict=True):
        profile.go(phase, float(height), float(duration), power)


def _mach(settings: Settings, draw: _Draw, profile: FlightProfile, time: Array, altitude: Array) -> Array:
    """Mach number, (N,): the airspeed schedule up to the cruise Mach number, and the ground rolls."""
    field_m = profile.altitudes[0]
    slow = settings["lift_off_cas_kt"]

    def cas(schedule: tuple[float, float]) -> Array:
        low, high = schedule
        heights = [field_m, field_m + CLEAN_HEIGHT_M, LOW_ALTITUDE_M, LOW_ALTITUDE_M + 600.0]
        return KNOT_M_S * np.interp(altitude, np.maximum.accumulate(heights), [slow, low, low, high])

    top = profile.start_time("descent")
    speed = np.where(time < top, cas(settings["climb_cas_kt"]), cas(settings["descent_cas_kt"]))
    flown = np.minimum(mach_from_cas(speed, altitude), draw["cruise_mach"])
    roll, touch_down = profile.start_time("take-off"), profile.end_time("approach")
    on_ground = np.interp(time, [roll, roll + ROLL_S, touch_down, touch_down + ROLL_S], [0.0, 1.0, 1.0, 0.0])
    return flown * on_ground


def _power(settings: Settings, profile: FlightProfile, time: Array, phase: NDArray, rng: Generator) -> Array:
    """Fraction of the rating, (N,), with spool-up ramps at phase changes and slow scatter in flight."""
    knots = np.arange(0.0, profile.times[-1] + SCATTER_INTERVAL_S, SCATTER_INTERVAL_S)
    scatter = np.interp(time, knots, settings["power_scatter"] * rng.standard_normal(len(knots)))
    steady = np.isin(phase, ("ground", "take-off"))
    return np.clip(profile.power(time, SPOOL_S) + np.where(steady, 0.0, scatter), 0.0, 1.0)
