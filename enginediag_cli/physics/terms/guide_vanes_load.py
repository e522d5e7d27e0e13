"""Guide vanes of a machine of constant speed, closed as its load falls."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import POWER
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Inlet
from enginediag_cli.engine.dual import Value, exp, log, select, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import core_compressor
from enginediag_cli.physics.terms.guide_vanes import install_vanes
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network

KNEE = 0.05
"""Width of the knee at base load, of the scale over which the vanes close."""


class GuideVanesLoad(Term):
    """Δφ = φ (1 − exp(−u/ε)) with u = max(0, 1 − x/x_design), rounded over a small knee; flow and efficiency as in
    `guide_vanes`.

    At constant speed the vanes alone set the flow. At base load, where the power setting x is its design value,
    they are open; below it the control closes them, lets the firing temperature fall a little to hold the exhaust
    at its limit, and stops at an angle φ. Where T4 is the power setting its own fall, uncorrected as the limit is,
    tells the position (ε = ε_T); where power or fuel is, the fall of load does (ε = ε_L).
    """

    NAME = "guide_vanes_load"
    TITLE = "Guide vanes closed with load"
    STATEMENT = (
        "A machine of constant speed closes its guide vanes as its load falls, to hold the exhaust hot; the "
        "compressor swallows less air than the map says."
    )
    EQUATION = (
        "W_c = W_c,map exp(−a Δφ),  η = η_map/(1 + b Δφ²),  Δφ = φ (1 − exp(−u/ε)),  "
        "u = (ε/20) ln(1 + exp[20 (1 − x/x_design)/ε]),  x = power setting"
    )
    DRIVER = POWER
    COEFFICIENTS = (
        Coefficient("closing_deg", "deg", "φ, closing at low load", 0.0, 0.0, 60.0, 15.0, 20.0, assumed=True),
        Coefficient(
            "temperature_scale",
            "1",
            "ε_T, relative fall of T4 in which 63 % of it happens",
            0.02,
            0.005,
            0.2,
            0.01,
            0.02,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "load_scale",
            "1",
            "ε_L, the same as a fall of power or fuel",
            0.3,
            0.1,
            1.0,
            0.1,
            0.3,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "flow_per_deg",
            "1/deg",
            "a, fall of corrected flow per degree of closing",
            0.01,
            0.005,
            0.015,
            0.003,
            0.01,
            assumed=True,
            shape=True,
        ),
        Coefficient(
            "loss_per_deg2",
            "1/deg2",
            "b, fall of efficiency per square degree",
            5e-5,
            0.0,
            5e-4,
            5e-5,
            5e-5,
            assumed=True,
            shape=True,
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (part load with variable vanes); a 0.5 to "
        "1.5 %/deg, b and the scales assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        for c in core_compressor(network):
            if network.shafts[c.values["shaft"]]["speed"] == "constant":
                yield Site(c.name, c.name, (f"{c.name}.flow_capacity", f"{c.name}.efficiency"))

    def install(self, at: Place) -> None:
        column = at.network.power_setting
        leaf = at.network.leaf_of(column)
        scale = "temperature_scale" if split_column(column)[1] == "K" else "load_scale"
        base = scalar(at.network.read(at.design, column))

        def closing(e: Evaluation) -> Value:
            below = smooth_positive((1.0 - e[leaf] * (1.0 / base)) / at.c(e, scale), KNEE)
            return at.c(e, "closing_deg") * (1.0 - exp(-1.0 * below))

        install_vanes(at, at.site.name, closing)
        # the flow is sought relative to what the vanes let through: the answer is the same, but the iteration need
        # not find its way from an open compressor to one that is closed by a quarter
        for c in at.network.components:
            if isinstance(c, Inlet):
                at.on_leaf(
                    f"{c.name}.corrected_flow", lambda e, x: x * exp(-1.0 * (at.c(e, "flow_per_deg") * closing(e)))
                )


def smooth_positive(x: Value, width: float) -> Value:
    """w ln(1 + exp(x/w)): x where it is well above zero, 0 well below, analytic in between."""
    z = x * (1.0 / width)
    above = np.asarray(value(z) > 0.0)
    return width * select(above, z + log(1.0 + exp(-1.0 * z)), log(1.0 + exp(z)))
