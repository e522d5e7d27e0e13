"""Heat that metal takes up and gives back."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.moving.filters import Lag, ScaledIntegrated
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

HOLD_HEAT = ("compressor", "burner", "turbine")


class HeatSoak(Term):
    """The gas behind a component gives ε (W c_p)_design (T − T_metal) to its metal; τ dT_metal/dt = T − T_metal."""

    NAME = "heat_soak"
    TITLE = "Heat soak of a component's metal"
    STATEMENT = (
        "Metal that is colder than the gas takes up heat until it is as warm, and gives it back when the gas cools: "
        "for some minutes after a change of power the gas behind the component is cooler, or warmer, than in the "
        "steady state."
    )
    EQUATION = "W Δh = −ε (W c_p)_design (T − T_metal),  τ dT_metal/dt = T − T_metal,  τ = m c_metal/(ε (W c_p)_design)"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "exchange",
            "1",
            "ε, heat conductance to the metal over W c_p of the gas at the design point",
            0.0,
            0.0,
            0.5,
            0.05,
            0.02,
            assumed=True,
        ),
        Coefficient(
            "time_constant",
            "s",
            "τ, in which the metal warms to 63 %",
            60.0,
            0.5,
            3600.0,
            600.0,
            30.0,
            assumed=True,
            free=True,
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8 (heat soak); ranges assumed"
    INPUTS = PAST
    TRIALS = tuple({"exchange": 0.02, "time_constant": t} for t in (5.0, 30.0, 150.0, 600.0))

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if c.TYPE in HOLD_HEAT:
                yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        station = at.component.values["to"]
        design = at.design.flows[station]
        capacity = scalar(design.W * design.gas.heat_capacity(design.T, design.mixture))
        heat = at.remember(ScaledIntegrated(Lag()), ("exchange", "time_constant"))

        def soaked(e: Evaluation, flow: Flow) -> Flow:
            # ε (T_metal − T): negative while the metal is colder than the gas
            given = heat(e, flow.T) * capacity
            return Flow(flow.gas, flow.mixture, flow.W, flow.P, h=flow.h + given / flow.W)

        at.on_station(station, soaked)
