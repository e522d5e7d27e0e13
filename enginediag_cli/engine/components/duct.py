"""Duct: total pressure loss, and bleed air that returns to the gas path."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, TO, Component, Design, scalar
from enginediag_cli.engine.dual import sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import mix
from enginediag_cli.parameters import Parameter


class Duct(Component):
    """P_out = P_in (1 − loss); the loss is constant or ∝ (W√T/P)², the dynamic pressure at low Mach number."""

    TYPE = "duct"
    SECTION = Section(
        "duct",
        "pressure loss between two stations",
        (
            NAME,
            FROM,
            TO,
            Field("pressure_loss", "number", "ΔP/P at the design point", minimum=0.0, maximum=0.5),
            Field("law", "choice", "how the loss varies", "constant", choices=("constant", "corrected_flow_squared")),
            Field("receives", "texts", "names of bleeds that mix in before the loss", ()),
        ),
    )
    flow_parameter = 1.0

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "pressure_loss",
                Design(self.values["pressure_loss"], 0.005, 0.0, 0.5, part=True),
                "1",
                "ΔP/P at design",
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        inlet = mix(e.flows[self.values["from"]], *(e.bleeds.pop(b) for b in self.values["receives"]))
        loss = e[f"{self.name}.pressure_loss"]
        if self.values["law"] == "corrected_flow_squared":
            parameter = inlet.W * sqrt(inlet.T) / inlet.P * (1.0 / self.flow_parameter)
            loss = loss * (parameter * parameter)
        e.flows[self.values["to"]] = inlet.with_(P=inlet.P * (1.0 - loss))

    def size(self, e: Evaluation) -> None:
        inlet = mix(e.flows[self.values["from"]], *(e.bleeds[b] for b in self.values["receives"]))
        self.flow_parameter = scalar(inlet.W * sqrt(inlet.T) / inlet.P)
        self.evaluate(e)
