"""Bleed from between the stages of the last compressor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import SWITCH
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class InterstageBleed(Term):
    """W_out = W − b W_in; the air leaves with a part w of the work, and the shaft gives (1 − w) Δh less for it."""

    NAME = "interstage_bleed"
    TITLE = "Interstage bleed"
    STATEMENT = (
        "Air is taken between the compressor's stages: the turbines get less gas, but only a part of the "
        "compressor's work is spent on the air that leaves."
    )
    EQUATION = "W_exit = W_exit,0 − b W_in,  P_shaft = W_in Δh − b W_in (1 − w) Δh"
    DRIVER = SWITCH
    COEFFICIENTS = (
        Coefficient("fraction", "1", "b, bleed over compressor inlet flow", 0.0, 0.0, 0.12, 0.03, 0.03, assumed=True),
        Coefficient(
            "work_fraction",
            "1",
            "w, share of the enthalpy rise done on the bleed",
            0.5,
            0.0,
            1.0,
            0.15,
            0.5,
            shape=True,
        ),
    )
    REFERENCE = "NASA AGTF30 setup_HPC (interstage port: enthalpy fraction 0.50); SAE AIR1168; 0 to 8 % assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        for c in core_compressor(network):
            yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        entry = c.values["from"]

        def exit_flow(e: Evaluation, flow: Flow) -> Flow:
            inlet = e.flows[entry]
            taken = inlet.W * at.c(e, "fraction")
            # the compressor has charged its shaft with the full rise just before it delivers its flow
            shaft = e.shaft(c.values["shaft"])
            shaft.demand_W = shaft.demand_W - taken * (1.0 - at.c(e, "work_fraction")) * (flow.h - inlet.h)
            return flow.with_(W=flow.W - taken)

        at.on_station(c.values["to"], exit_flow)
