"""Flights of trials, and the causes that may act in them.

Flights are drawn within the envelope of an engine:

Short flights
    climb, cruise and descent.
Days of a machine on the ground
    weather, base load by day and part load at night.
Moving recordings, for dynamic effects
    steps, ramps, slams and staircases of power, once a second. The command is drawn, not how the engine follows it: the
    truth is the quasi-steady network with the concealed effect on the tape of each recording.
Higher flights
    four kilometres above those that were searched, where a formula must hold although nobody has flown there.

Causes are the effects that can be drawn, each as often as its weight. The concealed truth and the answer are written in
the same terms, so that the scorer compares like with like. An effect that identification absorbs at any size is drawn
seldom: its trial shows little more than one with nothing concealed.

Dynamic effects are rate limits, lags, delays, heat soak and inertia. Their kind is drawn first and their location after
that, since an engine has more probes than fuel controls. Sizes are in seconds that recordings of some minutes at 1 Hz
can show. A rotor's inertia is drawn as the time in which its whole design power would bring it to speed, because
kilogram metres squared of a model jet say nothing about a fan.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import Any

import numpy as np

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.errors import DataError
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    Hypothesis,
    IdentifiedHypothesis,
    identify_with,
    nuisance,
)
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.fit.options import Option, effect_option, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects, effect, separate_effects, term, term_names
from enginediag_cli.physics.terms.control import (
    FuelControlLag,
    FuelRateLimit,
    LoadControlDelay,
    LoadControlLag,
    LoadRateLimit,
    LoadSecondOrderLag,
)
from enginediag_cli.physics.terms.probe import ClockShift, ProbeLag
from enginediag_cli.physics.terms.turbomachinery import HeatSoak, RotorInertia
from enginediag_cli.units import RAD_S_PER_RPM, split_column

CONDITIONS = ("altitude_m", "mach", "dT_isa_K")
STEP_S = 30.0
"""Between records: snapshots, as an airline's reports are made of."""
TRAINING, HELD_BACK = (4, 6), 2  # flights
RECORDS = (50, 70)
"""Of a flight, from and to: half an hour of them."""
MACH_SCATTER, DAY_SIGMA_K = 0.02, 8.0
"""Scatter of Mach within a flight, and of the temperature from day to day. Judgement: routes differ by as much."""
HOURS, BETWEEN_FLIGHTS_H = (0.0, 400.0), (20.0, 200.0)
"""Hours since a wash at the first flight, and between flights, from and to: some weeks of service."""


GOVERNED = 0.004
"""Scatter of a speed or another input that a governor holds, over its value."""


def draw_flights(engine: Engine, rng: np.random.Generator) -> tuple[list[dict[str, np.ndarray]], int]:
    """Columns (N,) of every flight: time, the engine's inputs, hours; and how many flights are not held back.

    Raises DataError for an engine that has inputs which nothing is known of, or whose power range is not stated.
    """
    check_flyable(engine)
    stays = "altitude_m" not in engine.inputs
    draw, step = (ground_days, GROUND_STEP_S) if stays else (_flight, STEP_S)
    training = int(rng.integers(TRAINING[0], TRAINING[1] + 1))
    count = training + HELD_BACK
    hours = {c: hours_at_flights(count, rng) for c in hour_columns()}
    flights = []
    for k in range(count):
        n = int(rng.integers(RECORDS[0], RECORDS[1] + 1))
        drawn = draw(engine, n, rng)
        drawn = {c: drawn[c] if c in drawn else _governed(engine, c, n, rng) for c in engine.inputs}
        columns = {"time_s": step * np.arange(n), **drawn}
        for c, start in hours.items():
            columns[c] = start[k] + columns["time_s"] / 3600.0
        flights.append(columns)
    return flights, training


def hours_at_flights(count: int, rng: np.random.Generator) -> np.ndarray:
    """Hours since a wash or a change of filter at the begin of every flight; it is done again before one of them."""
    clock = rng.uniform(*HOURS) + np.cumsum(rng.uniform(*BETWEEN_FLIGHTS_H, count))
    again = int(rng.integers(1, count))
    return np.where(np.arange(count) < again, clock, clock - clock[again] + rng.uniform(0.0, BETWEEN_FLIGHTS_H[0]))


def check_flyable(engine: Engine) -> None:
    """Raises DataError for an engine that has inputs which nothing is known of, or whose power range is not stated."""
    known = (*CONDITIONS, *GROUND_CONDITIONS, *engine.envelope, engine.power_setting)
    odd = [c for c in engine.inputs if c not in known]
    lacking = [c for c in (CONDITIONS[:2] if "altitude_m" in engine.inputs else GROUND_CONDITIONS)]
    if odd or any(c not in engine.inputs for c in lacking):
        raise DataError(
            f"{engine.name}: blind trials fly an engine by {', '.join(CONDITIONS)}, or run it by "
            f"{', '.join(GROUND_CONDITIONS)}, and by one power setting; other inputs need a range in the engine file's "
            f"`envelope:`; its inputs are {', '.join(engine.inputs)}"
        )
    if engine.power_range is None:
        raise DataError(f"{engine.name}: blind trials need the engine file's `power_range:`")


def hour_columns() -> tuple[str, ...]:
    """Columns of hours that terms of the library read."""
    return tuple(dict.fromkeys(c for n in term_names() for c in term(n).INPUTS if split_column(c)[1] == "h"))


def _flight(engine: Engine, n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Climb to a cruise level with one step, and descent; Mach rises with altitude, with scatter."""
    ceiling = _limit(engine, "altitude_m", (0.0, 12500.0))[1]
    fastest = _limit(engine, "mach", (0.0, 0.88))[1]
    level = ceiling * rng.uniform(0.6, 0.93)
    step = min(600.0, 0.97 * ceiling - level) * rng.integers(0, 2)
    low = level * rng.uniform(0.1, 0.3)
    up, down = int(0.3 * n), int(0.25 * n)
    cruise = n - up - down
    later = np.arange(cruise) >= rng.integers(cruise // 4, 3 * cruise // 4)
    altitude = np.concatenate(
        [
            np.linspace(low, level, up, endpoint=False),
            level + step * later,
            np.linspace(level + step, low, down),
        ]
    )
    slow, fast = fastest * rng.uniform(0.35, 0.5), fastest * rng.uniform(0.8, 0.93)
    mach = slow + (fast - slow) * (altitude / altitude.max()) ** 0.8 + MACH_SCATTER * rng.standard_normal(n)
    levels = rng.uniform(0.5, 0.85, 3)
    part = np.minimum(3 * np.arange(cruise) // max(cruise, 1), 2)
    fraction = np.concatenate(
        [
            np.linspace(rng.uniform(0.9, 1.0), rng.uniform(0.8, 0.9), up),
            levels[part],
            np.linspace(rng.uniform(0.3, 0.5), rng.uniform(0.25, 0.4), down),
        ]
    ) + 0.01 * rng.standard_normal(n)
    columns = {"altitude_m": altitude, "mach": np.clip(mach, 0.05, fastest)}
    dT = _limit(engine, "dT_isa_K", (-25.0, 25.0))
    columns["dT_isa_K"] = np.full(n, np.clip(DAY_SIGMA_K * rng.standard_normal(), 0.9 * dT[0], 0.9 * dT[1]))
    columns = {c: v for c, v in columns.items() if c in engine.inputs}
    power = engine.power_from_fraction(np.clip(fraction, 0.0, 1.0), columns)
    columns[engine.power_setting] = np.clip(power, *_limit(engine, engine.power_setting, (-np.inf, np.inf)))
    return columns


def _governed(engine: Engine, column: str, n: int, rng: np.random.Generator) -> np.ndarray:
    """An input that is held in the middle of its range."""
    low, high = engine.envelope[column]
    middle = 0.5 * (low + high)
    return np.clip(middle * (1.0 + GOVERNED * rng.standard_normal(n)), low, high)


def _limit(engine: Engine, column: str, default: tuple[float, float]) -> tuple[float, float]:
    return engine.envelope.get(column, default)


def stack_flights(flights: Sequence[Mapping[str, np.ndarray]]) -> Mapping[str, np.ndarray]:
    """Columns over all flights."""
    return {c: np.concatenate([f[c] for f in flights]) for c in flights[0]}


GROUND_CONDITIONS = ("ambient_pressure_Pa", "ambient_temperature_K")
GROUND_STEP_S = 3600.0
"""Between records: hourly averages, as public recordings of such machines are."""
GROUND_DAY_SIGMA_K, SWING_K, WEATHER_K = 5.0, (3.0, 7.0), 1.0
"""Temperature: from one recording to the next, half of the difference from day to night, and steps from hour to hour.
Judgement: a temperate site over a season."""
PRESSURE_SIGMA_PA, PRESSURE_STEP_PA = 500.0, 100.0
"""Pressure: from one recording to the next, and steps from hour to hour, as weather goes."""
BASE, NIGHT, PEAK = (0.92, 1.0), (0.5, 0.8), 0.6
"""Power fractions at base load and at night; chance that a machine runs down at night at all."""
SCATTER = 0.01
"""Of the power fraction from hour to hour."""
INSIDE = 0.02
"""Of the width of the envelope, kept from its ends."""


def ground_days(engine: Engine, n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Inputs (n,) of some days in one season; a recorded inlet loss grows with the flow, so with power."""
    hour = np.arange(n) + rng.uniform(0.0, 24.0)
    day = np.cos(2.0 * np.pi * (hour - 15.0) / 24.0)  # warmest at three in the afternoon
    low, high = engine.envelope.get("ambient_temperature_K", (263.0, 313.0))
    mean = np.clip(0.5 * (low + high) + GROUND_DAY_SIGMA_K * rng.standard_normal(), low + 8.0, high - 8.0)
    columns = {"ambient_temperature_K": mean + rng.uniform(*SWING_K) * day + _wander(WEATHER_K, n, rng)}
    low, high = engine.envelope.get("ambient_pressure_Pa", (97000.0, 104000.0))
    level = 0.5 * (low + high) + PRESSURE_SIGMA_PA * rng.standard_normal()
    columns["ambient_pressure_Pa"] = level + _wander(PRESSURE_STEP_PA, n, rng)
    levels = rng.uniform(*BASE), rng.uniform(*NIGHT)
    night = (rng.random() < PEAK) * np.clip(0.5 - day, 0.0, 1.0)
    fraction = levels[0] + (levels[1] - levels[0]) * night + SCATTER * rng.standard_normal(n)
    fraction = np.clip(fraction, 0.0, 1.0)
    if "dP_inlet_Pa" in engine.inputs:
        low, high = engine.envelope.get("dP_inlet_Pa", (300.0, 600.0))
        clean = low + rng.uniform(0.3, 0.7) * (high - low)
        columns["dP_inlet_Pa"] = clean * (0.8 + 0.2 * fraction) + 5.0 * rng.standard_normal(n)
    columns = {c: _inside(engine, c, v) for c, v in columns.items() if c in engine.inputs}
    columns[engine.power_setting] = _inside(engine, engine.power_setting, _power(engine, fraction, columns))
    return columns


def _wander(step: float, n: int, rng: np.random.Generator) -> np.ndarray:
    """A random walk (n,) about 0."""
    walk = np.cumsum(step * rng.standard_normal(n))
    return np.asarray(walk - walk.mean())


def _power(engine: Engine, fraction: np.ndarray, columns: dict[str, np.ndarray]) -> np.ndarray:
    return np.asarray(engine.power_from_fraction(fraction, columns))


def _inside(engine: Engine, column: str, values: np.ndarray) -> np.ndarray:
    low, high = engine.envelope.get(column, (-np.inf, np.inf))
    room = INSIDE * (high - low) if np.isfinite(high - low) else 0.0
    return np.clip(values, low + room, high - room)


MOVING_STEP_S = 1.0
"""Between records: what a continuous recorder keeps."""
MOVING_TRAINING, MOVING_HELD_BACK = (3, 5), 2  # flights
MOVING_RECORDS = (120, 300)
"""Of a flight, from and to: some minutes. Judgement: as many as show what passes in seconds and in a minute or two, and
no more than a trial can afford."""
POWER = (0.25, 1.0)
"""Fractions of the power range that levels lie between."""
LEAST_CHANGE = 0.2
"""Of the power range, between one level and the next: a smaller change is not visible."""
HOLD_S, RAMP_S, SLAM_S, STAIR_S = (10.0, 60.0), (10.0, 60.0), (6.0, 20.0), (6.0, 20.0)
"""A level's length, a ramp's, how long a slam stays up, a stair's, from and to. Judgement: test beds and circuits."""
STAIRS = (3, 5)
"""Of a staircase, from and to: with fewer it is a step, with more a flight is over."""
AT_ONCE_S, SPEED_S = 1.0, 8.0
"""In which a change at once is over: of what is commanded from one record to the next; of a rotor's speed over the
whole range in what a spool takes to accelerate, since no rotor steps."""
DRIFT_S = (60.0, 400.0)
"""Periods of what drifts beside the power: altitude, Mach, weather, the speed that a governor holds."""
ALTITUDE_M, MACH, MOVING_WEATHER_K, WEATHER_PA = 150.0, 0.015, 0.7, 60.0
"""Amplitudes of these drifts within a flight."""
LEVELS, SPEEDS = (0.05, 0.85), (0.4, 0.85)
"""Share of the ceiling, and of the fastest Mach of the envelope, at which an aircraft flies its flight."""


def draw_moving_flights(engine: Engine, rng: np.random.Generator) -> tuple[list[dict[str, np.ndarray]], int]:
    """Columns (N,) of every flight: time, the engine's inputs, hours; and how many flights are not held back. No
    record fails for what is drawn here: levels keep within the range of power and of the envelope.

    Raises DataError as `draw_flights` does.
    """
    check_flyable(engine)
    training = int(rng.integers(MOVING_TRAINING[0], MOVING_TRAINING[1] + 1))
    count = training + MOVING_HELD_BACK
    hours = {c: hours_at_flights(count, rng) for c in hour_columns()}
    flights = []
    for k in range(count):
        time = MOVING_STEP_S * np.arange(int(rng.integers(MOVING_RECORDS[0], MOVING_RECORDS[1] + 1)))
        columns = {"time_s": time, **_inputs(engine, time, rng)}
        for c, start in hours.items():
            columns[c] = start[k] + time / 3600.0
        flights.append(columns)
    return flights, training


def power_profile(time: np.ndarray, at_once_s: float, rng: np.random.Generator) -> np.ndarray:
    """Fraction of the power range (N,) at times in s: levels, joined by manoeuvres of all kinds, until the time is
    over. `at_once_s`: in which the whole range is passed at once."""
    t, level = 0.0, float(rng.uniform(*POWER))
    corners = [(t, level)]

    def hold(seconds: float) -> None:
        nonlocal t
        t += seconds
        corners.append((t, level))

    def move(new: float, seconds: float) -> None:
        nonlocal t, level
        t, level = t + max(seconds, at_once_s * abs(new - level), AT_ONCE_S), new
        corners.append((t, level))

    hold(rng.uniform(*HOLD_S))
    manoeuvres: Sequence[Callable[[], None]] = (
        lambda: move(_other(level, rng), 0.0),
        lambda: move(_other(level, rng), rng.uniform(*RAMP_S)),
        lambda: _slam(level, move, hold, rng),
        lambda: _staircase(level, move, hold, rng),
    )
    while t < time[-1]:
        manoeuvres[int(rng.integers(len(manoeuvres)))]()
        hold(rng.uniform(*HOLD_S))
    at, values = np.array(corners).T
    return np.interp(time, at, values)


def _slam(
    level: float, move: Callable[[float, float], None], hold: Callable[[float], None], rng: np.random.Generator
) -> None:
    """To another level at once, and back before everything has settled."""
    move(_other(level, rng), 0.0)
    hold(rng.uniform(*SLAM_S))
    move(level, 0.0)


def _staircase(
    level: float, move: Callable[[float, float], None], hold: Callable[[float], None], rng: np.random.Generator
) -> None:
    stairs = int(rng.integers(STAIRS[0], STAIRS[1] + 1))
    for step in np.linspace(level, _other(level, rng), stairs + 1)[1:]:
        move(float(step), 0.0)
        hold(rng.uniform(*STAIR_S))


def _other(level: float, rng: np.random.Generator) -> float:
    """Another level, at least LEAST_CHANGE away."""
    low, high = POWER
    below, above = max(level - LEAST_CHANGE - low, 0.0), max(high - level - LEAST_CHANGE, 0.0)
    drawn = rng.uniform(0.0, below + above)
    return float(low + drawn if drawn < below else level + LEAST_CHANGE + drawn - below)


def _inputs(engine: Engine, time: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """The engine's inputs (N,) of one flight."""
    columns = _air(engine, time, rng) if "altitude_m" in engine.inputs else _weather(engine, time, rng)
    for c in engine.inputs:
        if c not in columns and c != engine.power_setting:
            low, high = engine.envelope[c]
            columns[c] = 0.5 * (low + high) * (1.0 + _drift(time, GOVERNED, rng))
    columns = {c: np.clip(v, *_limits(engine, c)) for c, v in columns.items() if c in engine.inputs}
    at_once_s = SPEED_S if engine.power_setting in engine.network.speed_columns else AT_ONCE_S
    power = engine.power_from_fraction(power_profile(time, at_once_s, rng), columns)
    columns[engine.power_setting] = np.clip(power, *_limits(engine, engine.power_setting))
    return {c: columns[c] for c in engine.inputs}


def _air(engine: Engine, time: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    ceiling, fastest = engine.envelope.get("altitude_m", (0.0, 12500.0))[1], engine.envelope.get("mach", (0.0, 0.88))[1]
    dT = engine.envelope.get("dT_isa_K", (-25.0, 25.0))
    share = rng.uniform(*LEVELS)
    return {
        "altitude_m": share * ceiling + _drift(time, ALTITUDE_M, rng),
        "mach": fastest * (SPEEDS[0] + (SPEEDS[1] - SPEEDS[0]) * share) + _drift(time, MACH, rng),
        "dT_isa_K": np.full(len(time), np.clip(DAY_SIGMA_K * rng.standard_normal(), 0.9 * dT[0], 0.9 * dT[1])),
    }


def _weather(engine: Engine, time: np.ndarray, rng: np.random.Generator) -> dict[str, np.ndarray]:
    found = {}
    for c, amplitude in (("ambient_temperature_K", MOVING_WEATHER_K), ("ambient_pressure_Pa", WEATHER_PA)):
        low, high = engine.envelope.get(c, {"ambient_temperature_K": (263.0, 313.0)}.get(c, (97000.0, 104000.0)))
        found[c] = rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high) + _drift(time, amplitude, rng)
    return found


def _drift(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """A slow wave (N,) of an amplitude."""
    return amplitude * np.sin(2.0 * np.pi * (time / rng.uniform(*DRIFT_S) + rng.random()))


def _limits(engine: Engine, column: str) -> tuple[float, float]:
    return engine.envelope.get(column, (-np.inf, np.inf))


ABOVE_M = 4000.0
"""From flights of the middle of the atmosphere to where ambient pressure is little more than half."""
HIGHEST_M = 12500.0
"""Where an engine file states no ceiling."""
ALTITUDE = "altitude_m"


def draw_higher(engine: Engine, rng: np.random.Generator) -> tuple[tuple[Mapping[str, np.ndarray], ...], float]:
    """Inputs of so many flights as are held back, at the same share of the power that there is, and the share of their
    records that stay at the envelope's ceiling; none for an engine that does not fly."""
    if ALTITUDE not in engine.inputs:
        return (), 0.0
    drawn, _ = draw_flights(engine, rng)
    ceiling = engine.envelope.get(ALTITUDE, (0.0, HIGHEST_M))[1]
    low, high = engine.envelope.get(engine.power_setting, (-np.inf, np.inf))
    found, beyond = [], []
    for flight in drawn[:HELD_BACK]:
        raised = {**flight, ALTITUDE: np.minimum(flight[ALTITUDE] + ABOVE_M, ceiling)}
        beyond.append(flight[ALTITUDE] + ABOVE_M > ceiling)
        idle, rating = (engine.power_from_fraction(np.full(len(flight[ALTITUDE]), f), flight) for f in (0.0, 1.0))
        fraction = (flight[engine.power_setting] - idle) / (rating - idle)
        raised[engine.power_setting] = np.clip(engine.power_from_fraction(fraction, raised), low, high)
        found.append(raised)
    return tuple(found), float(np.mean(np.concatenate(beyond)))


@dataclass(frozen=True)
class Cause:
    """An effect, `name` = `term@site`, or a step, `name` = the parameter that steps at record `first` of all
    records in order (−1: an effect)."""

    name: str
    first: int = -1

    @property
    def is_step(self) -> bool:
        return self.first >= 0

    def to_json(self) -> dict[str, Any]:
        return {"name": self.name, "first": self.first}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> Cause:
        return cls(str(values["name"]), int(values["first"]))


FittedCauses = tuple[Sequence[Cause], Mapping[str, float]]
"""Causes, and coefficients at which effects that are tried at some size are begun."""
CauseNames = frozenset[str]
"""A set of causes by name: when a step began is no part of its identity."""


def instrument_place(column: str) -> str:
    """The place of an instrument's error, in trials of isolation."""
    return f"reading {column}"


def cause_names(causes: Sequence[Cause]) -> CauseNames:
    return frozenset(c.name for c in causes)


def causes_from_options(options: Sequence[Option]) -> tuple[Cause, ...]:
    """The causes that an explanation's options stand for."""
    found = [Cause(own.label) for o in options for e in o.hypothesis.effects for own in separate_effects(e)]
    for o in options:
        for d in o.hypothesis.discrepancies:
            found.append(Cause(d.target, int(np.argmax(o.hypothesis.curves[d.curve] > 0))))
    return tuple(found)


def effect_from_cause(engine: Engine, cause: Cause) -> Effect:
    """The effect that a cause names."""
    term, _, site = cause.name.partition("@")
    return effect(engine, term, site)


def causes_hypothesis(
    engine: Engine, causes: Sequence[Cause], records: int, values: Mapping[str, float] | None = None
) -> Hypothesis:
    """The causes as something to fit to evidence of so many records of one engine. `values`: coefficients by parameter
    at which effects start whose derivative at absence is uninformative."""
    effects = tuple(_start_at_sizes(effect_from_cause(engine, c), values or {}) for c in causes if not c.is_step)
    steps = [c for c in causes if c.is_step]
    curves = {f"since record {c.first}": (np.arange(records) >= c.first).astype(float) for c in steps}
    found = tuple(Discrepancy(c.name, f"since record {c.first}", engine.parameters[c.name].prior_sigma) for c in steps)
    return Hypothesis(effects, found, curves)


def _start_at_sizes(effect: Effect, values: Mapping[str, float]) -> Effect:
    if not effect.trial_names:
        return effect
    known = {c.name: effect.parameter_name(c.name) for c in effect.term.amplitudes()}
    return replace(effect, values={**effect.values, **{c: values[n] for c, n in known.items() if n in values}})


def cause_components(engine: Engine, cause: Cause) -> frozenset[str]:
    """Where an engineer would look: the effect's component, and those whose parameters it acts through (a variation
    of cooling flow is of the turbine and of the cooling bleed)."""
    if cause.is_step:
        return frozenset({engine.parameters[cause.name].component})
    site = effect_from_cause(engine, cause).site
    leaves = {engine.parameters[leaf].component for leaf in site.targets if leaf in engine.parameters}
    return frozenset({site.component} | leaves)


SIZES: Mapping[str, Mapping[str, tuple[float, float]]] = MappingProxyType(
    {
        FuelRateLimit.NAME: {"rise": (4.0, 20.0), "fall": (4.0, 20.0)},
        FuelControlLag.NAME: {"time_constant": (0.7, 5.0)},
        LoadRateLimit.NAME: {"rise": (15.0, 120.0), "fall": (15.0, 120.0)},
        LoadControlLag.NAME: {"time_constant": (3.0, 30.0)},
        LoadSecondOrderLag.NAME: {"time_constant": (5.0, 30.0), "second_share": (0.25, 0.5)},
        LoadControlDelay.NAME: {"delay": (3.0, 25.0)},
        ProbeLag.NAME: {"time_constant": (1.5, 12.0)},
        ClockShift.NAME: {"delay": (0.7, 8.0)},
        HeatSoak.NAME: {"exchange": (0.015, 0.08), "time_constant": (8.0, 120.0)},
    }
)
"""Coefficients by effect, from and to, evenly in the logarithm. Judgement within the ranges that the effects state."""
ACCELERATION_S = (1.0, 8.0)
"""I ω²/P at the design point of a shaft, from and to: Walsh and Fletcher, Gas Turbine Performance, ch. 8, spools from
idle to rating in some seconds."""
EITHER_SIGN = (ClockShift.NAME,)
"""Effects that are drawn with both signs: a clock may be ahead."""


def drawable_memories(engine: Engine) -> list[Effect]:
    """Every effect with memory that can be concealed here: of inertias only that of the rotor whose speed sets the
    power. Another's speed is held, or follows from its inertia record by record: a simulation in time, not a tape."""
    found = [e for e in candidate_effects(engine) if MOMENT in e.term.INPUTS]
    driven = engine.network.speed_columns.get(engine.power_setting)
    return [e for e in found if not isinstance(e.term, RotorInertia) or e.site.name == driven]


def draw_memories(engine: Engine, count: int, rng: np.random.Generator) -> tuple[tuple[Effect, ...], dict[str, float]]:
    """So many effects of different kinds, and their coefficients by parameter; nothing is drawn for none."""
    library = drawable_memories(engine)
    kinds = list(dict.fromkeys(e.term.NAME for e in library))
    effects: list[Effect] = []
    values: dict[str, float] = {}
    for k in rng.choice(len(kinds), count, replace=False) if count else ():
        own = [e for e in library if e.term.NAME == kinds[int(k)]]
        effect = own[int(rng.integers(len(own)))]
        effects.append(effect)
        for c in effect.term.amplitudes():
            values[effect.parameter_name(c.name)] = _size(engine, effect, c, rng)
    return tuple(effects), values


def _size(engine: Engine, effect: Effect, c: Coefficient, rng: np.random.Generator) -> float:
    if isinstance(effect.term, RotorInertia):
        assert engine.network.design_point is not None
        shaft = engine.network.design_point.shafts[effect.site.name]
        omega = RAD_S_PER_RPM * scalar(shaft.speed_rpm)
        return _log_uniform(*ACCELERATION_S, rng) * scalar(shaft.supply_W) / omega**2
    # of an effect that this file does not know, the size that it calls typical
    low, high = SIZES.get(effect.term.NAME, {}).get(c.name, (0.5 * c.typical, c.typical))
    sign = rng.choice((-1.0, 1.0)) if effect.term.NAME in EITHER_SIGN else 1.0
    return float(np.clip(sign * _log_uniform(low, high, rng), c.lower, c.upper))


def _log_uniform(low: float, high: float, rng: np.random.Generator) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


SELDOM = 0.1
"""Weight of an effect whose λ, at the largest size that is drawn, is below 25 on a set of flights with exact maps."""

VISIBLE = 25.0
"""λ from which a cause counts as visible: five standard deviations."""


def drawable_effects(engine: Engine) -> list[Effect]:
    """Every term at every site that can act on this engine with what its recordings hold."""
    known = {*engine.inputs, *engine.optional_inputs, *hour_columns()}
    return [e for e in candidate_effects(engine) if set(e.term.INPUTS) <= known]


@lru_cache(maxsize=4)
def draw_weights(path: str, largest: float) -> dict[str, float]:
    """Label of each drawable effect of the engine file → weight; `largest`: largest size drawn, over the typical."""
    engine = load_engine(path)
    library = drawable_effects(engine)
    flights, training = draw_flights(engine, np.random.default_rng(0))
    found = noise_free_fit(engine, flights[:training], 0.0)
    result = {}
    for s in option_scores(found, Projection(found), [effect_option(e) for e in library]):
        first = s.option.hypothesis.effects[0].term.amplitudes()[0]
        size = largest * (first.typical - first.absent)
        result[s.option.label] = 1.0 if (s.score.length * size) ** 2 >= VISIBLE else SELDOM
    return result


def noise_free_fit(
    engine: Engine,
    flights: Sequence[Mapping[str, np.ndarray]],
    model_error: float,
    read: np.ndarray | None = None,
) -> IdentifiedHypothesis:
    """The engine as its file says, flown without noise and fitted. `read` (N, m): what its sensors read instead, over
    all flights, where the truth is another engine."""
    recorded, first = [], 0
    for j, f in enumerate(flights):
        if read is None:
            p = engine.predict({c: f[c] for c in engine.inputs})
            y = np.where(p.ok[:, None], p.y, np.nan)
        else:
            y = read[first : first + len(f["time_s"])]
            first += len(y)
        recorded.append(Flight(f"flight_{j + 1}", "", {**f, **dict(zip(engine.sensors, y.T, strict=True))}))
    evidence = build_dataset(engine, recorded, MismatchQuery(model_error=model_error, drivers=hour_columns()))
    return identify_with(evidence, NULL_HYPOTHESIS, nuisance(evidence))


def true_readings(
    truth: Engine, flights: Sequence[Mapping[str, np.ndarray]], theta: Mapping[str, float | np.ndarray]
) -> np.ndarray:
    """What an engine's sensors read without noise over all flights (N, m), NaN where it has no solution."""
    u = stack_flights(flights)
    p = truth.predict({c: u[c] for c in (*truth.inputs, *truth.optional_inputs) if c in u}, theta)
    return np.where(p.ok[:, None], p.y, np.nan)


def check_engine(path: str) -> None:
    """Raises DataError, or ConfigError of the engine file, for an engine that cannot."""
    engine = load_engine(path)
    check_flyable(engine)
    silent = [c for c, s in engine.sensors.items() if not s.noise_sigma > 0]
    if silent:
        raise DataError(
            f"{engine.name}: blind trials need the noise of every sensor; none is stated for {', '.join(silent)}"
        )
    if not engine.monitored or not drawable_effects(engine):
        raise DataError(f"{engine.name}: nothing to conceal: no monitored parameter, or no effect that can act")
