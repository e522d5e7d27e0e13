"""Lag of a load controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import Lag
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import load_site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class LoadControlLag(Term):
    """τ dP/dt = P_demanded − P."""

    NAME = "load_control_lag"
    TITLE = "Lag of the load controller"
    STATEMENT = (
        "The load approaches what is demanded the faster the farther it is from it: steps of all sizes take "
        "the same time."
    )
    EQUATION = "τ dP/dt = P_demanded − P"
    DRIVER = RATE
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", 0.0, 0.0, 5000.0, 500.0, 30.0, assumed=True),)
    REFERENCE = "first-order governor models: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    INPUTS = PAST
    TRIALS = tuple({"time_constant": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return load_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, Lag(), ("time_constant",))
