"""Whole flights of an airliner, recorded at a steady interval: ground, take-off, climb, cruise, descent.

Climb and descent follow a calibrated-airspeed schedule (250 kt below 10,000 ft, then a faster one, then the
cruise Mach number above the crossover altitude); the rate of climb falls linearly with altitude, so that
altitude against time is an exponential approach; cruise climbs in steps as fuel burns off.

A flight path put together leg by leg: altitude, phase and power against time.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.simulation.missions import (
    DAY_FIELDS,
    FOOT_M,
    KNOT_M_S,
    deviation_along_flight,
    deviation_of_days,
    mach_from_cas,
)


class Profile:
    """Legs one after the other; each changes altitude linearly in time and has one phase and a power ramp.

    `times`, `altitudes` are the corners, s and m; leg i runs from corner i to i + 1.
    """

    def __init__(self, altitude_m: float) -> None:
        self.times = [0.0]
        self.altitudes = [altitude_m]
        self.phases: list[str] = []
        self.powers: list[tuple[float, float]] = []

    @property
    def altitude_m(self) -> float:
        return self.altitudes[-1]

    @property
    def end_s(self) -> float:
        return self.times[-1]

    def go(
        self,
        phase: str,
        altitude_m: float,
        duration_s: float,
        power: float,
        power_end: float | None = None,
    ) -> None:
        """Add a leg that ends at `altitude_m` after `duration_s`; a leg without duration adds nothing."""
        if duration_s <= 0.0:
            return
        self.times.append(self.end_s + duration_s)
        self.altitudes.append(altitude_m)
        self.phases.append(phase)
        self.powers.append((power, power if power_end is None else power_end))

    def hold(self, phase: str, duration_s: float, power: float, power_end: float | None = None) -> None:
        """Add a level leg."""
        self.go(phase, self.altitude_m, duration_s, power, power_end)

    def move(self, phase: str, altitude_m: float, rate_m_s: float, power: float) -> None:
        """Add a leg to `altitude_m` at a steady rate of climb or descent (given positive)."""
        self.go(phase, altitude_m, abs(altitude_m - self.altitude_m) / rate_m_s, power)

    def _leg(self, time_s: NDArray[np.float64]) -> NDArray[np.intp]:
        return np.clip(np.searchsorted(self.times, time_s, side="right") - 1, 0, len(self.phases) - 1)

    def altitude(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Altitude, m, (N,)."""
        return np.interp(time_s, self.times, self.altitudes)

    def phase(self, time_s: NDArray[np.float64]) -> NDArray[np.str_]:
        """Name of the phase, (N,)."""
        return np.asarray(self.phases)[self._leg(time_s)]

    def power(self, time_s: NDArray[np.float64], spool_s: float) -> NDArray[np.float64]:
        """Power fraction, (N,): linear in each leg, reached from the leg before within `spool_s` seconds."""
        leg = self._leg(time_s)
        begin, end = np.asarray(self.powers).T
        times = np.asarray(self.times)
        elapsed = time_s - times[leg]
        wanted = begin[leg] + (end - begin)[leg] * elapsed / np.diff(times)[leg]
        before = np.where(leg > 0, end[np.maximum(leg - 1, 0)], begin[leg])
        return wanted + (before - begin[leg]) * np.clip(1.0 - elapsed / spool_s, 0.0, 1.0)

    def start_of(self, phase: str) -> float:
        """Time, s, at which a phase first begins."""
        return self.times[self.phases.index(phase)]

    def end_of(self, phase: str) -> float:
        """Time, s, at which a phase last ends."""
        return self.times[len(self.phases) - self.phases[::-1].index(phase)]


AIRLINER = Section(
    "airliner",
    "whole flights: ground, take-off, climb, cruise with step climbs, descent",
    (
        Field(
            "airfield_elevation_m",
            "range",
            "elevation of the airfields, [low, high] over flights",
            (0.0, 600.0),
            unit="m",
            minimum=-100.0,
        ),
        Field(
            "cruise_levels_ft",
            "numbers",
            "flight levels of first cruise, one drawn per flight",
            (31000.0, 33000.0, 35000.0),
            unit="ft",
            minimum=5000.0,
        ),
        Field(
            "cruise_mach",
            "range",
            "cruise Mach number, [low, high] over flights",
            (0.78, 0.82),
            minimum=0.1,
            maximum=0.95,
        ),
        Field(
            "cruise_duration_min",
            "range",
            "time in cruise, [low, high] over flights",
            (40.0, 90.0),
            unit="min",
            minimum=1.0,
        ),
        Field("step_climb_ft", "number", "height of a step climb; 0 for none", 2000.0, unit="ft", minimum=0.0),
        Field("step_interval_min", "number", "level flight before each step climb", 30.0, unit="min", minimum=1.0),
        Field(
            "climb_cas_kt",
            "range",
            "calibrated airspeed in climb below and above 10,000 ft",
            (250.0, 290.0),
            unit="kt",
            minimum=60.0,
        ),
        Field(
            "descent_cas_kt",
            "range",
            "calibrated airspeed in descent below and above 10,000 ft",
            (250.0, 290.0),
            unit="kt",
            minimum=60.0,
        ),
        Field(
            "lift_off_cas_kt",
            "number",
            "calibrated airspeed at lift-off and touch-down",
            155.0,
            unit="kt",
            minimum=40.0,
        ),
        Field(
            "climb_rate_m_s", "range", "rate of climb [at 11 km, at sea level]", (3.0, 13.0), unit="m/s", minimum=0.5
        ),
        Field("descent_rate_m_s", "number", "rate of descent above 3 km", 10.0, unit="m/s", minimum=0.5),
        Field(
            "taxi_min", "number", "taxi time before take-off; half of it after landing", 8.0, unit="min", minimum=0.0
        ),
        Field("ground_idle", "number", "power on the ground, fraction of the rating", 0.05, minimum=0, maximum=1),
        Field(
            "take_off",
            "range",
            "take-off power, [low, high] over flights (derated take-offs)",
            (0.88, 1.0),
            minimum=0.0,
            maximum=1.0,
        ),
        Field("climb", "range", "climb power, [low, high] over flights", (0.82, 0.9), minimum=0.0, maximum=1.0),
        Field(
            "cruise",
            "range",
            "cruise power at the start of a level, [low, high] over flights",
            (0.66, 0.76),
            minimum=0.0,
            maximum=1.0,
        ),
        Field("descent", "range", "descent power, [low, high] over flights", (0.15, 0.25), minimum=0.0, maximum=1.0),
        Field("approach", "range", "approach power, [low, high] over flights", (0.3, 0.4), minimum=0.0, maximum=1.0),
        Field(
            "cruise_fade_per_h",
            "number",
            "power given back per hour of level cruise as fuel burns off",
            0.04,
            unit="1/h",
            minimum=0.0,
        ),
        Field(
            "power_scatter",
            "number",
            "standard deviation of the slow power changes of the thrust control",
            0.008,
            minimum=0.0,
            maximum=0.1,
        ),
        Field("record_interval_s", "number", "time between records", 10.0, unit="s", minimum=0.1),
        Field("turnaround_min", "number", "time on the ground between flights", 60.0, unit="min", minimum=0.0),
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


def fly_airliner(
    settings: Mapping[str, Any],
    count: int,
    engine: object,
    rng: np.random.Generator,
) -> dict[str, NDArray]:
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


def one_flight(settings: Mapping[str, Any], rng: np.random.Generator) -> dict[str, NDArray]:
    """Columns of one flight from its first record at time 0."""
    draw = _Draw(settings, rng)
    profile = _profile(settings, draw)
    time = np.arange(0.0, profile.end_s, settings["record_interval_s"])
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

    settings: Mapping[str, Any]
    rng: np.random.Generator
    values: dict[str, float] = field(default_factory=dict)

    def __getitem__(self, key: str) -> float:
        if key not in self.values:
            low, high = self.settings[key]
            self.values[key] = float(self.rng.uniform(low, high))
        return self.values[key]


def _profile(settings: Mapping[str, Any], draw: _Draw) -> Profile:
    """Altitude and power against time, phase by phase."""
    field_m = draw["airfield_elevation_m"]
    level = FOOT_M * float(draw.rng.choice(np.asarray(settings["cruise_levels_ft"], dtype=float)))
    taxi = 60.0 * settings["taxi_min"]
    profile = Profile(field_m)
    profile.hold("ground", taxi, settings["ground_idle"])
    profile.hold("take-off", ROLL_S, draw["take_off"])
    _climb(profile, settings, "take-off", field_m + TAKE_OFF_HEIGHT_M, draw["take_off"])
    _climb(profile, settings, "climb", level, draw["climb"])
    left = 60.0 * draw["cruise_duration_min"]
    step, interval = FOOT_M * settings["step_climb_ft"], 60.0 * settings["step_interval_min"]
    while step and left > 1.5 * interval:
        _level(profile, settings, interval, draw["cruise"])
        level, left = level + step, left - interval
        _climb(profile, settings, "climb", level, draw["climb"])
    _level(profile, settings, left, draw["cruise"])
    rate = settings["descent_rate_m_s"]
    profile.move("descent", LOW_ALTITUDE_M, rate, draw["descent"])
    profile.hold("descent", 60.0, draw["descent"])
    profile.move("descent", field_m + APPROACH_HEIGHT_M, 0.7 * rate, draw["descent"])
    profile.move("approach", field_m, 0.4 * rate, draw["approach"])
    profile.hold("ground", ROLL_S + 0.5 * taxi, settings["ground_idle"])
    return profile


def _climb(profile: Profile, settings: Mapping[str, Any], phase: str, top_m: float, power: float) -> None:
    """Climb to `top_m` at dh/dt = r(h), r linear in h: t = ∫ dh / r(h) on a grid of 60 altitudes."""
    at_top, at_ground = settings["climb_rate_m_s"]
    altitude = np.linspace(profile.altitude_m, max(top_m, profile.altitude_m), 60)
    rate = np.maximum(at_ground + (at_top - at_ground) * altitude / ISA_TOP_M, 1.0)
    slowness = 1.0 / rate
    steps = np.diff(altitude) * 0.5 * (slowness[1:] + slowness[:-1])
    for height, duration in zip(altitude[1:], steps, strict=True):
        profile.go(phase, float(height), float(duration), power)


def _level(profile: Profile, settings: Mapping[str, Any], duration: float, power: float) -> None:
    profile.hold("cruise", duration, power, power - settings["cruise_fade_per_h"] * duration / 3600.0)


def _mach(
    settings: Mapping[str, Any],
    draw: _Draw,
    profile: Profile,
    time: NDArray[np.float64],
    altitude: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Mach number, (N,): the airspeed schedule up to the cruise Mach number, and the ground rolls."""
    field_m = profile.altitudes[0]
    slow = settings["lift_off_cas_kt"]

    def cas(schedule: tuple[float, float]) -> NDArray[np.float64]:
        low, high = schedule
        heights = [field_m, field_m + CLEAN_HEIGHT_M, LOW_ALTITUDE_M, LOW_ALTITUDE_M + 600.0]
        return KNOT_M_S * np.interp(altitude, np.maximum.accumulate(heights), [slow, low, low, high])

    top = profile.start_of("descent")
    speed = np.where(time < top, cas(settings["climb_cas_kt"]), cas(settings["descent_cas_kt"]))
    flown = np.minimum(mach_from_cas(speed, altitude), draw["cruise_mach"])
    roll, touch_down = profile.start_of("take-off"), profile.end_of("approach")
    on_ground = np.interp(time, [roll, roll + ROLL_S, touch_down, touch_down + ROLL_S], [0.0, 1.0, 1.0, 0.0])
    return flown * on_ground


def _power(
    settings: Mapping[str, Any],
    profile: Profile,
    time: NDArray[np.float64],
    phase: NDArray,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Fraction of the rating, (N,), with spool-up ramps at phase changes and slow scatter in flight."""
    knots = np.arange(0.0, profile.end_s + SCATTER_INTERVAL_S, SCATTER_INTERVAL_S)
    scatter = np.interp(time, knots, settings["power_scatter"] * rng.standard_normal(len(knots)))
    steady = np.isin(phase, ("ground", "take-off"))
    return np.clip(profile.power(time, SPOOL_S) + np.where(steady, 0.0, scatter), 0.0, 1.0)
