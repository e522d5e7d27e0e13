"""Ambient: the air around the engine and its motion relative to it."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import standard_atmosphere
from enginediag_cli.engine.components.base import NAME, TO, Component
from enginediag_cli.engine.dual import Dual, Value, exp, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.gas import DRY_AIR, Mixture


class Ambient(Component):
    """Static and total conditions from altitude, Mach number and ISA deviation, or from measured air.

    T0 = T_ISA(h) + ΔT_ISA, V0 = M √(γ R T0), total enthalpy h0 + V0²/2, total pressure by isentropic
    stagnation. Humidity is kg of water vapour per kg of dry air.
    """

    TYPE = "ambient"
    SECTION = Section(
        "ambient",
        "air around the engine",
        (
            NAME,
            TO,
            Field(
                "conditions",
                "choice",
                "flight: altitude_m, mach, dT_isa_K are inputs; ground: ambient_pressure_Pa and ambient_temperature_K",
                "flight",
                choices=("flight", "ground"),
            ),
        ),
    )

    def inputs(self) -> dict[str, float | None]:
        if self.values["conditions"] == "ground":
            return {"ambient_pressure_Pa": None, "ambient_temperature_K": None, "humidity_kg_kg": 0.0}
        return {"altitude_m": None, "mach": None, "dT_isa_K": None, "humidity_kg_kg": 0.0}

    def evaluate(self, e: Evaluation) -> None:
        mixture = DRY_AIR
        humidity = e["humidity_kg_kg"]
        if isinstance(humidity, Dual) or np.any(np.asarray(value(humidity)) != 0.0):
            mixture = Mixture(war=humidity)
        if self.values["conditions"] == "ground":
            T0: Value = e["ambient_temperature_K"]
            P0: Value = e["ambient_pressure_Pa"]
            V0: Value = 0.0
            total = Flow(e.gas, mixture, 0.0, P0, T=T0)
        else:
            T0, P0 = standard_atmosphere(e["altitude_m"])
            T0 = T0 + e["dT_isa_K"]
            static = Flow(e.gas, mixture, 0.0, P0, T=T0)
            cp, R = e.gas.heat_capacity(T0, mixture), static.R
            V0 = e["mach"] * sqrt(cp / (cp - R) * (R * T0))
            total = Flow(e.gas, mixture, 0.0, P0, h=static.h + 0.5 * (V0 * V0))
            total.P = P0 * exp((total.phi - static.phi) / R)
        e.outputs["P0_Pa"], e.outputs["T0_K"], e.outputs["V0_m_s"] = P0, T0, V0
        e.flows[self.values["to"]] = total
