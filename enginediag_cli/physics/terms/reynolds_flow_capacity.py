"""Reynolds number and compressor flow capacity."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import REYNOLDS_INDEX
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.dual import Value, log
from enginediag_cli.engine.evaluation import Evaluation, reynolds_index
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import compressors

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ReynoldsFlowCapacity(Term):
    """W_c = W_c,map (1 + k ln(RNI/RNI_design)): thicker boundary layers block the passages."""

    NAME = "reynolds_flow_capacity"
    TITLE = "Reynolds number, compressor flow"
    STATEMENT = (
        "The thick boundary layers of thin air block the compressor's passages: it swallows less corrected "
        "flow at altitude."
    )
    EQUATION = "W_c = W_c,map [1 + k ln(RNI/RNI_design)],  RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T) at its inlet"
    DRIVER = REYNOLDS_INDEX
    COEFFICIENTS = (
        Coefficient(
            "slope", "1", "k, change of corrected flow per unit of ln RNI", 0.0, 0.0, 0.05, 0.012, 0.015, assumed=True
        ),
    )
    REFERENCE = "NPSS S_Re socket (s_WcRe); Walsh & Fletcher, Gas Turbine Performance, 2nd ed.; k 0 to 0.03 assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in compressors(network):
            yield Site(c.name, c.name, (f"{c.name}.flow_capacity",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        station = c.values["from"]
        reference = scalar(reynolds_index(at.design.flows[station]))

        def capacity(e: Evaluation, factor: Value) -> Value:
            relative = reynolds_index(e.flows[station]) * (1.0 / reference)
            return factor * (1.0 + at.c(e, "slope") * log(relative))

        at.on_leaf(f"{c.name}.flow_capacity", capacity)
