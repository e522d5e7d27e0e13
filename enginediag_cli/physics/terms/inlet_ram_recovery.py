"""Inlet pressure recovery in flight."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import MACH
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Inlet
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class InletRamRecovery(Term):
    """P₂/P₁ = r [1 + k (M² − M²_design)]: what is lost of the ram grows with the dynamic pressure, ∝ M²."""

    NAME = "inlet_ram_recovery"
    TITLE = "Inlet recovery with Mach number"
    STATEMENT = (
        "The faster the aircraft flies, the more of the ram pressure the inlet loses at its lip and walls; "
        "a few inlets recover better in flight than standing."
    )
    EQUATION = "P_2/P_1 = r [1 + k (M² − M_design²)]"
    DRIVER = MACH
    COEFFICIENTS = (
        Coefficient("change", "1", "change k of the recovery per M²", 0.0, -0.08, 0.03, 0.01, -0.01, assumed=True),
    )
    REFERENCE = (
        "Recovery tables: NASA AGTF30 (0.995 standing to 0.998 in flight); MIL-E-5007; S-ducts 0.95 to 0.99; "
        "the M² law is assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Inlet) and flies(network):
                yield Site(c.name, c.name, (f"{c.name}.pressure_recovery",))

    def install(self, at: Place) -> None:
        design = scalar(at.design.leaves["mach"]) ** 2

        def recovery(e: Evaluation, r: Value) -> Value:
            mach = e["mach"]
            return r * (1.0 + at.c(e, "change") * (mach * mach - design))

        at.on_leaf(f"{at.site.name}.pressure_recovery", recovery)
