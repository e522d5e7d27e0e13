"""Scale error of a speed reading that is given to the model."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class SpeedScale(Term):
    """N = recorded/(1 + s); where a speed is an output, its sensor's scale is this error."""

    NAME = "speed_scale"
    TITLE = "Scale error of a speed reading"
    STATEMENT = (
        "The speed that sets the model's power is recorded a constant share too high or too low, for instance "
        "by another 100 % speed than assumed."
    )
    EQUATION = "N = N_recorded/(1 + s)"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient("error", "1", "scale error s of the reading", 0.0, -0.02, 0.02, 0.005, 0.005, assumed=True),
    )
    REFERENCE = "Engineering judgement: ± 1 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for column, shaft in network.speed_columns.items():
            if column == network.power_setting or network.shafts[shaft]["speed"] == "input":
                label = network.shafts[shaft]["speed_label"]
                yield Site(label, f"sensor.{label}", (f"{shaft}.speed_rpm",))

    def install(self, at: Place) -> None:
        shaft = at.network.speed_columns[f"{at.site.name}_rpm"]

        def speed(e: Evaluation, recorded: Value) -> Value:
            return recorded / (1.0 + at.c(e, "error"))

        at.on_leaf(f"{shaft}.speed_rpm", speed)
