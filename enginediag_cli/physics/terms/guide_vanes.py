"""Guide vanes and variable stators off their schedule of corrected speed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.maps.compressor_map import closed_efficiency, closed_flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import Ratio, core_compressor, relative_corrected_speed

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class GuideVanes(Term):
    """Vanes closed further than the map holds by Δφ = s (1 − N_c/N_c,design), in degrees.

    Flow W_c = W_c,map exp(−a Δφ), efficiency η = η_map/(1 + b Δφ²): to first order −a Δφ and −b Δφ², and
    sensible for any angle. Machines of constant speed close their vanes with the load: `guide_vanes_load`.
    """

    NAME = "guide_vanes"
    TITLE = "Guide vane schedule"
    STATEMENT = (
        "The compressor's guide vanes and stators close further at low speed than the model's map holds: it "
        "swallows less air there, and its incidence is off."
    )
    EQUATION = "W_c = W_c,map exp(−a Δφ),  η = η_map/(1 + b Δφ²),  Δφ = s (1 − N_c/N_c,design)"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient(
            "slope_deg",
            "deg",
            "s, closing per unit of relative corrected speed below design",
            0.0,
            -60.0,
            60.0,
            15.0,
            20.0,
            assumed=True,
        ),
        Coefficient(
            "flow_per_deg",
            "1/deg",
            "a, fall of corrected flow per degree of closing",
            0.01,
            0.005,
            0.015,
            0.003,
            0.01,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "loss_per_deg2",
            "1/deg2",
            "b, fall of efficiency per square degree",
            3e-4,
            0.0,
            5e-4,
            1e-4,
            3e-4,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = (
        "NLR GSP and GasTurb variable-geometry inputs; a 0.5 to 1.5 %/deg, b 0.01 to 0.05 %/deg2 and errors "
        "of up to 5 deg assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in core_compressor(network):
            if network.shafts[c.values["shaft"]]["speed"] != "constant":
                yield Site(c.name, c.name, (f"{c.name}.flow_capacity", f"{c.name}.efficiency"))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        speed = relative_corrected_speed(at, c)
        install_vanes(at, c.name, lambda e: at.c(e, "slope_deg") * (1.0 - speed(e)))


def install_vanes(at: Place, compressor: str, closing: Ratio) -> None:
    """Flow and efficiency with the vanes closed by `closing(e)` degrees; coefficients as of GuideVanes."""

    def capacity(e: Evaluation, factor: Value) -> Value:
        return closed_flow(factor, at.c(e, "flow_per_deg"), closing(e))

    def efficiency(e: Evaluation, factor: Value) -> Value:
        return closed_efficiency(factor, at.c(e, "loss_per_deg2"), closing(e))

    at.on_leaf(f"{compressor}.flow_capacity", capacity)
    at.on_leaf(f"{compressor}.efficiency", efficiency)
