"""Recordings that move, for blind trials of kind dynamic: steps, ramps, slams and staircases of power, once a second.

What the engine is told is drawn, not how it gets there: the truth is the quasi-steady network with what it conceals
on the tape of each recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.validation.blind.flights import DAY_SIGMA_K, GOVERNED, check_engine, hour_columns, hours_at_flights

STEP_S = 1.0
"""Between records: what a continuous recorder keeps."""
TRAINING, HELD_BACK = (3, 5), 2  # flights
RECORDS = (120, 300)
"""Of a flight, from and to: some minutes. Judgement: as many as show what passes in seconds and in a minute or two, and
no more than a trial can afford."""
POWER = (0.25, 1.0)
"""Fractions of the power range that levels lie between."""
LEAST_CHANGE = 0.2
"""Of the power range, between one level and the next: less than that moves nothing that could be told."""
HOLD_S, RAMP_S, SLAM_S, STAIR_S = (10.0, 60.0), (10.0, 60.0), (6.0, 20.0), (6.0, 20.0)
"""A level's length, a ramp's, how long a slam stays up, a stair's, from and to. Judgement: test beds and circuits."""
STAIRS = (3, 5)
"""Of a staircase, from and to: with fewer it is a step, with more a flight is over."""
AT_ONCE_S, SPEED_S = 1.0, 8.0
"""In which a change at once is over: of what is commanded from one record to the next; of a rotor's speed over the
whole range in what a spool takes to accelerate, since no rotor steps."""
DRIFT_S = (60.0, 400.0)
"""Periods of what drifts beside the power: altitude, Mach, weather, the speed that a governor holds."""
ALTITUDE_M, MACH, WEATHER_K, WEATHER_PA = 150.0, 0.015, 0.7, 60.0
"""Amplitudes of these drifts within a flight."""
LEVELS, SPEEDS = (0.05, 0.85), (0.4, 0.85)
"""Share of the ceiling, and of the fastest Mach of the envelope, at which an aircraft flies its flight."""


def draw_moving_flights(engine: Engine, rng: np.random.Generator) -> tuple[list[dict[str, np.ndarray]], int]:
    """Columns (N,) of every flight: time, the engine's inputs, hours; and how many flights are not held back. No
    record fails for what is drawn here: levels keep within the range of power and of the envelope.

    Raises DataError as `draw_flights` does.
    """
    check_engine(engine)
    training = int(rng.integers(TRAINING[0], TRAINING[1] + 1))
    count = training + HELD_BACK
    hours = {c: hours_at_flights(count, rng) for c in hour_columns()}
    flights = []
    for k in range(count):
        time = STEP_S * np.arange(int(rng.integers(RECORDS[0], RECORDS[1] + 1)))
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

    def to(new: float, seconds: float) -> None:
        nonlocal t, level
        t, level = t + max(seconds, at_once_s * abs(new - level), AT_ONCE_S), new
        corners.append((t, level))

    hold(rng.uniform(*HOLD_S))
    manoeuvres: Sequence[Callable[[], None]] = (
        lambda: to(_other(level, rng), 0.0),
        lambda: to(_other(level, rng), rng.uniform(*RAMP_S)),
        lambda: _slam(level, to, hold, rng),
        lambda: _staircase(level, to, hold, rng),
    )
    while t < time[-1]:
        manoeuvres[int(rng.integers(len(manoeuvres)))]()
        hold(rng.uniform(*HOLD_S))
    at, values = np.array(corners).T
    return np.interp(time, at, values)


def _slam(
    level: float, to: Callable[[float, float], None], hold: Callable[[float], None], rng: np.random.Generator
) -> None:
    """To another level at once, and back before everything has settled."""
    to(_other(level, rng), 0.0)
    hold(rng.uniform(*SLAM_S))
    to(level, 0.0)


def _staircase(
    level: float, to: Callable[[float, float], None], hold: Callable[[float], None], rng: np.random.Generator
) -> None:
    stairs = int(rng.integers(STAIRS[0], STAIRS[1] + 1))
    for step in np.linspace(level, _other(level, rng), stairs + 1)[1:]:
        to(float(step), 0.0)
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
    for c, amplitude in (("ambient_temperature_K", WEATHER_K), ("ambient_pressure_Pa", WEATHER_PA)):
        low, high = engine.envelope.get(c, {"ambient_temperature_K": (263.0, 313.0)}.get(c, (97000.0, 104000.0)))
        found[c] = rng.uniform(0.75 * low + 0.25 * high, 0.25 * low + 0.75 * high) + _drift(time, amplitude, rng)
    return found


def _drift(time: np.ndarray, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """A slow wave (N,) of an amplitude."""
    return amplitude * np.sin(2.0 * np.pi * (time / rng.uniform(*DRIFT_S) + rng.random()))


def _limits(engine: Engine, column: str) -> tuple[float, float]:
    return engine.envelope.get(column, (-np.inf, np.inf))
