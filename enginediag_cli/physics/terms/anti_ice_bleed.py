"""Anti-ice bleed from the last compressor's exit."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SWITCH
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor, relative_corrected_speed

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class AntiIceBleed(Term):
    """W_out = W (1 − b N_c,design/N_c): the heat that ice protection needs does not fall with the engine's speed."""

    NAME = "anti_ice_bleed"
    TITLE = "Anti-ice bleed"
    STATEMENT = (
        "Hot air for wing and inlet is taken behind the compressor on command; it is a larger share of the "
        "flow at low speed."
    )
    EQUATION = "W = W_exit (1 − b N_c,design/N_c),  N_c = N/√T at the compressor's inlet"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "b, bleed over compressor exit flow at design corrected speed",
            0.0,
            0.0,
            0.08,
            0.02,
            0.02,
            assumed=True,
        ),
    )
    REFERENCE = "SAE AIR1168; 1 to 5 % of core flow and the law of speed assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        for c in core_compressor(network):
            yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        speed = relative_corrected_speed(at, c)

        def exit_flow(e: Evaluation, flow: Flow) -> Flow:
            return flow.with_(W=flow.W * (1.0 - at.c(e, "fraction") / speed(e)))

        at.on_station(c.values["to"], exit_flow)
