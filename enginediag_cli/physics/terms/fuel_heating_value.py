"""Heating value of the fuel batch."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class FuelHeatingValue(Term):
    """LHV = LHV_declared (1 + d), constant for a batch of fuel."""

    NAME = "fuel_heating_value"
    TITLE = "Heating value of the fuel"
    STATEMENT = (
        "Another batch of fuel holds more or less heat per kilogram than assumed; within one recording this "
        "looks like a change of combustion efficiency or of the fuel meter."
    )
    EQUATION = "LHV = LHV_declared (1 + d)"
    DRIVER = CONSTANT
    COEFFICIENTS = (Coefficient("deviation", "1", "deviation d of the batch", 0.0, -0.02, 0.02, 0.005, 0.005),)
    REFERENCE = "Jet fuel 42.8 to 43.6 MJ/kg, ± 1 %; NASA AGTF30 reckons with 42.8 MJ/kg"

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Burner):
                yield Site(c.name, c.name, (f"{c.name}.lower_heating_value_J_kg",))

    def install(self, at: Place) -> None:
        def heat(e: Evaluation, declared: Value) -> Value:
            return declared * (1.0 + at.c(e, "deviation"))

        at.on_leaf(f"{at.site.name}.lower_heating_value_J_kg", heat)
