"""Engines and records that the tests of physics terms share."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[2] / "configs"
COLUMN_RANGES = {"hours_since_wash_h": (0.0, 2000.0), "humidity_kg_kg": (0.0, 0.012)}  # of columns without envelope


@cache
def shipped(name, given=None):
    return load_engine(CONFIGS / f"{name}.yaml", given)


def drawn(engine, n, seed, at=None):
    """Inputs (n,) drawn over the engine's envelope and corrected power range, columns of the terms included.

    The tropopause, where the atmosphere has its own kink, is left out; a given shaft's speed follows the power.
    """
    at = dict(at or {})
    rng = np.random.default_rng(seed)
    fraction = np.full(n, at.pop("power")) if "power" in at else rng.uniform(0.0, 1.0, n)
    ranges = {**COLUMN_RANGES, **engine.envelope}
    U = {}
    speeds = engine.network.speed_columns
    for column in (*engine.inputs, *engine.optional_inputs):
        low, high = ranges.get(column, (engine.optional_inputs.get(column) or 0.0,) * 2)
        U[column] = rng.uniform(low, min(high, 10500.0) if column == "altitude_m" else high, n)
        if column in speeds:
            U[column] = engine.network.shafts[speeds[column]]["design_speed_rpm"] * (0.62 + 0.4 * fraction)
        if column == "mach":
            U[column] = np.maximum(U[column], 0.02)
    U |= {c: np.full(n, v) for c, v in at.items()}
    U[engine.power_setting] = engine.power_from_fraction(fraction, U)
    return U


def own_inputs(engine, U):
    return {c: v for c, v in U.items() if c in (*engine.inputs, *engine.optional_inputs)}


__all__ = ["COLUMN_RANGES", "CONFIGS", "drawn", "own_inputs", "shipped"]
