"""Steps, ramps and blips of power, for rivals that remember.

Effects with memory differ by how they answer: a rate limit takes longer for a larger step, a lag does not, a delay is
late by as much on a ramp.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.engine.atmosphere import T_ISA, standard_atmosphere
from enginediag_cli.engine.engine import Engine
from enginediag_cli.planning.flight import Corner, PlannedFlight
from enginediag_cli.planning.flights import held_inputs

MANOEUVRE = "manoeuvre"
DURATION_S = 300
"""Of a manoeuvre, recorded once a second."""
BEGIN_S, STEP_S, BLIP_S = 30.0, 1.0, 10.0
"""When power begins to change, how long that takes at once, and how long a blip lasts."""

MANOEUVRES: Mapping[str, tuple[tuple[float, float], ...]] = {
    "a step of power from 10 to 90 % of its range": ((0.0, 0.1), (STEP_S, 0.9)),
    "a step of power from 90 to 10 % of its range": ((0.0, 0.9), (STEP_S, 0.1)),
    "a step of power from 45 to 55 % of its range": ((0.0, 0.45), (STEP_S, 0.55)),
    "a ramp of power from 10 to 90 % in a minute": ((0.0, 0.1), (60.0, 0.9)),
    "a ramp of power from 10 to 90 % in three minutes": ((0.0, 0.1), (180.0, 0.9)),
    "power raised from 10 to 90 % for ten seconds": (
        (0.0, 0.1),
        (STEP_S, 0.9),
        (BLIP_S, 0.9),
        (BLIP_S + STEP_S, 0.1),
    ),
}
"""What may be flown, in words, and power against seconds since BEGIN_S, straight between."""


def manoeuvres(engine: Engine, flown: Mapping[str, np.ndarray]) -> list[PlannedFlight]:
    """Manoeuvres at the middle of what was flown (inputs, column → (N,)); none for an engine of which it is not known
    how much power it may be asked for."""
    usual = held_inputs(engine, flown)
    if engine.power_range is None or usual is None:
        return []
    altitude, mach, dT = (_middle(flown, c) for c in ("altitude_m", "mach", "dT_isa_K"))
    if "ambient_temperature_K" in engine.inputs:
        dT = _middle(flown, "ambient_temperature_K", T_ISA) - float(np.asarray(standard_atmosphere(altitude)[0]))
    last = DURATION_S - 1.0
    return [
        PlannedFlight(
            MANOEUVRE,
            words,
            [
                Corner(second / last, power, altitude, mach, dT)
                for second, power in (
                    (0.0, course[0][1]),
                    *((BEGIN_S + s, p) for s, p in course),
                    (last, course[-1][1]),
                )
            ],
            usual,
            DURATION_S,
            1.0,
        )
        for words, course in MANOEUVRES.items()
    ]


def _middle(flown: Mapping[str, np.ndarray], column: str, default: float = 0.0) -> float:
    values = np.asarray(flown.get(column, ()), float)
    return float(np.nanmedian(values)) if np.isfinite(values).any() else default
