"""Pressure loss by heating in the burner."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import POWER
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import relative_flow

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class BurnerHeatingLoss(Term):
    """P₄ is lower by k [(T₄/T₃ − 1) x² − (T₄/T₃ − 1)_design]: gas that is heated as it flows must be accelerated."""

    NAME = "burner_heating_loss"
    TITLE = "Burner pressure loss by heating"
    STATEMENT = (
        "Heating the gas in the burner speeds it up and costs total pressure: the more, the higher the ratio "
        "of temperatures across it."
    )
    EQUATION = "P_4 = P_4,cold {1 − k [(T_4/T_3 − 1) x² − (T_4/T_3 − 1)_design]},  x = (W√T/P)/(W√T/P)_design at 3"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient("loss", "1", "ΔP/P for T4/T3 = 2 at design flow", 0.0, 0.0, 0.01, 0.002, 0.002, assumed=True),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (fundamental loss); 0.0005 to 0.003 assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Burner):
                yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        cold, hot = at.component.values["from"], at.component.values["to"]
        relative = relative_flow(at, cold)
        reference = scalar(at.design.flows[hot].T / at.design.flows[cold].T) - 1.0

        def heated(e: Evaluation, flow: Flow) -> Flow:
            x = relative(e)
            heating = (flow.T / e.flows[cold].T - 1.0) * (x * x)
            return flow.with_(P=flow.P * (1.0 - at.c(e, "loss") * (heating - reference)))

        at.on_station(hot, heated)
