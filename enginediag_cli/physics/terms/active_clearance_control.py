"""Active clearance control of a turbine."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import AMBIENT_PRESSURE
from enginediag_cli.engine.components.passages import Splitter
from enginediag_cli.engine.dual import Value, exp
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ActiveClearanceControl(Term):
    """η = η_map (1 + k c s(h)), s = 1/(1 + exp[(h_on − h)/Δh]): fan air shrinks the casing at cruise altitude."""

    NAME = "active_clearance_control"
    TITLE = "Active clearance control"
    STATEMENT = (
        "At cruise altitude fan air is blown on the turbine's casing, which shrinks onto the blades: the "
        "turbine is better there than near the ground."
    )
    EQUATION = "η = η_map (1 + k c/(1 + exp[(h_on − h)/Δh])),  h = pressure altitude"
    DRIVER = AMBIENT_PRESSURE
    COEFFICIENTS = (
        Coefficient("closing", "% of span", "c, clearance that it takes away", 0.0, 0.0, 1.5, 0.5, 0.6, assumed=True),
        Coefficient(
            "efficiency_gain",
            "1/% of span",
            "k, relative gain of efficiency per clearance",
            0.0175,
            0.003,
            0.03,
            0.005,
            0.0175,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "on_above_m",
            "m",
            "h_on, pressure altitude at which it is half on",
            6000.0,
            1500.0,
            11000.0,
            1500.0,
            6000.0,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "width_m",
            "m",
            "Δh, altitude over which it comes on",
            300.0,
            100.0,
            2000.0,
            200.0,
            300.0,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = "Lattime & Steinetz, NASA TM-2002-211794; 0.3 to 1 % of span, on above about FL200, assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        # the air is the fan's: an engine without bypass has none to blow
        if "altitude_m" in network.inputs() and any(isinstance(c, Splitter) for c in network.components):
            for c in turbines(network):
                yield Site(c.name, c.name, (f"{c.name}.efficiency",))

    def install(self, at: Place) -> None:
        def efficiency(e: Evaluation, factor: Value) -> Value:
            off = exp((at.c(e, "on_above_m") - e["altitude_m"]) / at.c(e, "width_m"))
            return factor * (1.0 + at.c(e, "closing") * at.c(e, "efficiency_gain") / (1.0 + off))

        at.on_leaf(f"{at.site.name}.efficiency", efficiency)
