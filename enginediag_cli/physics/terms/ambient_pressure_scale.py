"""Scale error of the barometer beside a ground engine."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class AmbientPressureScale(Term):
    """p₀ = recorded/(1 + s)."""

    NAME = "ambient_pressure_scale"
    TITLE = "Scale error of the ambient pressure"
    STATEMENT = (
        "The barometer beside the machine reads a constant share too high or too low, for instance because it "
        "stands at another height than the inlet."
    )
    EQUATION = "p_0 = p_0,recorded/(1 + s)"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient("error", "1", "scale error s of the reading", 0.0, -0.02, 0.02, 0.005, 0.005, assumed=True),
    )
    REFERENCE = "Engineering judgement: ± 0.5 %, assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        if not flies(network):
            yield Site("ambient", "ambient", ("ambient_pressure_Pa",), everywhere=True)

    def install(self, at: Place) -> None:
        def pressure(e: Evaluation, recorded: Value) -> Value:
            return recorded / (1.0 + at.c(e, "error"))

        at.on_leaf("ambient_pressure_Pa", pressure)
