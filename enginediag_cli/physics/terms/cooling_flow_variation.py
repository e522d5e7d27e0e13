"""Turbine cooling flow that is no constant share of the core flow."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import COMPRESSOR_PRESSURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.components.passages import Bleed
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import Value, power
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class CoolingFlowVariation(Term):
    """f = f_model (P_s/P_s,design)^m with P_s the total pressure where the cooling air is taken.

    Orifices between fixed pressure ratios pass a constant share; what remains is what the pressure level does:
    cooling that is throttled at part load (m > 0), or seals that open there (m < 0). All the ports that feed the
    site's turbine vary together. For a port between a compressor's stages P_s is taken at the compressor's inlet,
    to which the pressure at the port is roughly proportional.
    """

    NAME = "cooling_flow_variation"
    TITLE = "Turbine cooling flow with pressure level"
    STATEMENT = (
        "The turbine's cooling air is not the same share of the core flow everywhere: seals and throttled "
        "cooling change it with the pressure that drives it."
    )
    EQUATION = "f = f_model (P_s/P_s,design)^m,  P_s = total pressure at the bleed (a compressor port: at its inlet)"
    DRIVER = COMPRESSOR_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "exponent", "1", "m, growth of the cooling share with pressure", 0.0, -0.3, 0.5, 0.1, 0.1, assumed=True
        ),
    )
    REFERENCE = "NASA AGTF30 (cooling shares 0.0625 and 0.0693); variation of 10 % of the cooling flow assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for turbine in turbines(network):
            leaves = tuple(leaf for _, leaf in ports(network, turbine))
            if leaves:
                yield Site(turbine.name, turbine.name, leaves)

    def install(self, at: Place) -> None:
        assert isinstance(at.component, Turbine)
        for station, leaf in ports(at.network, at.component):
            self._vary(at, station, leaf)

    def _vary(self, at: Place, station: str, leaf: str) -> None:
        reference = scalar(at.design.flows[station].P)

        def fraction(e: Evaluation, f: Value) -> Value:
            return f * power(e.flows[station].P * (1.0 / reference), at.c(e, "exponent"))

        at.on_leaf(leaf, fraction)


def ports(network: Network, turbine: Turbine) -> list[tuple[str, str]]:
    """Station whose pressure drives it and leaf of the share, for every bleed that cools the turbine."""
    cools = (*turbine.values["cooling_before_rotor"], *turbine.values["cooling_after_rotor"])
    return [
        (c.values["from"], f"{c.name}.{port['name']}.fraction")
        for c in network.components
        if isinstance(c, (Bleed, Compressor))
        for port in c.values["ports"]
        if port["name"] in cools
    ]
