"""Fan root and bypass ratio."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import BYPASS_RATIO
from enginediag_cli.engine.components.passages import Splitter
from enginediag_cli.engine.dual import exp, log
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import fan_of

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class FanSplit(Term):
    """Efficiency of the fan's root changed by a ln(BPR/BPR_design): at the same enthalpy rise Δh of the fan the core's
    flow leaves it at another pressure,

        P_core = P_fan exp[a ln(BPR/BPR_design) Δh/(R T)],   Δh, R, T of the flow behind the fan.
    """

    NAME = "fan_split"
    TITLE = "Fan root with bypass ratio"
    STATEMENT = (
        "The inner part of the fan, which feeds the core, does not work as the whole fan does once the bypass "
        "ratio leaves its design value."
    )
    EQUATION = "P_core = P_fan exp[a ln(BPR/BPR_design) Δh_fan/(R T_fan)]"
    DRIVER = BYPASS_RATIO
    COEFFICIENTS = (
        Coefficient(
            "root_efficiency",
            "1",
            "a, change of the root's efficiency per unit of ln BPR",
            0.0,
            -0.3,
            0.3,
            0.05,
            -0.05,
            assumed=True,
        ),
    )
    REFERENCE = "GasTurb manual (fans with two maps); 0.5 to 2 points of efficiency over 20 % of bypass ratio assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Splitter):
                fan = fan_of(network, c)
                if fan is not None:
                    yield Site(fan.name, fan.name, (f"station {c.values['core']}",))

    def install(self, at: Place) -> None:
        fan = at.component
        assert fan is not None
        splitter = next(c for c in at.network.components if isinstance(c, Splitter) and fan_of(at.network, c) is fan)

        def root(e: Evaluation, flow: Flow) -> Flow:
            before, behind = e.flows[fan.values["from"]], e.flows[fan.values["to"]]
            change = at.c(e, "root_efficiency") * log(e[f"{splitter.name}.bypass_ratio"])  # relative to design
            return flow.with_(P=flow.P * exp(change * (behind.h - before.h) / (behind.R * behind.T)))

        at.on_station(splitter.values["core"], root)
