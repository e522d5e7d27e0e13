"""Rate limit of a load controller."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.moving.filters.per_full import PerFull
from enginediag_cli.engine.moving.filters.rate_limit import RateLimit
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.demanded import full, load_site

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


ONE_SIDED = 0.1
"""Of the time in one direction, that of the other in trials of one direction: at 0 nothing would show whether it is."""


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
    COEFFICIENTS = (
        Coefficient(
            "rise",
            "s",
            "t_up, time in which the load may rise by the design power; 0: at once",
            0.0,
            0.0,
            1e5,
            1000.0,
            100.0,
            assumed=True,
            per_full=True,
        ),
        Coefficient(
            "fall",
            "s",
            "t_down, time in which the load may fall by the design power; 0: at once",
            0.0,
            0.0,
            1e5,
            1000.0,
            100.0,
            assumed=True,
            per_full=True,
        ),
    )
    REFERENCE = "IEEE Std 421.5 and IEEE Task Force on turbine-governor modelling: ramp limiters; ranges assumed"
    INPUTS = PAST
    TRIALS = tuple(
        {"rise": rise * t, "fall": fall * t}
        for t in (4.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0)
        for rise, fall in ((1.0, 1.0), (1.0, ONE_SIDED), (ONE_SIDED, 1.0))
    )

    def sites(self, network: Network) -> Iterable[Site]:
        return load_site(network)

    def install(self, at: Place) -> None:
        at.on_input(at.network.power_setting, PerFull(RateLimit(), full(at.network)), ("rise", "fall"))
