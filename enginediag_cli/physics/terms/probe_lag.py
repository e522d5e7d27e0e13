"""Lag of a temperature probe."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.moving.filters import Lag
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import reading_at, readings

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ProbeLag(Term):
    """τ dT_read/dt = T − T_read."""

    NAME = "probe_lag"
    TITLE = "Lag of a temperature probe"
    STATEMENT = (
        "A probe warms and cools with its own time constant: what it reads is behind the gas while that changes."
    )
    EQUATION = "τ dT_read/dt = T − T_read"
    DRIVER = RATE
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", 0.0, 0.0, 300.0, 30.0, 4.0, assumed=True),)
    REFERENCE = "SAE AIR46: 0.5 to 10 s for shielded thermocouples in gas streams; the range is assumed"
    INPUTS = PAST
    TRIALS = tuple({"time_constant": t} for t in (1.0, 4.0, 16.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return [r.site for r in readings(network, "T")]

    def install(self, at: Place) -> None:
        column = reading_at(at, "T").column
        behind = at.remember(Lag(), ("time_constant",), sensor=column)

        def reading(e: Evaluation, T_read: Value) -> Value:
            return T_read + behind(e, T_read)

        at.on_reading(column, reading)
