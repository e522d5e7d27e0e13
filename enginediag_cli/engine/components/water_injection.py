"""Water injection: water or steam into the gas path, before the burner or before a compressor."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import T_ISA, saturated_water
from enginediag_cli.engine.components.base import FROM, NAME, TO, Actuator, Component
from enginediag_cli.engine.dual import Dual, Value, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow, kept
from enginediag_cli.engine.gas import DRY_AIR, T_REFERENCE, Gas, Mixture
from enginediag_cli.parameters import spelled

HEAT_OF_EVAPORATION = 2.4426e6  # J/kg at 298.15 K: −241.826 and −285.830 kJ/mol of vapour and water (CODATA)
WATER_CP = 4182.0  # J/(kg K), of the liquid near room temperature


class WaterInjection(Component):
    """W_out h_out = W h + W_w h_w, water over dry air war + W_w/W_dry; the pressure stays.

    All water evaporates at once: h_w = c_w (T − 298.15 K) − 2.4426 MJ/kg of water, of steam its vapour's enthalpy. A
    point at which the air cannot hold it as vapour is marked. The flow is an actuator that stands at zero.
    """

    TYPE = "water_injection"
    SECTION = Section(
        "water_injection",
        "water or steam into the gas",
        (
            NAME,
            FROM,
            TO,
            Field(
                "largest_flow_kg_s", "number", "upper stop of its actuator <name>.flow_kg_s", unit="kg/s", minimum=1e-9
            ),
            Field("phase", "choice", "what is injected", "water", choices=("water", "steam")),
            Field("temperature_K", "number", "of the water or steam", T_ISA, unit="K", minimum=273.0, maximum=1000.0),
        ),
    )

    def actuators(self) -> tuple[Actuator, ...]:
        words = f"{spelled(self.name)} flow"
        return (Actuator(f"{self.name}.flow_kg_s", "kg/s", 0.0, 0.0, self.values["largest_flow_kg_s"], words),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        water = e[f"{self.name}.flow_kg_s"]
        e.outputs[f"{self.name}_flow_kg_s"] = water
        e.flows[self.values["to"]] = self._moist(e, inlet, water) if _any(water) else inlet.with_()

    def _moist(self, e: Evaluation, inlet: Flow, water: Value) -> Flow:
        dry = inlet.W / inlet.mixture.per_dry_air()
        already: Value = 0.0 if inlet.mixture.war is None else inlet.mixture.war
        W = inlet.W + water
        h = (inlet.W * inlet.h + water * self._enthalpy(e.gas)) / W
        off = np.broadcast_to(np.asarray(value(water) == 0.0), (e.size,))
        if off.any():
            h = kept(off, inlet.h, h)
        war = already + water / dry
        moist = Flow(inlet.gas, Mixture(inlet.mixture.far, war), W, inlet.P, h=h)
        if self.values["phase"] == "water":
            most = value(saturated_water(value(moist.T), value(moist.P)))  # negative: it boils, and there is no most
            wet = np.asarray((most > 0.0) & (value(war) > most) & ~off)
            e.mark_outside(self.name, np.broadcast_to(wet, (e.size,)), f"what air behind {self.name} holds as vapour")
        return moist

    def _enthalpy(self, gas: Gas) -> float:
        """J/kg of what is injected, from vapour at 298.15 K."""
        T = self.values["temperature_K"]
        if self.values["phase"] == "water":
            return float(WATER_CP * (T - T_REFERENCE) - HEAT_OF_EVAPORATION)
        at = np.array([T])
        both, air = (value(gas.enthalpy(at, m))[0] for m in (Mixture(war=1.0), DRY_AIR))
        return float(2.0 * both - air)  # averages by mass: one part of vapour to one of air


def _any(water: Value) -> bool:
    """Whether there is anything to reckon with: not where nothing sets it."""
    return isinstance(water, Dual) or np.ndim(water) > 0 or water != 0.0
