"""Airline sensors: what a cockpit shows is all that is recorded.

Shaft speeds, fuel flow, the exhaust gas temperature, and shaft power where an engine gives shaft power: N1, N2, EGT and
fuel of a turbofan; speed, EGT and fuel of a turbojet; torque, turbine temperature and fuel of a turboshaft; power and
exhaust temperature of a power plant.
"""

from __future__ import annotations

from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.engine import Engine
from enginediag_cli.units import split_column

FUEL = "Wf_kg_s"
POWER = "power_W"


def airline_sensors(engine: Engine) -> tuple[str, ...]:
    """The sensors of the engine that a cockpit shows, in the engine's order."""
    turbines = [c for c in engine.network.components if isinstance(c, Turbine)]
    behind = [f"T{t.values['to']}_K" for t in turbines]
    hot = next((c for c in behind if c in engine.sensors), None)
    return tuple(c for c in engine.sensors if c in (FUEL, POWER, hot) or split_column(c)[1] == "rpm")
