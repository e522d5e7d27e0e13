"""Tip clearance while rotor, disc and casing grow at different paces."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import RATE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.dual import Array, Value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.moving.filters import Lag, ScaledIntegrated
from enginediag_cli.engine.moving.tape import PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor, turbines

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ClearanceTransient(Term):
    """η = η_map [1 + k (s_metal − s)], τ ds_metal/dt = s − s_metal, s = (N/N_design)².

    The blades' pull and the heat that comes with the power go with N²; discs follow within minutes. The steady gap is
    the map's. k > 0: the rotor is behind the casing, so that the gap is wide after an acceleration; k < 0: the casing
    is behind.
    """

    NAME = "clearance_transient"
    TITLE = "Tip clearance after a change of power"
    STATEMENT = (
        "After an acceleration the casing is warm before the disc is: for some minutes the gap over the blades is "
        "wider than in the steady state, and efficiency lower; after a deceleration it is the other way round. Of "
        "thick casings the rotor is the faster one."
    )
    EQUATION = "η = η_map [1 + k (s_metal − s)],  τ ds_metal/dt = s − s_metal,  s = (N/N_design)²"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "loss",
            "1",
            "k, relative loss of efficiency per growth of N² by that of the design point",
            0.0,
            -0.1,
            0.1,
            0.03,
            0.02,
            assumed=True,
        ),
        Coefficient(
            "time_constant",
            "s",
            "τ, in which the slower part grows by 63 %",
            90.0,
            2.0,
            1800.0,
            200.0,
            60.0,
            assumed=True,
            free=True,
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8; Lattime and Steinetz, NASA/TM-2002-211794 "
        "(paces of casing and disc); ranges assumed"
    )
    INPUTS = PAST
    MEASURED = True
    TRIALS = tuple({"loss": 0.02, "time_constant": t} for t in (10.0, 40.0, 150.0, 600.0))

    def sites(self, network: Network) -> Iterable[Site]:
        for c in (*core_compressor(network), *turbines(network)):
            if network.shafts[c.values["shaft"]]["speed"] != "constant":
                yield Site(c.name, c.name, (f"{c.name}.efficiency",))

    def install(self, at: Place) -> None:
        assert at.component is not None
        shaft = at.component.values["shaft"]
        design = scalar(at.design.shafts[shaft].speed_rpm)
        column = next(c for c, s in at.network.speed_columns.items() if s == shaft)

        def pull(speed_rpm: Array) -> Array:
            return np.asarray((speed_rpm / design) ** 2)

        behind = at.remember(ScaledIntegrated(Lag()), ("loss", "time_constant"), recorded=column, measured=pull)

        def efficiency(e: Evaluation, factor: Value) -> Value:
            n = e.shaft(shaft).speed_rpm * (1.0 / design)
            return factor * (1.0 + behind(e, n * n))

        at.on_leaf(f"{at.site.name}.efficiency", efficiency)
