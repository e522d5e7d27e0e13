"""Second-order lag of a load controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import SecondOrder
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import load_site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class LoadSecondOrderLag(Term):
    """τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded."""

    NAME = "load_second_order_lag"
    TITLE = "Second-order lag of the load controller"
    STATEMENT = (
        "The load begins to follow slowly and then approaches what is demanded: two lags in a row, of actuator "
        "and machine."
    )
    EQUATION = "τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "time_constant",
            "s",
            "τ = τ₁ + τ₂, of both together; 0: at once",
            0.0,
            0.0,
            5000.0,
            500.0,
            40.0,
            assumed=True,
        ),
        Coefficient(
            "second_share",
            "1",
            "τ₂/τ, share of the quicker one; 0: a lag of first order",
            0.5,
            0.0,
            0.5,
            0.5,
            0.4,
            assumed=True,
            free=True,
            closed=True,
        ),
    )
    REFERENCE = "governor and actuator in series: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    INPUTS = PAST
    TRIALS = tuple({"time_constant": t, "second_share": 0.4} for t in (2.0, 5.0, 12.0, 30.0, 75.0, 190.0, 480.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return load_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, SecondOrder(), ("time_constant", "second_share"))
