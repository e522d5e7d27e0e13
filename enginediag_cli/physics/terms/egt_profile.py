"""Temperature profile behind the burner, as a harness of thermocouples sees it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import BURNER_TEMPERATURE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import burner, hot_readings, reading_at

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class EgtProfile(Term):
    """Reading T + k [(T₄ − T₃) − (T₄ − T₃)_design]: the probes stand at a hot or cold streak of the burner's rise."""

    NAME = "egt_profile"
    TITLE = "Temperature profile at the exhaust-gas probes"
    STATEMENT = (
        "The probes of the exhaust-gas temperature do not stand at the mean of the gas: hot and cold streaks "
        "behind the burner shift the reading in proportion to its temperature rise."
    )
    EQUATION = "reading = T + k [(T_4 − T_3) − (T_4 − T_3)_design]"
    DRIVER = BURNER_TEMPERATURE
    COEFFICIENTS = (
        Coefficient(
            "factor", "1", "shift k over the burner's temperature rise", 0.0, -0.04, 0.04, 0.01, 0.01, assumed=True
        ),
    )
    REFERENCE = "Engineering judgement: ± 0.005 to 0.03 of T4 − T3, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        exit_station = burner(network).values["to"]
        return [r.site for r in hot_readings(network) if exit_station not in r.stations]

    def install(self, at: Place) -> None:
        values = burner(at.network).values
        before, behind = values["from"], values["to"]
        reference = scalar(at.design.flows[behind].T - at.design.flows[before].T)

        def reading(e: Evaluation, T_read: Value) -> Value:
            return T_read + at.c(e, "factor") * (e.flows[behind].T - e.flows[before].T - reference)

        at.on_reading(reading_at(at, "T").column, reading)
