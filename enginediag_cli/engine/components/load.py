"""Load: what a shaft drives outside the engine (generator, propeller, pump)."""

from __future__ import annotations

import math

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import NAME, Component, Design, scalar
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

RAD_S_PER_RPM = math.pi / 30.0
"""Of angular speed: a turn is 2π rad, a minute 60 s."""


class Load(Component):
    """Law `surplus`: takes what the shaft has to spare, at a speed that is given; the power is an output.

    Law `cube`: absorbs P_design (N/N_design)³ (propeller or water brake), and the balance of power
    determines the speed. Delivered power η P is the output <name>_power_W; power_W is the sum over all loads.
    """

    TYPE = "load"
    SECTION = Section(
        "load",
        "driven machine on a shaft",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("law", "choice", "what it takes", "surplus", choices=("surplus", "cube")),
            Field(
                "efficiency",
                "number",
                "delivered power over shaft power (generator, gearbox)",
                1.0,
                minimum=0.3,
                maximum=1.0,
            ),
        ),
    )
    design_power_W = 1.0
    design_speed_rpm = 1.0

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "efficiency",
                Design(self.values["efficiency"], 0.01, 0.3, 1.05, part=True),
                "1",
                "delivered over shaft power",
                wear=-1,
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        shaft = e.shaft(self.values["shaft"])
        name = self.values["shaft"]
        surplus = shaft.supply_W * e[f"{name}.mechanical_efficiency"] - shaft.demand_W - e[f"{name}.power_offtake_W"]
        if self.values["law"] == "cube":
            n = shaft.speed_rpm * (1.0 / self.design_speed_rpm)
            absorbed = n * n * n * self.design_power_W
            e.balances[f"{name} power"] = (surplus - absorbed) / shaft.supply_W
            surplus = absorbed
        delivered = surplus * e[f"{self.name}.efficiency"]
        e.outputs[f"{self.name}_torque_N_m"] = surplus / (shaft.speed_rpm * RAD_S_PER_RPM)
        e.outputs[f"{self.name}_power_W"] = delivered
        e.add_output("power_W", delivered)

    def size(self, e: Evaluation) -> None:
        shaft = e.shaft(self.values["shaft"])
        name = self.values["shaft"]
        self.design_speed_rpm = scalar(shaft.speed_rpm)
        surplus = shaft.supply_W * e[f"{name}.mechanical_efficiency"] - shaft.demand_W - e[f"{name}.power_offtake_W"]
        self.design_power_W = scalar(surplus)
        self.evaluate(e)
