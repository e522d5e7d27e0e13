"""Compressor tip clearance and shaft speed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SHAFT_SPEED
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor, relative_speed

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class CompressorTipClearance(Term):
    """Δc = g (1 − (N/N_design)²) in % of span; η = η_map (1 − k Δc), W_c = W_c,map (1 − k_w Δc)."""

    NAME = "compressor_tip_clearance"
    TITLE = "Compressor tip clearance with speed"
    STATEMENT = (
        "At low speed the rotor is shorter and the gap over the compressor's blades wider: it loses flow and "
        "efficiency there."
    )
    EQUATION = "η = η_map (1 − k Δc),  W_c = W_c,map (1 − k_w Δc),  Δc = g [1 − (N/N_design)²]"
    DRIVER = SHAFT_SPEED
    COEFFICIENTS = (
        Coefficient(
            "growth",
            "% of span",
            "g, growth of the rotor from standstill to design speed",
            0.0,
            0.0,
            3.0,
            0.8,
            1.0,
            assumed=True,
        ),
        Coefficient(
            "efficiency_loss",
            "1/% of span",
            "k, relative loss of efficiency per clearance",
            0.015,
            0.005,
            0.025,
            0.004,
            0.015,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "flow_loss",
            "1/% of span",
            "k_w, relative loss of corrected flow per clearance",
            0.025,
            0.01,
            0.04,
            0.005,
            0.025,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = (
        "Freeman 1985, VKI lecture series 1985-05; Walsh & Fletcher, 2nd ed.; 0.01 to 0.02 of efficiency and "
        "0.02 to 0.03 of flow per % of span assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in core_compressor(network):
            if network.shafts[c.values["shaft"]]["speed"] != "constant":
                yield Site(c.name, c.name, (f"{c.name}.efficiency", f"{c.name}.flow_capacity"))

    def install(self, at: Place) -> None:
        assert at.component is not None
        speed = relative_speed(at, at.component.values["shaft"])

        def opening(e: Evaluation) -> Value:
            n = speed(e)
            return at.c(e, "growth") * (1.0 - n * n)

        at.on_leaf(
            f"{at.site.name}.efficiency", lambda e, factor: factor * (1.0 - at.c(e, "efficiency_loss") * opening(e))
        )
        at.on_leaf(
            f"{at.site.name}.flow_capacity", lambda e, factor: factor * (1.0 - at.c(e, "flow_loss") * opening(e))
        )
