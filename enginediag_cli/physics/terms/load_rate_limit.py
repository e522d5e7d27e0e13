"""Rate limit of a load controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters import PerFull, RateLimit
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Place, Site, Term
from enginediag_cli.physics.parts import full, load_site, rate_limits, rate_trials

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class LoadRateLimit(Term):
    """−P_full/t_down ≤ dP/dt ≤ P_full/t_up: the load follows what is demanded, but not faster."""

    NAME = "load_rate_limit"
    TITLE = "Rate limit of the load controller"
    STATEMENT = (
        "The controller of the load takes up and gives away power at a limited rate, whatever the size of the step "
        "that is demanded: a larger step takes longer, in proportion."
    )
    EQUATION = "dP/dt = min(max(dP_demanded/dt, −P_full/t_down), P_full/t_up) until P = P_demanded"
    DRIVER = RATE
    COEFFICIENTS = rate_limits("load", "the design power", 1000.0, 100.0)
    REFERENCE = "IEEE Std 421.5 and IEEE Task Force on turbine-governor modelling: ramp limiters; ranges assumed"
    INPUTS = PAST
    TRIALS = rate_trials(4.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0)

    def sites(self, network: Network) -> Iterable[Site]:
        return load_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, PerFull(RateLimit(), full(at.network)), ("rise", "fall"))
