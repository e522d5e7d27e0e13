"""Discharge coefficient of nozzles that do not choke."""

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


class NozzleDischarge(Term):
    """C_d = C_d,design {1 − k [g(NPR) − g(NPR_design)]}, g falling from 1 at a pressure ratio of 1.2 to 0 far above
    choking; told as a factor on the area."""

    NAME = "nozzle_discharge"
    TITLE = "Nozzle discharge coefficient with pressure ratio"
    STATEMENT = (
        "A nozzle that does not choke passes less than its area promises: its discharge coefficient falls "
        "with the pressure ratio, at idle and on the ground most."
    )
    EQUATION = "C_d = C_d,design {1 − k [g(NPR) − g(NPR_design)]},  g = exp(−(NPR − 1.2)/0.4)"
    DRIVER = NOZZLE_PRESSURE_RATIO
    COEFFICIENTS = (
        Coefficient(
            "fall", "1", "fall k of C_d at a pressure ratio of 1.2, against a choked nozzle", 0.0, 0.0, 0.1, 0.03, 0.03
        ),
    )
    REFERENCE = (
        "NASA T-MATS, nozzle tables CdTh(PR): 0.93 to 0.99, 0.02 to 0.06 lower at 1.2 than choked; "
        "the exponential is assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Nozzle):
                yield Site(c.name, c.name, (f"{c.name}.area",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        station = at.component.values["from"]
        reference = unchoked_at_design(at.design, station)

        def area(e: Evaluation, factor: Value) -> Value:
            return factor * (1.0 - at.c(e, "fall") * (unchoked(e, station) - reference))

        at.on_leaf(f"{at.component.name}.area", area)
