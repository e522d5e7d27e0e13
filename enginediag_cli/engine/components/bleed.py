"""Bleed: air taken from a station, for a turbine's cooling, for another duct, or overboard."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, LEAST_BLEED, NAME, PART_ROAMS, TO, VALVE, Design, Valves
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.parameters import Parameter

PORT = Section(
    "port",
    "one bleed of this station",
    (
        Field("name", "text", "name of the bleed; a bleed that no component receives goes overboard"),
        Field("fraction", "number", "bleed flow over the station's flow", minimum=0.0, maximum=0.6),
        VALVE,
    ),
)


class Bleed(Valves):
    """W_out = W (1 − Σ fractions); each bleed leaves at the station's total state."""

    TYPE = "bleed"
    SECTION = Section(
        "bleed",
        "takes air from a station",
        (
            NAME,
            FROM,
            TO,
            Field("ports", "sections", "the bleeds", section=PORT),
        ),
    )

    def parameters(self) -> tuple[Parameter, ...]:
        return tuple(
            self.design(
                "fraction",
                Design(
                    port["fraction"], 0.01, 0.0, 0.6, PART_ROAMS * max(port["fraction"], LEAST_BLEED), switches=True
                ),
                "1",
                "bleed flow over station flow",
                of=port["name"],
            )
            for port in self.values["ports"]
        )

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        inlet.h  # noqa: B018  computed once here for every branch
        W = inlet.W
        for port in self.values["ports"]:
            taken = inlet.W * self.bled(e, port)
            e.bleeds[port["name"]] = inlet.with_(W=taken)
            W = W - taken
        e.flows[self.values["to"]] = inlet.with_(W=W)
