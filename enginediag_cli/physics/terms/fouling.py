"""Compressor fouling since the last wash."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import TYPE_CHECKING

from enginediag_cli.drivers import HOURS
from enginediag_cli.engine.dual import Value, exp
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import compressors, fans

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

SINCE_WASH = "hours_since_wash_h"


class Fouling(Term):
    """W_c = W_c,map (1 − a s), η = η_map (1 − r a s), s = 1 − exp(−t/τ): deposits grow until as much is carried
    off as settles."""

    NAME = "fouling"
    TITLE = "Fouling since the last wash"
    STATEMENT = (
        "Dirt settles on the compressor's blades after a wash, fast at first: it loses flow, and efficiency "
        "with it, until the next wash."
    )
    EQUATION = "W_c = W_c,map (1 − a s),  η = η_map (1 − r a s),  s = 1 − exp(−t/τ),  t = hours since the wash"
    DRIVER = HOURS
    COEFFICIENTS = (
        Coefficient("flow_loss", "1", "a, loss of corrected flow in the long run", 0.0, 0.0, 0.1, 0.02, 0.03),
        Coefficient(
            "efficiency_share", "1", "r, loss of efficiency over loss of flow", 0.5, 0.0, 1.5, 0.25, 0.5, shape=True
        ),
        Coefficient(
            "hours",
            "h",
            "τ, time in which 63 % of it has settled",
            500.0,
            20.0,
            5000.0,
            300.0,
            500.0,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = (
        "Aker & Saravanamuttoo 1989, J. Eng. Gas Turbines Power 111, 343; Mathioudakis 2024; flow to "
        "efficiency 3:1 to 1:1; time assumed"
    )
    INPUTS = MappingProxyType({SINCE_WASH: 0.0})

    def sites(self, network: Network) -> Iterable[Site]:
        for c in compressors(network):
            if c.name not in fans(network):
                yield Site(c.name, c.name, (f"{c.name}.flow_capacity", f"{c.name}.efficiency"))

    def install(self, at: Place) -> None:
        def settled(e: Evaluation) -> Value:
            return at.c(e, "flow_loss") * (1.0 - exp(-1.0 * e[SINCE_WASH] / at.c(e, "hours")))

        at.on_leaf(f"{at.site.name}.flow_capacity", lambda e, factor: factor * (1.0 - settled(e)))
        at.on_leaf(
            f"{at.site.name}.efficiency", lambda e, factor: factor * (1.0 - at.c(e, "efficiency_share") * settled(e))
        )
