"""Temperatures that a control computes from other readings as if ambient pressure were standard."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import AMBIENT_PRESSURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value, exp, log
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies, hot_readings, reading_at

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


EXPONENT = 0.22  # T/T_exhaust = (P/p₀)^n, n = η_p (γ − 1)/γ of burnt gas
SETTING = "T4_K"


class ComputedReading(Term):
    """Reading T (p₀/p₀,design)^(n κ), n = 0.22: a temperature that was computed from another through the turbine's
    expansion, with the design's ambient pressure at its end. κ = 1: it ignores ambient pressure altogether. A power
    setting T₄ that is recorded so is corrected before the model meets it."""

    NAME = "computed_reading"
    TITLE = "Reading computed without ambient pressure"
    STATEMENT = (
        "The temperature is no measurement: the control computes it from exhaust temperature and compressor "
        "pressure and leaves ambient pressure out, so it is wrong when the barometer is high or low."
    )
    EQUATION = "reading = T (p_0/p_0,design)^(0.22 κ)"
    DRIVER = AMBIENT_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "ignored",
            "1",
            "share κ of the ambient pressure's effect that the computation leaves out",
            0.0,
            0.0,
            1.5,
            0.5,
            0.9,
            assumed=True,
        ),
    )
    REFERENCE = (
        "Found in the power-plant recordings of UCI repository no. 551: turbine inlet temperature low by "
        "300 K κ ln(p_0/1013 hPa), κ 0.9 to 1.1; polytropic expansion, n assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            return
        yield from (r.site for r in hot_readings(network))
        if network.power_setting == SETTING:
            yield Site("T4", "sensor.T4", (SETTING,))

    def install(self, at: Place) -> None:
        reference = scalar(at.design.outputs["P0_Pa"])

        def ratio(e: Evaluation, sign: float) -> Value:
            return exp(at.c(e, "ignored") * (log(e.outputs["P0_Pa"] * (1.0 / reference)) * (sign * EXPONENT)))

        if at.site.acts_on == (SETTING,):
            at.on_leaf(SETTING, lambda e, recorded: recorded * ratio(e, -1.0))
        else:
            at.on_reading(reading_at(at, "T").column, lambda e, T_read: T_read * ratio(e, 1.0))
