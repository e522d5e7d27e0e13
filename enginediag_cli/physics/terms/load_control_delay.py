"""Delay of a load controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import Delay
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import load_site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class LoadControlDelay(Term):
    """P(t) = P_demanded(t − d)."""

    NAME = "load_control_delay"
    TITLE = "Delay of the load controller"
    STATEMENT = (
        "What is demanded reaches the load some time later, unchanged: signal ways, sampling, a column that was "
        "recorded late."
    )
    EQUATION = "P(t) = P_demanded(t − d)"
    DRIVER = RATE
    COEFFICIENTS = (Coefficient("delay", "s", "d; 0: at once", 0.0, 0.0, 3600.0, 100.0, 10.0, assumed=True),)
    REFERENCE = "transport and sampling delays of control loops; the range is assumed"
    INPUTS = PAST
    TRIALS = tuple({"delay": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return load_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, Delay(), ("delay",))
