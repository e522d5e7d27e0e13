"""Friction of bearings and oil."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SHAFT_SPEED
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import relative_speed, turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class BearingLoss(Term):
    """P_loss = f P_turbine,design (N/N_design)²: shear of oil of regulated temperature, whatever the air's density."""

    NAME = "bearing_loss"
    TITLE = "Bearing friction"
    STATEMENT = (
        "Bearings and oil take shaft power with the square of speed; at altitude, where the engine makes less "
        "power at the same speed, that is a larger share."
    )
    EQUATION = "P_loss = f P_turbine,design (N/N_design)²"
    DRIVER = SHAFT_SPEED
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "f, loss over the shaft's turbine power at the design point",
            0.0,
            0.0,
            0.02,
            0.004,
            0.004,
            assumed=True,
        ),
    )
    REFERENCE = "NASA AGTF30 (shaft efficiency 0.99); law μ(T_oil) N²; 0.2 to 1 % of shaft power assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for shaft in network.shafts:
            if any(t.values["shaft"] == shaft for t in turbines(network)):
                yield Site(shaft, shaft, (f"{shaft}.power_offtake_W",))

    def install(self, at: Place) -> None:
        shaft = at.site.name
        full, speed = scalar(at.design.shafts[shaft].supply_W), relative_speed(at, shaft)

        def offtake(e: Evaluation, load_W: Value) -> Value:
            n = speed(e)
            return load_W + at.c(e, "fraction") * full * (n * n)

        at.on_leaf(f"{shaft}.power_offtake_W", offtake)
