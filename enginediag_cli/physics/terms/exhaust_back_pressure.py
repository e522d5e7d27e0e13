"""Back pressure of stacks, silencers and heat recovery behind ground engines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import POWER
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.nozzles import Exhaust, Nozzle, throat
from enginediag_cli.engine.dual import Value, log
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ExhaustBackPressure(Term):
    """Δp = b p₀,design (W²T/p₀)/(W²T/p₀)_design is added to the ambient pressure against which the gas leaves."""

    NAME = "exhaust_back_pressure"
    TITLE = "Exhaust back pressure"
    STATEMENT = (
        "Stack, silencer or boiler behind the engine hold the exhaust gas back, with the square of its flow: "
        "the last turbine expands to a higher pressure and gives less power."
    )
    EQUATION = "p_exit = p_0 + b p_0,design y,  y = (W²T/p_0)/(W²T/p_0)_design at the exit"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient(
            "rise",
            "1",
            "back pressure over ambient pressure at the design point",
            0.0,
            0.0,
            0.06,
            0.02,
            0.01,
            assumed=True,
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (installation losses); 0 to 3 % assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            return
        for c in network.components:
            if isinstance(c, Exhaust) and c.design_loss > 0.0 and not c.values["measured_back_pressure"]:
                yield Site(c.name, c.name, (f"{c.name}.loss_factor",))
            if isinstance(c, Nozzle) and c.converges:
                yield Site(c.name, c.name, (f"{c.name}.area",))

    def install(self, at: Place) -> None:
        c = at.component
        assert c is not None
        station = c.values["from"]
        ambient_design = scalar(at.design.outputs["P0_Pa"])
        reference = scalar(_load(at.design, at.design.flows[station]))

        def rise(e: Evaluation, flow: Flow) -> Value:
            return at.c(e, "rise") * (_load(e, flow) * (ambient_design / reference))

        def loss_factor(e: Evaluation, factor: Value) -> Value:
            """P (1 − f L x²) = p₀ + Δp is met by f + Δp/(P L x²), x and L as in the exhaust component."""
            assert isinstance(c, Exhaust)
            flow = e.flows[station]
            own = flow.W * flow.W * flow.T / flow.P * (c.design_loss / c.flow_parameter**2)
            return factor + rise(e, flow) / own

        def area(e: Evaluation, factor: Value) -> Value:
            """The throat's flow against the raised pressure, told as area."""
            flow, p0 = e.flows[station], e.outputs["P0_Pa"]
            raised = p0 + rise(e, flow)
            return factor * throat(flow, log(flow.P / raised), raised)[0] / throat(flow, log(flow.P / p0), p0)[0]

        if isinstance(c, Exhaust):
            at.on_leaf(f"{c.name}.loss_factor", loss_factor)
        else:
            at.on_leaf(f"{c.name}.area", area)


def _load(e: Evaluation, flow: Flow) -> Value:
    """W²T/p₀, to which the dynamic pressure of a slow exhaust is proportional."""
    return flow.W * flow.W * flow.T / e.outputs["P0_Pa"]
