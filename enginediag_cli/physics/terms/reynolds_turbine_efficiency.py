"""Reynolds number and turbine efficiency."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import REYNOLDS_INDEX
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.turbine import Turbine
from enginediag_cli.engine.dual import Value, power
from enginediag_cli.engine.evaluation import Evaluation, viscosity_ratio
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


def reynolds_number(flow: Flow) -> Value:
    """W/μ [kg/s at the viscosity of air at 288.15 K]: proportional to the Reynolds number of a given turbine."""
    return flow.W / viscosity_ratio(flow.T)


class ReynoldsTurbineEfficiency(Term):
    """η = 1 − (1 − η_design)(Re/Re_design)^(−n), written as a factor on the map's efficiency."""

    NAME = "reynolds_turbine_efficiency"
    TITLE = "Reynolds number, turbine efficiency"
    STATEMENT = (
        "Less and thinner gas flows through the turbine at altitude and low power: its boundary layers "
        "thicken and its losses grow."
    )
    EQUATION = "(1 − η) = (1 − η_design) (Re/Re_design)^(−n),  Re ∝ W/μ(T) of the entering gas"
    DRIVER = REYNOLDS_INDEX
    COEFFICIENTS = (Coefficient("exponent", "1", "exponent n of the losses", 0.0, 0.0, 0.35, 0.1, 0.15),)
    REFERENCE = "NASA TN D-5090 (n 0.13 to 0.20 static; 0.18 above and 0.30 below design Re, total)"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in turbines(network):
            yield Site(c.name, c.name, (f"{c.name}.efficiency",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Turbine)
        station = c.values["from"]
        reference = scalar(reynolds_number(at.design.flows[station]))
        loss = 1.0 / c.values["isentropic_efficiency"] - 1.0

        def efficiency(e: Evaluation, factor: Value) -> Value:
            relative = reynolds_number(e.flows[station]) * (1.0 / reference)
            return factor * (1.0 - loss * (power(relative, -1.0 * at.c(e, "exponent")) - 1.0))

        at.on_leaf(f"{c.name}.efficiency", efficiency)
