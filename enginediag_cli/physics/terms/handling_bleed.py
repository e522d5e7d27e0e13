"""Handling (blow-off, variable bleed) valve behind the booster or the only compressor."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.components.compressor import Compressor
from enginediag_cli.engine.dual import Value, exp
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor, relative_corrected_speed, upstream

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


OPEN_BELOW = Coefficient(
    "open_below",
    "1",
    "n_open, relative corrected speed at which the valve is half open",
    0.85,
    0.4,
    1.1,
    0.05,
    0.85,
    assumed=True,
    shape=True,
)


Share = Callable[[Evaluation], Value]
"""What a number is at a point (N,): a relative corrected speed, a share of the flow."""


class CompressorValve(Term):
    """A valve behind a compressor that lets a share of its air out, by the compressor's relative corrected speed."""

    @abstractmethod
    def bled(self, at: Place, speed: Share) -> Share:
        """The share of the flow that leaves."""

    def sites(self, network: Network) -> Iterable[Site]:
        c = valve(network)
        if c is not None:
            yield Site(c.name, c.name, (f"station {c.values['to']}",))

    def install(self, at: Place) -> None:
        c = at.component
        assert isinstance(c, Compressor)
        share = self.bled(at, relative_corrected_speed(at, c))

        def exit_flow(e: Evaluation, flow: Flow) -> Flow:
            return flow.with_(W=flow.W * (1.0 - share(e)))

        at.on_station(c.values["to"], exit_flow)


class HandlingBleed(CompressorValve):
    """W_out = W [1 − b s(n)], s = 1/(1 + exp[(n − n_open)/Δn]), n = N_c/N_c,design of the site's compressor.

    The air leaves the engine; what it would add to a bypass stream is neglected. An engine without booster blows
    off behind its compressor.
    """

    NAME = "handling_bleed"
    TITLE = "Handling bleed"
    STATEMENT = (
        "Below a certain speed a valve lets compressed air out to keep the compressor from surge; what "
        "lies behind it gets less flow there."
    )
    EQUATION = "W = W_exit (1 − b/(1 + exp[(N_c/N_c,design − n_open)/Δn]))"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient("fraction", "1", "b, bleed over flow with the valve open", 0.0, 0.0, 0.25, 0.05, 0.08),
        OPEN_BELOW,
        Coefficient(
            "width",
            "1",
            "Δn, relative corrected speed over which it moves",
            0.03,
            0.01,
            0.2,
            0.02,
            0.03,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = "NASA AGTF30 variable bleed valve (0 to 15 % of booster flow); speed and width of opening assumed"

    def bled(self, at: Place, speed: Share) -> Share:
        def open_share(e: Evaluation) -> Value:
            closed = exp((speed(e) - at.c(e, "open_below")) / at.c(e, "width"))
            return at.c(e, "fraction") / (1.0 + closed)

        return open_share


def valve(network: Network) -> Compressor | None:
    """The compressor behind which the valve lies: the booster, or else the core compressor itself; none at constant
    speed, where the valve is a matter of starting."""
    for core in core_compressor(network):
        if network.shafts[core.values["shaft"]]["speed"] != "constant":
            before = upstream(network, core.values["from"])
            return before if isinstance(before, Compressor) else core
    return None
