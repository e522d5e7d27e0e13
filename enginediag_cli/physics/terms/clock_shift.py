"""Clock of one column against the others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.moving.filters import Delay
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ClockShift(Term):
    """reading(t) = value(t − d)."""

    NAME = "clock_shift"
    TITLE = "Clock of a reading"
    STATEMENT = (
        "A reading that is written down later than the others, or that another box stamps by a clock of its own, shows "
        "what was some time ago; a clock that is behind shows what the others have yet to show."
    )
    EQUATION = "reading(t) = value(t − d)"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient("delay", "s", "d; negative: it is ahead of the others", 0.0, -60.0, 60.0, 10.0, 1.0, assumed=True),
    )
    REFERENCE = "the commonest mismatch of recordings that several boxes make; the range is assumed"
    INPUTS = PAST

    def sites(self, network: Network) -> Iterable[Site]:
        for s in network.sensors.values():
            yield Site(s.quantity, f"sensor.{s.quantity}", (f"reading {s.column}",))

    def install(self, at: Place) -> None:
        column = next(s.column for s in at.network.sensors.values() if s.quantity == at.site.name)
        shift = at.remember(Delay(), ("delay",), sensor=column)

        def reading(e: Evaluation, x: Value) -> Value:
            return x + shift(e, x)

        at.on_reading(column, reading)
