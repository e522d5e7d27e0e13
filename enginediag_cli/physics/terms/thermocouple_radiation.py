"""Radiation error of thermocouples in hot gas."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import BURNER_TEMPERATURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value, sqrt
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import hot_readings, reading_at

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ThermocoupleRadiation(Term):
    """Reading T − εσ(T⁴ − T_w⁴)/h with walls at a fixed share of the gas temperature and h ∝ W^0.5, told by the error
    at the design point: a (T/T_design)⁴ (W/W_design)^(−0.5)."""

    NAME = "thermocouple_radiation"
    TITLE = "Radiation error of a thermocouple"
    STATEMENT = (
        "A thermocouple in hot gas radiates to the cooler walls and reads low: with the fourth power of "
        "temperature, and more where little gas flows past it."
    )
    EQUATION = "reading = T − a (T/T_design)^4 (W/W_design)^(−0.5),  from ε σ (T^4 − T_w^4)/h, T_w ∝ T, h ∝ W^0.5"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (Coefficient("error_K", "K", "error a at the design point", 0.0, 0.0, 30.0, 5.0, 5.0, assumed=True),)
    REFERENCE = (
        "SAE AIR46; 2 to 15 K at 900 to 1000 K computed for ε 0.3 to 0.8 and h 1000 to 2000 W/(m² K); "
        "wall temperature assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        return [r.site for r in hot_readings(network)]

    def install(self, at: Place) -> None:
        r = reading_at(at, "T")
        reference = {s: scalar(_radiated(at.design.flows[s])) for s in r.stations}

        def reading(e: Evaluation, T_read: Value) -> Value:
            lost: Value = 0.0
            for station, weight in r.stations.items():
                lost = lost + _radiated(e.flows[station]) * (weight / reference[station])
            return T_read - at.c(e, "error_K") * lost

        at.on_reading(r.column, reading)


def _radiated(flow: Flow) -> Value:
    """T⁴/√W."""
    square = flow.T * flow.T
    return square * square / sqrt(flow.W)
