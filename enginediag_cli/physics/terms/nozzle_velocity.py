"""Velocity coefficient of nozzles that do not choke."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import NOZZLE_PRESSURE_RATIO
from enginediag_cli.engine.components.nozzles import Nozzle
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import unchoked, unchoked_at_design

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class NozzleVelocity(Term):
    """C_v = C_v,design {1 − k [g(NPR) − g(NPR_design)]}; only the thrust knows of it."""

    NAME = "nozzle_velocity"
    TITLE = "Nozzle velocity coefficient with pressure ratio"
    STATEMENT = (
        "At low pressure ratio friction costs the jet a larger share of its velocity: there is less thrust, "
        "and nothing else in the engine notices."
    )
    EQUATION = "C_v = C_v,design {1 − k [g(NPR) − g(NPR_design)]},  g = exp(−(NPR − 1.2)/0.4)"
    DRIVER = NOZZLE_PRESSURE_RATIO
    COEFFICIENTS = (
        Coefficient(
            "fall",
            "1",
            "fall k of C_v at a pressure ratio of 1.2, against a choked nozzle",
            0.0,
            0.0,
            0.05,
            0.01,
            0.01,
            assumed=True,
        ),
    )
    REFERENCE = "NASA T-MATS and AGTF30, nozzle tables Cv and Cfg: 0.97 to 0.9999; the exponential is assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Nozzle):
                yield Site(c.name, c.name, (f"{c.name}.velocity_coefficient",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        station = at.component.values["from"]
        reference = unchoked_at_design(at.design, station)

        def coefficient(e: Evaluation, C_v: Value) -> Value:
            return C_v * (1.0 - at.c(e, "fall") * (unchoked(e, station) - reference))

        at.on_leaf(f"{at.component.name}.velocity_coefficient", coefficient)
