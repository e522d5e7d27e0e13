"""Duct: total pressure loss, and bleed air that returns to the gas path."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, TO
from enginediag_cli.engine.components.loss import LAW, Lossy
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import mix
from enginediag_cli.parameters import Parameter


class Duct(Lossy):
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
            LAW,
            Field("receives", "texts", "names of bleeds that mix in before the loss", ()),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.loss_parameter(),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = mix(e.flows[self.values["from"]], *(e.bleeds.pop(b) for b in self.values["receives"]))
        e.flows[self.values["to"]] = inlet.with_(P=self.lost(e, inlet))

    def size(self, e: Evaluation) -> None:
        self.size_loss(mix(e.flows[self.values["from"]], *(e.bleeds[b] for b in self.values["receives"])))
        self.evaluate(e)
