"""Turbine tip clearance and shaft speed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SHAFT_SPEED
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import relative_speed, turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class TurbineTipClearance(Term):
    """Δc = g (1 − (N/N_design)²) in % of span: centrifugal growth closes the gap as the shaft speeds up.

    η = η_map (1 − k Δc), W_c = W_c,map (1 − k_w Δc); steady states, where casing and rotor are warm.
    """

    NAME = "turbine_tip_clearance"
    TITLE = "Turbine tip clearance with speed"
    STATEMENT = (
        "The rotor stretches with the square of its speed: at low speed the gap over the turbine's blades is "
        "wider, and it leaks."
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
            0.0175,
            0.003,
            0.03,
            0.005,
            0.0175,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "capacity_loss",
            "1/% of span",
            "k_w, relative loss of capacity per clearance",
            0.002,
            0.0,
            0.005,
            0.001,
            0.002,
            shape=True,
        ),
    )
    REFERENCE = (
        "NASA TM X-52552 (k 0.0033 radial; k_w 0.002); Lattime & Steinetz, NASA TM-2002-211794; k 0.015 to "
        "0.02 for axial turbines assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in turbines(network):
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
            f"{at.site.name}.flow_capacity", lambda e, factor: factor * (1.0 - at.c(e, "capacity_loss") * opening(e))
        )
