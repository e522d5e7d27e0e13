"""Rate limit of a fuel actuator."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import PerFull, RateLimit
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Place, Site, Term
from enginediag_cli.physics.parts import fuel_site, full, rate_limits, rate_trials

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class FuelRateLimit(Term):
    """−W_full/t_down ≤ dW_f/dt ≤ W_full/t_up: the fuel follows what is commanded, but not faster."""

    NAME = "fuel_rate_limit"
    TITLE = "Rate limit of the fuel actuator"
    STATEMENT = (
        "The fuel valve or its schedule opens and closes at a limited rate: a larger step takes longer, in proportion."
    )
    EQUATION = "dW_f/dt = min(max(dW_f,commanded/dt, −W_full/t_down), W_full/t_up) until W_f = W_f,commanded"
    DRIVER = RATE
    COEFFICIENTS = rate_limits("fuel", "the design flow", 100.0, 10.0)
    REFERENCE = (
        "acceleration and deceleration limiters of fuel controls: Walsh and Fletcher, Gas Turbine "
        "Performance, ch. 8; ranges assumed"
    )
    INPUTS = PAST
    TRIALS = rate_trials(2.0, 5.0, 12.0, 30.0)

    def sites(self, network: Network) -> Iterable[Site]:
        return fuel_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, PerFull(RateLimit(), full(at.network)), ("rise", "fall"))
