"""Days of a machine that stays where it is, for blind trials: weather, base load by day and part load at night."""

from __future__ import annotations

import numpy as np

from enginediag_cli.engine.engine import Engine

CONDITIONS = ("ambient_pressure_Pa", "ambient_temperature_K")
STEP_S = 3600.0
"""Between records: hourly averages, as public recordings of such machines are."""
DAY_SIGMA_K, SWING_K, WEATHER_K = 5.0, (3.0, 7.0), 1.0
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
    mean = np.clip(0.5 * (low + high) + DAY_SIGMA_K * rng.standard_normal(), low + 8.0, high - 8.0)
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
