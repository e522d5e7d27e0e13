"""Rate limit of an actuator whose position is commanded by a recorded column."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.controls.actuators import Recorded
from enginediag_cli.engine.moving.filters import PerFull, RateLimit
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Place, Site, Term
from enginediag_cli.physics.parts import rate_limits, rate_trials

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ActuatorRateLimit(Term):
    """−way/t_down ≤ dx/dt ≤ way/t_up: the position follows what is recorded of it, a command, but not faster."""

    NAME = "actuator_rate_limit"
    TITLE = "Rate limit of an actuator"
    STATEMENT = (
        "What is recorded is where vanes, a nozzle or a valve are to stand; they get there at a limited rate: a longer "
        "way takes longer, in proportion."
    )
    EQUATION = "dx/dt = min(max(dx_recorded/dt, −way/t_down), way/t_up) until x = x_recorded"
    DRIVER = RATE
    COEFFICIENTS = rate_limits("position", "all its way between the stops", 20.0, 5.0)
    REFERENCE = "actuator slew limits: Walsh and Fletcher, Gas Turbine Performance, ch. 8; ranges assumed"
    INPUTS = PAST
    TRIALS = rate_trials(1.0, 3.0, 10.0, 30.0)

    def sites(self, network: Network) -> Iterable[Site]:
        for control, way in _recorded(network):
            yield Site(control.name, control.name, (control.column,), full=(way, control.actuator.unit))

    def install(self, at: Place) -> None:
        control, way = next(c for c in _recorded(at.network) if c[0].name == at.site.name)
        at.on_input(control.column, PerFull(RateLimit(), way), ("rise", "fall"))


def _recorded(network: Network) -> Iterator[tuple[Recorded, float]]:
    """Controls of which the position is recorded, and the actuator's way."""
    for control in network.controls:
        if isinstance(control, Recorded):
            yield control, control.actuator.upper - control.actuator.lower
