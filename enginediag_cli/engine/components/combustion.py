"""Components that heat or cool the gas by what they add to it: burner, afterburner, water injection.

A burner burns fuel in the core flow. An afterburner burns fuel in gas that has passed a burner already, behind a
turbine or between two. Water injection adds water or steam before the burner or before a compressor.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, TO, Actuator, Component, Design, Unknown, scalar
from enginediag_cli.engine.dual import Dual, Value, chain, select, sqrt, value
from enginediag_cli.engine.evaluation import (
    T_ISA,
    Evaluation,
    Flow,
    expand_to_mach,
    keep_old_values,
    saturated_water,
    solve_impulse,
    static_pressure,
)
from enginediag_cli.engine.gas import DRY_AIR, T_FIT, T_REFERENCE, Gas, Mixture
from enginediag_cli.parameters import Parameter, spelled

SIZING_ITERATIONS = 80
"""The fixed point gains a digit or more an iteration, sixteen are wanted; more is an exit temperature that no fuel
gives."""


class Combustor(Component):
    """What every burner has: heat that its fuel releases, and a loss of pressure.

    `efficiency_sigma`: how far its combustion efficiency plausibly lies from what is stated.
    """

    efficiency_sigma = 0.01

    def parameters(self) -> tuple[Parameter, ...]:
        v, sigma = self.values, self.efficiency_sigma
        return (
            self.health("efficiency", "combustion efficiency, factor", sigma, words="combustion efficiency", wear=-1),
            self.design(
                "pressure_loss",
                Design(v["pressure_loss"], 0.01, 0.0, 0.3, part=True),
                "1",
                "ΔP/P",
            ),
            self.design(
                "lower_heating_value_J_kg",
                Design(v["lower_heating_value_J_kg"], 0.3e6, 1e6, 150e6),
                "J/kg",
                "lower heating value of the fuel",
                words="lower heating value",
            ),
        )

    def released(self, e: Evaluation) -> Value:
        """Heat of a kilogram of fuel (N,) above 298.15 K, J/kg."""
        share = e[f"{self.name}.efficiency"] * self.values["combustion_efficiency"]
        return e[f"{self.name}.lower_heating_value_J_kg"] * share


class Burner(Combustor):
    """W₄ h₄ = W₃ h₃ + W_f (η LHV), enthalpies from 298.15 K; P₄ = P₃ (1 − loss).

    The fuel flow is an input when it is the power setting, else unknown, solved for as corrected flow
    W_f/(δ₂ √θ₂) relative to design.
    """

    TYPE = "burner"
    SECTION = Section(
        "burner",
        "combustor",
        (
            NAME,
            FROM,
            TO,
            Field(
                "exit_temperature_K",
                "number",
                "total temperature at the design point",
                unit="K",
                minimum=500.0,
                maximum=2400.0,
            ),
            Field(
                "combustion_efficiency",
                "number",
                "share of the heating value released",
                0.995,
                minimum=0.5,
                maximum=1.0,
            ),
            Field("pressure_loss", "number", "ΔP/P", 0.05, minimum=0.0, maximum=0.3),
            Field("lower_heating_value_J_kg", "number", "of the fuel at 298.15 K", 42.8e6, unit="J/kg", minimum=1e6),
        ),
    )
    corrected_fuel_kg_s = 1.0

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.corrected_fuel", lower=0.01, upper=5.0),)

    def evaluate(self, e: Evaluation) -> None:
        if e.has_leaf(f"{self.name}.fuel_flow"):
            fuel = e[f"{self.name}.fuel_flow"]
        else:
            fuel = e[f"{self.name}.corrected_fuel"] * (e.delta2 * sqrt(e.theta2) * self.corrected_fuel_kg_s)
        v = self.values
        inlet = e.flows[v["from"]]
        e.flows[v["to"]] = burnt(inlet, fuel, self.released(e), inlet.P * (1.0 - e[f"{self.name}.pressure_loss"]))
        e.outputs["Wf_kg_s"] = fuel

    def size(self, e: Evaluation) -> None:
        """Finds the fuel that gives the design exit temperature, by fixed-point iteration on the heat balance."""
        v = self.values
        inlet = e.flows[v["from"]]
        fuel = 0.02 * inlet.W
        released = v["lower_heating_value_J_kg"] * v["combustion_efficiency"]
        for _ in range(SIZING_ITERATIONS):
            last, fuel = fuel, heating_fuel(inlet, v["exit_temperature_K"], released, fuel)
            if abs(scalar(fuel) - scalar(last)) <= 1e-14 * abs(scalar(fuel)):
                break
        else:
            raise ValueError(f"{self.name}: no fuel flow gives {v['exit_temperature_K']:.0f} K at its exit")
        self.corrected_fuel_kg_s = scalar(fuel / (e.delta2 * sqrt(e.theta2)))
        self.evaluate(e)


def burn(inlet: Flow, fuel: Value) -> Mixture:
    """Composition of air, or of gas that is burnt already, with this fuel [kg/s] burnt in it."""
    dry = inlet.W / inlet.mixture.per_dry_air()
    far = fuel / dry if inlet.mixture.far is None else inlet.mixture.far + fuel / dry
    return Mixture(far, inlet.mixture.war)


def burnt(inlet: Flow, fuel: Value, released: Value, P: Value) -> Flow:
    """A flow with fuel [kg/s] burnt in it that releases `released` [J/kg] above 298.15 K, at pressure P [Pa]."""
    W = inlet.W + fuel
    h = (inlet.W * inlet.h + fuel * released) / W
    return Flow(inlet.gas, burn(inlet, fuel), W, P, h=h)


def heating_fuel(inlet: Flow, exit_temperature_K: Value, released: Value, fuel: Value) -> Value:
    """Fuel [kg/s] that heats a flow to a temperature, its gas of the composition that another fuel makes: a fixed point
    of it is the fuel that does."""
    h4 = inlet.gas.enthalpy(inlet.W * 0.0 + exit_temperature_K, burn(inlet, fuel))
    return inlet.W * (h4 - inlet.h) / (released - h4)


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

    Its fuel is an actuator that is normally zero, where it is a duct with the same loss: fuel over the dry air that
    enters, a flow, or the exit temperature that the fuel shall reach (no fuel where the gas is as hot). Heating in a
    constant area costs total pressure (Rayleigh): W V + p A is the same before and behind it. `Wf_kg_s` remains the
    fuel of the burner; Wf_total_kg_s is all fuel, and SFC is computed with it.
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
            fuel = find_fuel(inlet, setting, self.released(e))
        self._deliver(e, inlet, fuel)

    def _deliver(self, e: Evaluation, inlet: Flow, fuel: Value) -> None:
        cold = inlet.replace(P=inlet.P * (1.0 - e[f"{self.name}.pressure_loss"]))
        hot = burnt(inlet, fuel, self.released(e), cold.P)
        off = np.broadcast_to(np.asarray(value(fuel) == 0.0), (e.size,))
        if off.any():
            hot = Flow(hot.gas, hot.mixture, hot.W, hot.P, h=keep_old_values(off, cold.h, hot.h))
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
        behind, subsonic = solve_impulse(hot, cold.W * V + p * self.area_m2, self.area_m2)
        return behind.replace(P=keep_old_values(off, cold.P, select(subsonic, behind.P, behind.P * np.nan)))

    def size(self, e: Evaluation) -> None:
        v = self.values
        inlet = e.flows[v["from"]]
        if v["inlet_mach"] is not None:
            self.area_m2 = scalar(
                expand_to_mach(inlet.replace(P=inlet.P * (1.0 - v["pressure_loss"])), v["inlet_mach"])[1]
            )
        if v["exit_temperature_K"] is None:
            self.evaluate(e)
            return
        if not v["exit_temperature_K"] > scalar(inlet.T):
            raise ValueError(
                f"{self.name}: the gas enters at {scalar(inlet.T):.0f} K at design, which is above its "
                f"exit_temperature_K, {v['exit_temperature_K']:.0f} K; leave that out for an afterburner that is not "
                "lit there"
            )
        fuel = find_fuel(inlet, inlet.T * 0.0 + v["exit_temperature_K"], self.released(e))
        far = scalar(fuel / (inlet.W / inlet.mixture.per_dry_air()))
        there = 0.0 if inlet.mixture.far is None else scalar(inlet.mixture.far)
        if not far + there <= e.gas.stoichiometric_far:
            raise ValueError(
                f"{self.name}: its air cannot burn the fuel that {v['exit_temperature_K']:.0f} K needs: fuel–air ratio "
                f"{far + there:.4f} with the {there:.4f} that is burnt already, stoichiometric is "
                f"{e.gas.stoichiometric_far:.4f}"
            )
        self._deliver(e, inlet, fuel)


def find_fuel(inlet: Flow, exit_temperature_K: Value, released: Value) -> Value:
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


HEAT_OF_EVAPORATION = 2.4426e6  # J/kg at 298.15 K: −241.826 and −285.830 kJ/mol of vapour and water (CODATA)
WATER_CP = 4182.0  # J/(kg K), of the liquid near room temperature


class WaterInjection(Component):
    """W_out h_out = W h + W_w h_w, water over dry air war + W_w/W_dry; the pressure stays.

    All water evaporates at once: h_w = c_w (T − 298.15 K) − 2.4426 MJ/kg of water, of steam its vapour's enthalpy. A
    point at which the air cannot hold it as vapour is marked. The flow is an actuator that is normally zero.
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
        e.flows[self.values["to"]] = self._moist(e, inlet, water) if _has_water(water) else inlet.replace()

    def _moist(self, e: Evaluation, inlet: Flow, water: Value) -> Flow:
        dry = inlet.W / inlet.mixture.per_dry_air()
        already: Value = 0.0 if inlet.mixture.war is None else inlet.mixture.war
        W = inlet.W + water
        h = (inlet.W * inlet.h + water * self._enthalpy(e.gas)) / W
        off = np.broadcast_to(np.asarray(value(water) == 0.0), (e.size,))
        if off.any():
            h = keep_old_values(off, inlet.h, h)
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


def _has_water(water: Value) -> bool:
    """Whether there is anything to reckon with: not where nothing sets it."""
    return isinstance(water, Dual) or np.ndim(water) > 0 or water != 0.0
