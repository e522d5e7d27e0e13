"""Recovery error of temperature probes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import POWER
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import reading_at, readings, relative_flow

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ThermocoupleRecovery(Term):
    """Reading T − (1 − r)(T − T_s); T − T_s = T m/(1 + m), m = (γ − 1)/2 M², M = M_design x at the probe's station."""

    NAME = "thermocouple_recovery"
    TITLE = "Recovery error of a temperature probe"
    STATEMENT = (
        "A probe in fast gas does not bring it fully to rest and reads below the total temperature, by a "
        "share of the gas's dynamic temperature."
    )
    EQUATION = "reading = T − d T m/(1 + m),  m = (γ − 1)/2 M²,  M = M_design (W√T/P)/(W√T/P)_design"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient(
            "deficit",
            "1",
            "d = 1 − r, share of the dynamic temperature that is lost",
            0.0,
            0.0,
            0.25,
            0.05,
            0.05,
            assumed=True,
        ),
        Coefficient(
            "design_mach",
            "1",
            "Mach number at the probe at the design point",
            0.35,
            0.05,
            0.8,
            0.1,
            0.35,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = "SAE AIR46 (r 0.80 to 0.98); J. Eng. Power 75 (1) 7, ASME"

    def sites(self, network: Network) -> Iterable[Site]:
        return [r.site for r in readings(network, "T")]

    def install(self, at: Place) -> None:
        r = reading_at(at, "T")
        relative = {s: relative_flow(at, s) for s in r.stations}

        def reading(e: Evaluation, T_read: Value) -> Value:
            lost: Value = 0.0
            for station, weight in r.stations.items():
                flow = e.flows[station]
                mach = at.c(e, "design_mach") * relative[station](e)
                cp, R = flow.gas.heat_capacity(flow.T, flow.mixture), flow.R
                m = 0.5 * R / (cp - R) * (mach * mach)
                lost = lost + weight * flow.T * m / (1.0 + m)
            return T_read - at.c(e, "deficit") * lost

        at.on_reading(r.column, reading)
