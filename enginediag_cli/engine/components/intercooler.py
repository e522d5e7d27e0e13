"""Intercooler: heat from compressed air to a coolant of known temperature."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.atmosphere import T_ISA
from enginediag_cli.engine.components.base import FROM, NAME, TO, scalar
from enginediag_cli.engine.components.exchange import (
    CONDUCTANCE_EXPONENT,
    EFFECTIVENESS_LAW,
    check_conductance,
    counterflow,
    transfer_units,
)
from enginediag_cli.engine.components.loss import LAW, Lossy
from enginediag_cli.engine.dual import Value, power
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.parameters import Parameter


class Intercooler(Lossy):
    """h_out = h_in − ε [h_in − h(T_coolant)], P_out = P_in (1 − loss).

    There is as much coolant as it takes; it is the ambient air, or an input column. The effectiveness is constant, or
    that of a given conductance (law `ntu`): ε = 1 − exp(−NTU), NTU ∝ W^(m − 1). Water that the air would lose when
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
            Field("effectiveness", "number", "ε at the design point", minimum=0.0, maximum=1.0),
            EFFECTIVENESS_LAW,
            CONDUCTANCE_EXPONENT,
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

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        check_conductance(self.values)
        self.design_flow = 1.0

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
        effectiveness = e[f"{self.name}.effectiveness"] * self._effectiveness(inlet)
        h = inlet.h - effectiveness * (inlet.h - inlet.gas.enthalpy(coolant, inlet.mixture))
        e.flows[self.values["to"]] = Flow(inlet.gas, inlet.mixture, inlet.W, self.lost(e, inlet), h=h)
        e.outputs[f"{self.name}_heat_W"] = inlet.W * (inlet.h - h)

    def _effectiveness(self, inlet: Flow) -> Value:
        if self.values["effectiveness_law"] == "constant":
            return self.values["effectiveness"]
        flow = inlet.W * (1.0 / self.design_flow)
        ntu = transfer_units(self.values["effectiveness"], 0.0)
        return counterflow(power(flow, self.values["conductance_exponent"] - 1.0) * ntu, 0.0)

    def size(self, e: Evaluation) -> None:
        self.design_flow = scalar(e.flows[self.values["from"]].W)
        self.size_loss(e.flows[self.values["from"]])
        self.evaluate(e)
