"""Afterburner: fuel burnt in gas that a burner has burnt in already, behind a turbine or between two."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, TO, Actuator, scalar
from enginediag_cli.engine.components.burner import Combustor, burnt, heating_fuel
from enginediag_cli.engine.dual import Dual, Value, chain, select, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow, at_impulse, at_mach, kept, static_pressure
from enginediag_cli.engine.gas import T_FIT
from enginediag_cli.parameters import spelled

LARGEST_FAR = 0.07
"""Upper stop of fuel over air: no fuel burns beyond it."""
FUEL_ITERATIONS = 60
"""Of the fixed point of the fuel that an exit temperature needs, which gains a digit or more an iteration."""
SETTLED = 1e-14
"""Relative change of that fuel at which it has settled; rounding moves it by less."""
SETTINGS: dict[str, tuple[str, str, float | None, str]] = {
    "fuel_air_ratio": ("fuel_air_ratio", "1", LARGEST_FAR, "fuel–air ratio"),
    "fuel_flow": ("fuel_kg_s", "kg/s", None, "fuel flow"),
    "exit_temperature": ("exit_temperature_K", "K", T_FIT[1], "exit temperature"),
}
"""What may be set: quantity of the actuator, its unit, its upper stop where every engine has the same, and words."""


class Afterburner(Combustor):
    """W_out h_out = W h + W_f (η LHV), enthalpies from 298.15 K; P_out = P (1 − loss) × heating loss.

    Its fuel is an actuator that stands at zero, where it is a duct with the same loss: fuel over the dry air that
    enters, a flow, or the exit temperature that the fuel shall reach (no fuel where the gas is as hot). Heating in a
    constant area costs total pressure (Rayleigh): W V + p A is the same before and behind it. `Wf_kg_s` remains the
    fuel of the burner; Wf_total_kg_s is all fuel, and SFC is told with it.
    """

    TYPE = "afterburner"
    SECTION = Section(
        "afterburner",
        "second burner, lit or not",
        (
            NAME,
            FROM,
            TO,
            Field(
                "set_by",
                "choice",
                "what its actuator is: <name>.fuel_air_ratio, <name>.fuel_kg_s or <name>.exit_temperature_K",
                "fuel_air_ratio",
                choices=tuple(SETTINGS),
            ),
            Field(
                "upper_stop",
                "number",
                "of its actuator, in its unit; fuel_flow needs one; default 0.07 of fuel over air, and 2400 K",
                None,
                minimum=0.0,
            ),
            Field(
                "exit_temperature_K",
                "number",
                "total temperature at the design point; default: not lit there",
                None,
                unit="K",
                minimum=500.0,
                maximum=T_FIT[1],
            ),
            Field(
                "combustion_efficiency", "number", "share of the heating value released", 0.9, minimum=0.3, maximum=1.0
            ),
            Field("pressure_loss", "number", "ΔP/P, lit or not", 0.03, minimum=0.0, maximum=0.3),
            Field(
                "inlet_mach",
                "number",
                "Mach number at its inlet at the design point, for the loss by heating; default: no such loss",
                None,
                minimum=0.02,
                maximum=0.6,
            ),
            Field("lower_heating_value_J_kg", "number", "of the fuel at 298.15 K", 42.8e6, unit="J/kg", minimum=1e6),
        ),
    )
    area_m2 = 1.0
    efficiency_sigma = 0.02

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        self.quantity, self.unit, most, self.words = SETTINGS[self.values["set_by"]]
        stop = self.values["upper_stop"] or most
        if stop is None:
            raise ValueError(f"{self.name}: set_by fuel_flow needs an upper_stop, the largest fuel flow in kg/s")
        self.upper_stop: float = stop

    def actuators(self) -> tuple[Actuator, ...]:
        return (
            Actuator(
                f"{self.name}.{self.quantity}",
                self.unit,
                0.0,
                0.0,
                self.upper_stop,
                f"{spelled(self.name)} {self.words}",
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        setting = e[f"{self.name}.{self.quantity}"]
        if self.quantity == "fuel_kg_s":
            fuel = setting
        elif self.quantity == "fuel_air_ratio":
            fuel = setting * (inlet.W / inlet.mixture.per_dry_air())
        else:
            fuel = fuel_for(inlet, setting, self.released(e))
        self._deliver(e, inlet, fuel)

    def _deliver(self, e: Evaluation, inlet: Flow, fuel: Value) -> None:
        cold = inlet.with_(P=inlet.P * (1.0 - e[f"{self.name}.pressure_loss"]))
        hot = burnt(inlet, fuel, self.released(e), cold.P)
        off = np.broadcast_to(np.asarray(value(fuel) == 0.0), (e.size,))
        if off.any():
            hot = Flow(hot.gas, hot.mixture, hot.W, hot.P, h=kept(off, cold.h, hot.h))
        if self.values["inlet_mach"] is not None:
            hot = self._heated(cold, hot, off)
        far = hot.mixture.far
        assert far is not None  # it has been burnt in
        rich = np.asarray(value(far) > e.gas.stoichiometric_far)
        e.mark_outside(self.name, np.broadcast_to(rich, (e.size,)), f"what the air of {self.name} can burn")
        e.flows[self.values["to"]] = hot
        e.outputs[f"{self.name}_fuel_kg_s"] = fuel
        e.outputs["Wf_total_kg_s"] = e.outputs.get("Wf_total_kg_s", e.outputs["Wf_kg_s"]) + fuel

    def _heated(self, cold: Flow, hot: Flow, off: np.ndarray) -> Flow:
        """The flow behind heating in a constant area; NaN where the heat chokes it."""
        p, V = static_pressure(cold, self.area_m2)
        behind, subsonic = at_impulse(hot, cold.W * V + p * self.area_m2, self.area_m2)
        return behind.with_(P=kept(off, cold.P, select(subsonic, behind.P, behind.P * np.nan)))

    def size(self, e: Evaluation) -> None:
        v = self.values
        inlet = e.flows[v["from"]]
        if v["inlet_mach"] is not None:
            self.area_m2 = scalar(at_mach(inlet.with_(P=inlet.P * (1.0 - v["pressure_loss"])), v["inlet_mach"])[1])
        if v["exit_temperature_K"] is None:
            self.evaluate(e)
            return
        if not v["exit_temperature_K"] > scalar(inlet.T):
            raise ValueError(
                f"{self.name}: the gas enters at {scalar(inlet.T):.0f} K at design, which is above its "
                f"exit_temperature_K, {v['exit_temperature_K']:.0f} K; leave that out for an afterburner that is not "
                "lit there"
            )
        fuel = fuel_for(inlet, inlet.T * 0.0 + v["exit_temperature_K"], self.released(e))
        far = scalar(fuel / (inlet.W / inlet.mixture.per_dry_air()))
        there = 0.0 if inlet.mixture.far is None else scalar(inlet.mixture.far)
        if not far + there <= e.gas.stoichiometric_far:
            raise ValueError(
                f"{self.name}: its air cannot burn the fuel that {v['exit_temperature_K']:.0f} K needs: fuel–air ratio "
                f"{far + there:.4f} with the {there:.4f} that is burnt already, stoichiometric is "
                f"{e.gas.stoichiometric_far:.4f}"
            )
        self._deliver(e, inlet, fuel)


def fuel_for(inlet: Flow, exit_temperature_K: Value, released: Value) -> Value:
    """Fuel [kg/s] (N,) that heats a flow to a temperature; none where it is as hot already. The fixed point on values,
    and one step in derivative arithmetic for the exact derivatives. NaN where there is none."""
    wanted = value(exit_temperature_K)
    lit = np.asarray(wanted > value(inlet.T))
    plain = Flow(inlet.gas, inlet.mixture.plain, value(inlet.W), value(inlet.P), h=value(inlet.h))
    heat = value(released)
    fuel: Any = np.zeros(np.broadcast_shapes(np.shape(wanted), np.shape(value(inlet.T))))
    open_still = np.broadcast_to(lit, fuel.shape)
    for _ in range(FUEL_ITERATIONS):
        last = fuel
        # a row stays as it was once it has settled, however long others take
        fuel = np.where(open_still, value(heating_fuel(plain, wanted, heat, fuel)), fuel)
        open_still = open_still & ~(np.abs(fuel - last) <= SETTLED * np.abs(fuel))
        if not open_still.any():
            break
    fuel = np.where(open_still, np.nan, fuel)
    slope = heating_fuel(plain, wanted, heat, Dual(fuel, np.ones((1, fuel.size))))
    assert isinstance(slope, Dual)
    again = heating_fuel(inlet, exit_temperature_K, released, fuel)
    return select(lit, chain(fuel, (1.0 / (1.0 - slope.d[0]), again)), 0.0)
