"""Customer (cabin air) bleed from a compressor's exit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SWITCH
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class CustomerBleed(Term):
    """W_out = W (1 − b) at the exit of a compressor whose air can leave for the cabin; the work has been done."""

    NAME = "customer_bleed"
    TITLE = "Customer bleed"
    STATEMENT = (
        "Air for the cabin is taken behind the compressor: the turbines get less gas, and the burner must "
        "heat it more for the same power."
    )
    EQUATION = "W = W_exit (1 − b)"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient("fraction", "1", "bleed over compressor exit flow", 0.0, 0.0, 0.12, 0.03, 0.03, assumed=True),
    )
    REFERENCE = "SAE AIR1168; range 0 to 8 % of core flow assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        # air of an outer fan or a booster is a matter of the handling bleed
        for c in core_compressor(network):
            yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        assert at.component is not None

        def exit_flow(e: Evaluation, flow: Flow) -> Flow:
            return flow.with_(W=flow.W * (1.0 - at.c(e, "fraction")))

        at.on_station(at.component.values["to"], exit_flow)
