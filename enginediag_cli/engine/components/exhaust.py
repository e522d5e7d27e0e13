"""Exhaust: a turbine's discharge to ambient through a diffuser and stack."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, Component, Design, scalar
from enginediag_cli.engine.dual import sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter


class Exhaust(Component):
    """P (1 − loss (W√T/P)²/(W√T/P)²_design) = p_0 + ΔP_exhaust.

    ΔP_exhaust is an input column when the machine measures its exhaust back pressure. The loss at the
    design point is what the turbine's design pressure ratio leaves above ambient; the kinetic energy of
    the discharge belongs to it.
    """

    TYPE = "exhaust"
    SECTION = Section(
        "exhaust",
        "discharge to ambient",
        (
            NAME,
            FROM,
            Field(
                "measured_back_pressure", "boolean", "the input column dP_exhaust_Pa adds to ambient pressure", False
            ),
            Field("design_back_pressure_Pa", "number", "dP_exhaust_Pa at the design point", 0.0, unit="Pa"),
        ),
    )
    flow_parameter = 1.0
    design_loss = 0.0

    def inputs(self) -> dict[str, float | None]:
        return {"dP_exhaust_Pa": None} if self.values["measured_back_pressure"] else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.design(
                "loss_factor",
                Design(1.0, 0.3, 0.0, 5.0, part=True),
                "1",
                "pressure loss, factor on the design point's",
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        ambient = e.outputs["P0_Pa"]
        if self.values["measured_back_pressure"]:
            ambient = ambient + e["dP_exhaust_Pa"]
        parameter = flow.W * sqrt(flow.T) / flow.P * (1.0 / self.flow_parameter)
        loss = e[f"{self.name}.loss_factor"] * (parameter * parameter * self.design_loss)
        e.balances[f"{self.name} pressure"] = flow.P * (1.0 - loss) / ambient - 1.0

    def size(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        self.flow_parameter = scalar(flow.W * sqrt(flow.T) / flow.P)
        ambient = value(e.outputs["P0_Pa"])
        if self.values["measured_back_pressure"]:
            ambient = ambient + self.values["design_back_pressure_Pa"]
        self.design_loss = 1.0 - scalar(ambient / flow.P)
        if self.design_loss < 0.0:
            raise ValueError(
                f"{self.name}: total pressure {scalar(flow.P):.0f} Pa is below the exhaust's back pressure "
                f"{scalar(ambient):.0f} Pa at design; the pressure_ratio of the turbine before it must be at most "
                f"{scalar(flow.P / ambient):.3f} times what it is"
            )
        self.evaluate(e)
