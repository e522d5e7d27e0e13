"""Pressure loss of inlet filters and ducts."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.components.passages import Inlet
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

HOURS = "hours_since_filter_change_h"


class InletFilterLoss(Term):
    """ΔP/P = k (1 + g t/1000 h) x², x the corrected flow at the engine's face over its design value.

    x is the inlet's own unknown, so that the loss is known before the flow is.
    """

    NAME = "inlet_filter_loss"
    TITLE = "Inlet filter and duct loss"
    STATEMENT = (
        "Filter, screens and inlet duct take pressure from the air with the square of its flow; dirt in the "
        "filter makes it more with the hours."
    )
    EQUATION = "P_2 = r P_1 [1 − k (1 + g t/1000 h) x²],  x = (W√θ/δ)/(W√θ/δ)_design at station 2"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient("loss", "1", "ΔP/P at design flow with a clean filter", 0.0, 0.0, 0.05, 0.01, 0.01, assumed=True),
        Coefficient(
            "growth",
            "1/1000 h",
            "growth of the loss with the hours since the filter was changed",
            0.0,
            0.0,
            2.0,
            0.3,
            0.2,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004; 0 to 3 % (0 to 30 mbar) assumed"
    INPUTS = MappingProxyType({HOURS: 0.0})

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Inlet) and not c.values["measured_loss"]:
                yield Site(c.name, c.name, (f"{c.name}.pressure_recovery",))

    def install(self, at: Place) -> None:
        def recovery(e: Evaluation, r: Value) -> Value:
            x = e[f"{at.site.name}.corrected_flow"]
            dirt = 1.0 + at.c(e, "growth") * (e[HOURS] * 1e-3)
            return r * (1.0 - at.c(e, "loss") * dirt * (x * x))

        at.on_leaf(f"{at.site.name}.pressure_recovery", recovery)
