"""Reynolds number and compressor efficiency."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import REYNOLDS_INDEX
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.dual import Value, power
from enginediag_cli.engine.evaluation import Evaluation, reynolds_index
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import compressors

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ReynoldsEfficiency(Term):
    """η = 1 − (1 − η_0)(RNI/RNI_design)^(−n), written as a factor on the map's efficiency."""

    NAME = "reynolds_efficiency"
    TITLE = "Reynolds number, compressor efficiency"
    STATEMENT = (
        "The thin air of altitude thickens the boundary layers on the blades: the compressor's losses grow "
        "as the Reynolds number falls."
    )
    EQUATION = "(1 − η) = (1 − η_design) (RNI/RNI_design)^(−n),  RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T) at its inlet"
    DRIVER = REYNOLDS_INDEX
    COEFFICIENTS = (Coefficient("exponent", "1", "exponent n of the losses", 0.0, 0.0, 0.3, 0.1, 0.1),)
    REFERENCE = (
        "NASA TN D-6640 (n 0.06 to 0.20 as Re falls, centrifugal); Wassell 1968, J. Eng. Power 90, 349; "
        "form as in NLR GSP"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in compressors(network):
            yield Site(c.name, c.name, (f"{c.name}.efficiency",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        station = c.values["from"]
        reference = scalar(reynolds_index(at.design.flows[station]))
        loss = 1.0 / c.values["isentropic_efficiency"] - 1.0

        def efficiency(e: Evaluation, factor: Value) -> Value:
            relative = reynolds_index(e.flows[station]) * (1.0 / reference)
            return factor * (1.0 - loss * (power(relative, -1.0 * at.c(e, "exponent")) - 1.0))

        at.on_leaf(f"{c.name}.efficiency", efficiency)
