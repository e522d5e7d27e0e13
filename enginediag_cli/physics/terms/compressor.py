"""Effects on compressors and fans: fouling, the root of the fan, guide vanes off their schedule."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import BYPASS_RATIO, CORRECTED_SPEED, HOURS, POWER
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Inlet, Splitter
from enginediag_cli.engine.components.turbomachinery import Compressor
from enginediag_cli.engine.dual import Value, exp, log, select, value
from enginediag_cli.engine.evaluation import Evaluation, Flow
from enginediag_cli.engine.maps import closed_efficiency, closed_flow
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import (
    Quantity,
    component_sites,
    compressors,
    core_compressor,
    has_variable_speed,
    relative_corrected_speed,
    upstream,
)
from enginediag_cli.units import split_column

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


def upstream_fan(network: Network, splitter: Splitter) -> Compressor | None:
    """The fan whose flow the splitter divides."""
    c = upstream(network, splitter.values["from"])
    return c if isinstance(c, Compressor) else None


def fans(network: Network) -> dict[str, tuple[Compressor, Splitter]]:
    """By its name each compressor that feeds a splitter, and the splitter."""
    splitters = [c for c in network.components if isinstance(c, Splitter)]
    return {fan.name: (fan, s) for s in splitters if (fan := upstream_fan(network, s)) is not None}


SINCE_WASH = "hours_since_wash_h"


class Fouling(Term):
    """W_c = W_c,map (1 − a s), η = η_map (1 − r a s), s = 1 − exp(−t/τ): deposits grow until as much is carried
    off as settles."""

    NAME = "fouling"
    TITLE = "Fouling since the last wash"
    STATEMENT = (
        "Dirt settles on the compressor's blades after a wash, fast at first: it loses flow, and efficiency "
        "with it, until the next wash."
    )
    EQUATION = "W_c = W_c,map (1 − a s),  η = η_map (1 − r a s),  s = 1 − exp(−t/τ),  t = hours since the wash"
    DRIVER = HOURS
    COEFFICIENTS = (
        Coefficient(
            "flow_loss",
            "1",
            "a, loss of corrected flow in the long run",
            upper=0.1,
            sigma=0.02,
            typical=0.03,
            cited=True,
        ),
        shape_coefficient(
            "efficiency_share",
            "1",
            "r, loss of efficiency over loss of flow",
            value=0.5,
            upper=1.5,
            sigma=0.25,
            cited=True,
        ),
        shape_coefficient(
            "hours", "h", "τ, time in which 63 % of it has settled", value=500.0, lower=20.0, upper=5000.0, sigma=300.0
        ),
    )
    REFERENCE = (
        "Aker & Saravanamuttoo 1989, J. Eng. Gas Turbines Power 111, 343; Mathioudakis 2024; flow to "
        "efficiency 3:1 to 1:1; time assumed"
    )
    INPUTS = MappingProxyType({SINCE_WASH: 0.0})

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(
            [c for c in compressors(network) if c.name not in fans(network)], "flow_capacity", "efficiency"
        )

    def install(self, at: Place) -> None:
        def deposits(e: Evaluation) -> Value:
            return at.c(e, "flow_loss") * (1.0 - exp(-1.0 * e[SINCE_WASH] / at.c(e, "hours")))

        flow, efficiency = at.site.targets
        at.change_leaf(flow, lambda e, factor: factor * (1.0 - deposits(e)))
        at.change_leaf(efficiency, lambda e, factor: factor * (1.0 - at.c(e, "efficiency_share") * deposits(e)))


class FanSplit(Term):
    """Efficiency of the fan's root changed by a ln(BPR/BPR_design): at the same enthalpy rise Δh of the fan the core's
    flow leaves it at another pressure,

        P_core = P_fan exp[a ln(BPR/BPR_design) Δh/(R T)],   Δh, R, T of the flow behind the fan.
    """

    NAME = "fan_split"
    TITLE = "Fan root with bypass ratio"
    STATEMENT = (
        "The inner part of the fan, which feeds the core, does not work as the whole fan does once the bypass "
        "ratio leaves its design value."
    )
    EQUATION = "P_core = P_fan exp[a ln(BPR/BPR_design) Δh_fan/(R T_fan)]"
    DRIVER = BYPASS_RATIO
    COEFFICIENTS = (
        Coefficient(
            "root_efficiency",
            "1",
            "a, change of the root's efficiency per unit of ln BPR",
            lower=-0.3,
            upper=0.3,
            sigma=0.05,
            typical=-0.05,
        ),
    )
    REFERENCE = "GasTurb manual (fans with two maps); 0.5 to 2 points of efficiency over 20 % of bypass ratio assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        for fan, splitter in fans(network).values():
            yield Site(fan.name, fan.name, (f"station {splitter.values['core']}",))

    def install(self, at: Place) -> None:
        fan, splitter = fans(at.network)[at.site.name]

        def root(e: Evaluation, flow: Flow) -> Flow:
            before, behind = e.flows[fan.values["from"]], e.flows[fan.values["to"]]
            change = at.c(e, "root_efficiency") * log(e[f"{splitter.name}.bypass_ratio"])  # relative to design
            return flow.replace(P=flow.P * exp(change * (behind.h - before.h) / (behind.R * behind.T)))

        at.change_flow(splitter.values["core"], root)


FLOW_PER_DEGREE = shape_coefficient(
    "flow_per_deg",
    "1/deg",
    "a, fall of corrected flow per degree of closing",
    value=0.01,
    lower=0.005,
    upper=0.015,
    sigma=0.003,
)


class GuideVanes(Term):
    """Vanes closed further than the map holds by Δφ = s (1 − N_c/N_c,design), in degrees.

    Flow W_c = W_c,map exp(−a Δφ), efficiency η = η_map/(1 + b Δφ²): to first order −a Δφ and −b Δφ², and
    sensible for any angle. Machines of constant speed close their vanes with the load: `guide_vanes_load`.
    """

    NAME = "guide_vanes"
    TITLE = "Guide vane schedule"
    STATEMENT = (
        "The compressor's guide vanes and stators close further at low speed than the model's map holds: it "
        "swallows less air there, and its incidence is off."
    )
    EQUATION = "W_c = W_c,map exp(−a Δφ),  η = η_map/(1 + b Δφ²),  Δφ = s (1 − N_c/N_c,design)"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient(
            "slope_deg",
            "deg",
            "s, closing per unit of relative corrected speed below design",
            lower=-60.0,
            upper=60.0,
            sigma=15.0,
            typical=20.0,
        ),
        FLOW_PER_DEGREE,
        shape_coefficient(
            "loss_per_deg2", "1/deg2", "b, fall of efficiency per square degree", value=3e-4, upper=5e-4, sigma=1e-4
        ),
    )
    REFERENCE = (
        "NLR GSP and GasTurb variable-geometry inputs; a 0.5 to 1.5 %/deg, b 0.01 to 0.05 %/deg2 and errors "
        "of up to 5 deg assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        found = [c for c in core_compressor(network) if has_variable_speed(network, c)]
        return component_sites(found, "flow_capacity", "efficiency")

    def install(self, at: Place) -> None:
        speed = relative_corrected_speed(at)
        install_vanes(at, lambda e: at.c(e, "slope_deg") * (1.0 - speed(e)))


def install_vanes(at: Place, closing: Quantity) -> None:
    """Flow and efficiency with the vanes closed by `closing(e)` degrees; coefficients as of GuideVanes."""
    flow, efficiency = at.site.targets
    at.change_leaf(flow, lambda e, factor: closed_flow(factor, at.c(e, "flow_per_deg"), closing(e)))
    at.change_leaf(efficiency, lambda e, factor: closed_efficiency(factor, at.c(e, "loss_per_deg2"), closing(e)))


KNEE = 0.05
"""Width of the knee at base load, of the scale over which the vanes close."""


class GuideVanesLoad(Term):
    """Δφ = φ (1 − exp(−u/ε)) with u = max(0, 1 − x/x_design), rounded over a small knee; flow and efficiency as in
    `guide_vanes`.

    At constant speed the vanes alone set the flow. At base load, where the power setting x is its design value,
    they are open; below it the control closes them, lets the firing temperature fall a little to hold the exhaust
    at its limit, and stops at an angle φ. Where T4 is the power setting its own fall, uncorrected as the limit is,
    gives the position (ε = ε_T); where power or fuel is, the fall of load does (ε = ε_L).
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
        Coefficient("closing_deg", "deg", "φ, closing at low load", upper=60.0, sigma=15.0, typical=20.0),
        shape_coefficient(
            "temperature_scale",
            "1",
            "ε_T, relative fall of T4 in which 63 % of it happens",
            value=0.02,
            lower=0.005,
            upper=0.2,
            sigma=0.01,
        ),
        shape_coefficient(
            "load_scale", "1", "ε_L, the same as a fall of power or fuel", value=0.3, lower=0.1, upper=1.0, sigma=0.1
        ),
        FLOW_PER_DEGREE,
        shape_coefficient(
            "loss_per_deg2", "1/deg2", "b, fall of efficiency per square degree", value=5e-5, upper=5e-4, sigma=5e-5
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004 (part load with variable vanes); a 0.5 to "
        "1.5 %/deg, b and the scales assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        found = [c for c in core_compressor(network) if not has_variable_speed(network, c)]
        return component_sites(found, "flow_capacity", "efficiency")

    def install(self, at: Place) -> None:
        column = at.network.power_setting
        leaf = at.network.input_leaf(column)
        scale = "temperature_scale" if split_column(column)[1] == "K" else "load_scale"
        base = scalar(at.network.read(at.design, column))

        def closing(e: Evaluation) -> Value:
            below = smooth_positive((1.0 - e[leaf] * (1.0 / base)) / at.c(e, scale), KNEE)
            return at.c(e, "closing_deg") * (1.0 - exp(-1.0 * below))

        install_vanes(at, closing)
        # the flow is sought relative to what the vanes let through: the answer is the same, but the iteration need
        # not find its way from an open compressor to one that is closed by a quarter
        for c in at.network.components:
            if isinstance(c, Inlet):
                at.change_leaf(
                    f"{c.name}.corrected_flow", lambda e, x: x * exp(-1.0 * (at.c(e, "flow_per_deg") * closing(e)))
                )


def smooth_positive(x: Value, width: float) -> Value:
    """w ln(1 + exp(x/w)): x where it is well above zero, 0 well below, analytic in between."""
    z = x * (1.0 / width)
    above = np.asarray(value(z) > 0.0)
    return width * select(above, z + log(1.0 + exp(-1.0 * z)), log(1.0 + exp(z)))
