"""Splitter: one flow divided into core and bypass; the bypass ratio is unknown."""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, Component, Unknown
from enginediag_cli.engine.evaluation import Evaluation


class Splitter(Component):
    """W_core = W/(1 + BPR), W_bypass = W BPR/(1 + BPR)."""

    TYPE = "splitter"
    SECTION = Section(
        "splitter",
        "divides core and bypass flow",
        (
            NAME,
            FROM,
            Field("core", "text", "station of the core flow"),
            Field("bypass", "text", "station of the bypass flow"),
            Field("bypass_ratio", "number", "bypass over core flow at the design point", minimum=0.01, maximum=30.0),
        ),
    )

    def unknowns(self) -> tuple[Unknown, ...]:
        return (Unknown(f"{self.name}.bypass_ratio", lower=0.05, upper=20.0),)

    def evaluate(self, e: Evaluation) -> None:
        inlet = e.flows[self.values["from"]]
        inlet.phi  # noqa: B018  computed once here for both branches
        ratio = e[f"{self.name}.bypass_ratio"] * self.values["bypass_ratio"]
        core = inlet.W / (1.0 + ratio)
        e.flows[self.values["core"]] = inlet.with_(W=core)
        e.flows[self.values["bypass"]] = inlet.with_(W=inlet.W - core)
        e.outputs["BPR"] = ratio
