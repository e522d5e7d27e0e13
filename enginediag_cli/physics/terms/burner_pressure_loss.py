"""Cold pressure loss of the burner."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import POWER
from enginediag_cli.engine.components.combustion import Burner
from enginediag_cli.engine.dual import Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import relative_flow

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class BurnerPressureLoss(Term):
    """ΔP/P = λ [1 + s (x² − 1)], x the corrected flow that enters the burner over its design value."""

    NAME = "burner_pressure_loss"
    TITLE = "Burner pressure loss with flow"
    STATEMENT = (
        "The swirlers and holes of the burner take pressure with the square of the corrected flow, not the "
        "same share at every power."
    )
    EQUATION = "ΔP/P = λ [1 + s (x² − 1)],  x = (W√T/P)/(W√T/P)_design at its inlet"
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient("share", "1", "share s of the loss that follows the flow", 0.0, 0.0, 1.5, 0.5, 0.9, assumed=True),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (cold loss); NASA AGTF30 and T-MATS carry a "
        "constant 0.04"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in network.components:
            if isinstance(c, Burner) and c.values["pressure_loss"] > 0.0:
                yield Site(c.name, c.name, (f"{c.name}.pressure_loss",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        relative = relative_flow(at, at.component.values["from"])

        def loss(e: Evaluation, constant: Value) -> Value:
            x = relative(e)
            return constant * (1.0 + at.c(e, "share") * (x * x - 1.0))

        at.on_leaf(f"{at.component.name}.pressure_loss", loss)
