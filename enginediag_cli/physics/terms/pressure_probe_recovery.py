"""Recovery error of total-pressure probes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CORRECTED_SPEED
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import reading_at, readings, relative_flow

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class PressureProbeRecovery(Term):
    """Reading P (1 − k M²), M = M_design x at the probe's station."""

    NAME = "pressure_probe_recovery"
    TITLE = "Recovery error of a pressure probe"
    STATEMENT = (
        "A pressure probe at an angle to the flow or behind a wake catches only part of the dynamic pressure "
        "and reads low, the more the faster the gas passes it."
    )
    EQUATION = "reading = P (1 − k M²),  M = M_design (W√T/P)/(W√T/P)_design"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient("loss", "1", "loss k per M²", 0.0, 0.0, 0.1, 0.02, 0.02, assumed=True),
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
    REFERENCE = "Engineering judgement: k 0.005 to 0.03, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        return [r.site for r in readings(network, "P") if len(r.stations) == 1]

    def install(self, at: Place) -> None:
        r = reading_at(at, "P")
        relative = relative_flow(at, next(iter(r.stations)))

        def reading(e: Evaluation, P_read: Value) -> Value:
            mach = at.c(e, "design_mach") * relative(e)
            return P_read * (1.0 - at.c(e, "loss") * (mach * mach))

        at.on_reading(r.column, reading)
