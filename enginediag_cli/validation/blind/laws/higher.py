"""Flights four kilometres above those that were searched: where a law must hold that nobody has flown."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.validation.blind.flights import HELD_BACK, draw_flights

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
