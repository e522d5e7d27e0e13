"""Intercooler: heat from compressed air to a coolant of known temperature."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import T_ISA
from enginediag_cli.engine.components.base import FROM, NAME, TO
from enginediag_cli.engine.components.loss import LAW, Lossy
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.parameters import Parameter


class Intercooler(Lossy):
    """h_out = h_in − ε [h_in − h(T_coolant)], P_out = P_in (1 − loss).

    There is as much coolant as it takes; it is the ambient air, or an input column. Water that the air would lose when
    cooled below its dew point stays in it.
    """

    TYPE = "intercooler"
    SECTION = Section(
        "intercooler",
        "cooler between compressors",
        (
            NAME,
            FROM,
            TO,
            Field("effectiveness", "number", "ε, constant", minimum=0.0, maximum=1.0),
            Field(
                "coolant",
                "choice",
                "what it is cooled towards: the ambient temperature, or the input column <name>_coolant_K",
                "ambient",
                choices=("ambient", "column"),
            ),
            Field("design_coolant_K", "number", "<name>_coolant_K at the design point", T_ISA, unit="K", minimum=200.0),
            Field("pressure_loss", "number", "ΔP/P at the design point", 0.02, minimum=0.0, maximum=0.5),
            LAW,
        ),
    )

    @property
    def _column(self) -> str:
        return f"{self.name}_coolant_K"

    def inputs(self) -> dict[str, float | None]:
        return {self._column: None} if self.values["coolant"] == "column" else {}

    def at_design(self) -> dict[str, float]:
        return {self._column: self.values["design_coolant_K"]} if self.values["coolant"] == "column" else {}

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.health("effectiveness", "effectiveness, factor", 0.02, wear=-1), self.loss_parameter())

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        coolant = e.outputs["T0_K"] if self.values["coolant"] == "ambient" else e[self._column]
        effectiveness = e[f"{self.name}.effectiveness"] * self.values["effectiveness"]
        h = inlet.h - effectiveness * (inlet.h - inlet.gas.enthalpy(coolant, inlet.mixture))
        e.flows[self.values["to"]] = Flow(inlet.gas, inlet.mixture, inlet.W, self.lost(e, inlet), h=h)
        e.outputs[f"{self.name}_heat_W"] = inlet.W * (inlet.h - h)

    def size(self, e: Evaluation) -> None:
        self.size_loss(e.flows[self.values["from"]])
        self.evaluate(e)
