"""Short flights for blind trials: climb, cruise and descent within the engine's envelope; of a machine that stays where
it is, some days."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import DataError
from enginediag_cli.physics.registry import term, term_names
from enginediag_cli.units import split_column
from enginediag_cli.validation.blind import ground

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
    check_engine(engine)
    stays = "altitude_m" not in engine.inputs
    draw, step = (ground.ground_days, ground.STEP_S) if stays else (_flight, STEP_S)
    training = int(rng.integers(TRAINING[0], TRAINING[1] + 1))
    count = training + HELD_BACK
    hours = {c: hours_at_flights(count, rng) for c in hour_columns()}
    flights = []
    for k in range(count):
        n = int(rng.integers(RECORDS[0], RECORDS[1] + 1))
        told = draw(engine, n, rng)
        told = {c: told[c] if c in told else _governed(engine, c, n, rng) for c in engine.inputs}
        columns = {"time_s": step * np.arange(n), **told}
        for c, start in hours.items():
            columns[c] = start[k] + columns["time_s"] / 3600.0
        flights.append(columns)
    return flights, training


def hours_at_flights(count: int, rng: np.random.Generator) -> np.ndarray:
    """Hours since a wash or a change of filter at the begin of every flight; it is done again before one of them."""
    clock = rng.uniform(*HOURS) + np.cumsum(rng.uniform(*BETWEEN_FLIGHTS_H, count))
    again = int(rng.integers(1, count))
    return np.where(np.arange(count) < again, clock, clock - clock[again] + rng.uniform(0.0, BETWEEN_FLIGHTS_H[0]))


def check_engine(engine: Engine) -> None:
    """Raises DataError for an engine that has inputs which nothing is known of, or whose power range is not stated."""
    known = (*CONDITIONS, *ground.CONDITIONS, *engine.envelope, engine.power_setting)
    odd = [c for c in engine.inputs if c not in known]
    lacking = [c for c in (CONDITIONS[:2] if "altitude_m" in engine.inputs else ground.CONDITIONS)]
    if odd or any(c not in engine.inputs for c in lacking):
        raise DataError(
            f"{engine.name}: blind trials fly an engine by {', '.join(CONDITIONS)}, or run it by "
            f"{', '.join(ground.CONDITIONS)}, and by one power setting; other inputs need a range in the engine file's "
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


def stack(flights: Sequence[Mapping[str, np.ndarray]]) -> Mapping[str, np.ndarray]:
    """Columns over all flights."""
    return {c: np.concatenate([f[c] for f in flights]) for c in flights[0]}
