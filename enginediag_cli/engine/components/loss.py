"""Total pressure loss of a passage: what ducts and the sides of heat exchangers share."""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.engine.components.base import Component, Design, scalar
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.parameters import Parameter

LAW = Field("law", "choice", "how the loss varies", "constant", choices=("constant", "corrected_flow_squared"))


class Lossy(Component):
    """P_out = P_in (1 − loss), the loss `pressure_loss` constant or ∝ (W√T/P)², the dynamic pressure at low Mach
    number; `law` says which."""

    flow_parameter = 1.0

    def loss_parameter(self) -> Parameter:
        return self.design(
            "pressure_loss",
            Design(self.values["pressure_loss"], 0.005, 0.0, 0.5, part=True),
            "1",
            "ΔP/P at design",
        )

    def lost(self, e: Evaluation, inlet: Flow) -> Value:
        """Total pressure behind the passage, Pa."""
        loss = e[f"{self.name}.pressure_loss"]
        if self.values["law"] == "corrected_flow_squared":
            parameter = inlet.W * sqrt(inlet.T) / inlet.P * (1.0 / self.flow_parameter)
            loss = loss * (parameter * parameter)
        return inlet.P * (1.0 - loss)

    def size_loss(self, inlet: Flow) -> None:
        self.flow_parameter = scalar(inlet.W * sqrt(inlet.T) / inlet.P)
