"""The flights that are simulated when nobody says which."""

from __future__ import annotations

from typing import Any

from enginediag_cli.config.fields import REQUIRED, Section
from enginediag_cli.engine.model import EngineLike
from enginediag_cli.simulation.airspeed import FOOT_M
from enginediag_cli.simulation.flight_file import MISSIONS
from enginediag_cli.simulation.noise_section import NOISE

AIRLINER_FLIGHTS = 5
"""Flights of an engine for which none are described: some thousand records."""
GROUND_DAYS = 30
"""Days of an engine on the ground: a month's weather."""
MARGIN_M = 100.0
"""Kept from the ceiling of the engine's envelope, so that no record is outside by rounding."""


def default_plan(engine: EngineLike) -> dict[str, Any]:
    """Values of a flight file: airliner flights within the engine's envelope, or days on the ground for an
    engine that knows no altitude."""
    flies = "altitude_m" in engine.inputs
    mission = {
        "type": "airliner" if flies else "ground",
        **_defaults(MISSIONS["airliner" if flies else "ground"].SECTION),
    }
    if flies:
        _keep_inside(mission, engine)
    return {
        "flights": AIRLINER_FLIGHTS if flies else GROUND_DAYS,
        "mission": mission,
        "constants": {},
        "noise": _defaults(NOISE),
    }


def _keep_inside(mission: dict[str, Any], engine: EngineLike) -> None:
    """Lower cruise Mach number and levels to what the engine's envelope allows, step climbs included."""
    fastest = engine.envelope.get("mach", (0.0, 1.0))[1]
    low, high = mission["cruise_mach"]
    mission["cruise_mach"] = [low * min(1.0, fastest / high), min(high, fastest)]
    steps = 60.0 * mission["cruise_duration_min"][1] // (60.0 * mission["step_interval_min"])
    ceiling = engine.envelope.get("altitude_m", (0.0, 20000.0))[1] - MARGIN_M
    highest = ceiling / FOOT_M - steps * mission["step_climb_ft"]
    mission["cruise_levels_ft"] = sorted({min(level, highest) for level in mission["cruise_levels_ft"]})


def _defaults(section: Section) -> dict[str, Any]:
    """Values of a section of which the file gives none; tuples become lists as a file would give them."""
    assert all(field.default is not REQUIRED for field in section.fields)
    return {
        field.name: list(field.default) if isinstance(field.default, tuple) else field.default
        for field in section.fields
    }
