"""Burner: fuel burnt in the core flow."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, TO, Component, Design, Unknown, scalar
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.gas import Mixture
from enginediag_cli.parameters import Parameter

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
        if e.has(f"{self.name}.fuel_flow"):
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


def with_fuel(inlet: Flow, fuel: Value) -> Mixture:
    """Composition of air, or of gas that is burnt already, with this fuel [kg/s] burnt in it."""
    dry = inlet.W / inlet.mixture.per_dry_air()
    far = fuel / dry if inlet.mixture.far is None else inlet.mixture.far + fuel / dry
    return Mixture(far, inlet.mixture.war)


def burnt(inlet: Flow, fuel: Value, released: Value, P: Value) -> Flow:
    """A flow with fuel [kg/s] burnt in it that releases `released` [J/kg] above 298.15 K, at pressure P [Pa]."""
    W = inlet.W + fuel
    h = (inlet.W * inlet.h + fuel * released) / W
    return Flow(inlet.gas, with_fuel(inlet, fuel), W, P, h=h)


def heating_fuel(inlet: Flow, exit_temperature_K: Value, released: Value, fuel: Value) -> Value:
    """Fuel [kg/s] that heats a flow to a temperature, its gas of the composition that another fuel makes: a fixed point
    of it is the fuel that does."""
    h4 = inlet.gas.enthalpy(inlet.W * 0.0 + exit_temperature_K, with_fuel(inlet, fuel))
    return inlet.W * (h4 - inlet.h) / (released - h4)
