"""Scale error of the fuel meter, where fuel flow is given to the model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class FuelMeterScale(Term):
    """W_f = recorded/(1 + s); where fuel flow is an output, its sensor's scale is this error."""

    NAME = "fuel_meter_scale"
    TITLE = "Scale error of the fuel meter"
    STATEMENT = (
        "The fuel meter shows a constant share more or less than flows; within one recording this looks like "
        "another heating value of the fuel."
    )
    EQUATION = "W_f = W_f,recorded/(1 + s)"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient("error", "1", "scale error s of the reading", 0.0, -0.03, 0.03, 0.01, 0.01, assumed=True),
    )
    REFERENCE = "Engineering judgement: ± 1 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "Wf_kg_s" and network.given_leaf:
            yield Site("Wf", "sensor.Wf", (network.given_leaf,))

    def install(self, at: Place) -> None:
        leaf = at.network.given_leaf
        assert leaf is not None

        def fuel(e: Evaluation, recorded: Value) -> Value:
            return recorded / (1.0 + at.c(e, "error"))

        at.on_leaf(leaf, fuel)
