"""A grid of operating conditions over an engine's envelope, without those in which nothing can fly."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np

from enginediag_cli.engine.atmosphere import standard_atmosphere

STEPS = {"altitude_m": 5, "mach": 5, "dT_isa_K": 1}
"""Values over the envelope: fine where the sensitivities change most, one where they hardly do. The product is what the
advice costs."""
OTHER_STEPS = 4
"""Values of any other input, and of a power setting without a range."""
POWER = (0.3, 0.5, 0.75, 1.0)
"""Fractions of the power range that a crew would hold for a while."""
SLOWEST, FASTEST = 70.0, 190.0
"""Equivalent airspeeds, m/s, between which an aircraft flies; on the ground it may stand."""
GROUND_M = 300.0
"""Below this altitude the engine may run on the ground, at any speed."""


def conditions_grid(engine: Any) -> dict[str, np.ndarray]:
    """Inputs of the engine, column -> (C,), over its envelope; empty when the engine file gives no envelope."""
    envelope = dict(engine.envelope)
    power = engine.power_setting
    columns = [c for c in engine.inputs if c != power]
    if any(c not in envelope for c in columns) or (engine.power_range is None and power not in envelope):
        return {}
    axes = []
    for column in columns:
        low, high = envelope[column]
        steps = STEPS.get(column, OTHER_STEPS)
        axes.append([0.5 * (low + high)] if steps == 1 else np.linspace(low, high, steps).tolist())
    if engine.power_range is not None:
        axes.append(list(POWER))
    else:
        low, high = envelope[power]
        axes.append(np.linspace(low, high, OTHER_STEPS).tolist())
    points = np.array(list(product(*axes)))
    inputs = {column: points[:, j] for j, column in enumerate(columns)}
    inputs[power] = points[:, -1]
    if engine.power_range is not None:
        inputs[power] = np.asarray(engine.power_from_fraction(points[:, -1], inputs))
        low, high = envelope.get(power, (-np.inf, np.inf))
        inputs[power] = np.clip(inputs[power], low, high)
    flyable = _flyable(inputs)
    return {column: inputs[column][flyable] for column in engine.inputs}


def _flyable(inputs: dict[str, np.ndarray]) -> np.ndarray:
    """Points (C,) at which the dynamic pressure is that of flight: ½ γ p M² = ½ ρ₀ EAS²."""
    size = len(next(iter(inputs.values())))
    if "altitude_m" not in inputs or "mach" not in inputs:
        return np.ones(size, bool)
    pressure = np.asarray(standard_atmosphere(inputs["altitude_m"])[1])
    speed = inputs["mach"] * np.sqrt(1.4 * pressure / 1.225)
    return (speed <= FASTEST) & ((speed >= SLOWEST) | (inputs["altitude_m"] < GROUND_M))
