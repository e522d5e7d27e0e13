"""Thermal growth of hot nozzles."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import BURNER_TEMPERATURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.nozzles import Nozzle
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import is_hot

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class NozzleThermalGrowth(Term):
    """A = A_design [1 + 2 a (T − T_design)], T the total temperature of the gas in a nozzle of burnt gas."""

    NAME = "nozzle_thermal_growth"
    TITLE = "Nozzle thermal growth"
    STATEMENT = "Hot exhaust gas makes the metal of the nozzle grow: its area opens with power and closes at idle."
    EQUATION = "A = A_design [1 + 2 a (T − T_design)]"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (
        Coefficient(
            "expansion_1_K",
            "1/K",
            "linear expansion a of the nozzle per kelvin of the gas",
            0.0,
            0.0,
            3e-5,
            1e-5,
            1.2e-5,
        ),
    )
    REFERENCE = "NASA T-MATS, nozzle block (Therm_growth); a up to 1.2e-5 per K, 0 to 1.5 % of area"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Nozzle) and is_hot(network, c.values["from"]):
                yield Site(c.name, c.name, (f"{c.name}.area",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        station = at.component.values["from"]
        reference = scalar(at.design.flows[station].T)

        def area(e: Evaluation, factor: Value) -> Value:
            return factor * (1.0 + 2.0 * at.c(e, "expansion_1_K") * (e.flows[station].T - reference))

        at.on_leaf(f"{at.component.name}.area", area)
