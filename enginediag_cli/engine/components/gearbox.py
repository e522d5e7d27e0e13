"""Gearbox: two shafts that turn together at a fixed ratio (geared fan, propeller gearbox)."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import NAME, Component, Design
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter
from enginediag_cli.units import RAD_S_PER_RPM


class Gearbox(Component):
    """N_driven = N_driving / ratio; P_driving = P_driven / η.

    P_driven is all that the driven shaft takes: its compressors, loads, propellers, off-take and bearings. The ratio is
    that of the shafts' design speeds. A gearbox stands behind everything on the shaft that it drives and before
    the turbine of the one that drives it, whose pressure ratio then follows.
    """

    TYPE = "gearbox"
    SECTION = Section(
        "gearbox",
        "couples two shafts at a ratio",
        (
            NAME,
            Field("shaft", "text", "shaft that drives it"),
            Field("drives", "text", "shaft that it drives; that has no turbine, and no speed of its own"),
            Field(
                "ratio",
                "number",
                "driving over driven speed; default: that of the shafts' design speeds, with which it must agree",
                None,
                minimum=0.01,
                maximum=100.0,
            ),
            Field("efficiency", "number", "power out over power in", 0.99, minimum=0.5, maximum=1.0),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "efficiency",
                Design(self.values["efficiency"], 0.005, 0.5, 1.0),
                "1",
                "power out over power in",
                wear=-1,
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        name = self.values["drives"]
        driven, driving = e.shaft(name), e.shaft(self.values["shaft"])
        out = (driven.demand_W + driven.load_W + e[f"{name}.power_offtake_W"]) / e[f"{name}.mechanical_efficiency"]
        taken = out / e[f"{self.name}.efficiency"]
        driving.load_W = driving.load_W + taken
        e.outputs[f"{self.name}_torque_N_m"] = out / (driven.speed_rpm * RAD_S_PER_RPM)
        e.outputs[f"{self.name}_power_W"] = out
