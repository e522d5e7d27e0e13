"""Effects on compressors, turbines and the shafts that join them: Reynolds number, tip clearances, heat, losses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.drivers import AMBIENT_PRESSURE, COMPRESSOR_PRESSURE, CONSTANT, RATE, REYNOLDS_INDEX, SHAFT_SPEED
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Splitter
from enginediag_cli.engine.dual import Array, Value, exp, log, power
from enginediag_cli.engine.evaluation import Evaluation, Flow, reynolds_index, viscosity_ratio
from enginediag_cli.engine.filters import Lag, RateOfChange, ScaledFilter, ScaledIntegratedFilter
from enginediag_cli.engine.recall import UNKNOWN_PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import (
    component_sites,
    compressors,
    core_compressor,
    has_variable_speed,
    outlet_sites,
    relative_speed,
    turbines,
)
from enginediag_cli.units import RAD_S_PER_RPM

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


class ReynoldsTerm(Term):
    """A factor on what a compressor or turbine does, by the Reynolds number of the gas that enters it.

    (1 − η) = (1 − η_design) (Re/Re_design)^(−n) of the compressors, unless a term has its own number or factor.
    """

    DRIVER = REYNOLDS_INDEX

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(compressors(network), "efficiency")

    def number(self, flow: Flow) -> Value:
        """What is proportional to the Reynolds number of the component that this gas enters."""
        return reynolds_index(flow)

    def factor(self, at: Place, e: Evaluation, relative: Value) -> Value:
        """The factor, where the Reynolds number is `relative` to that of the design point."""
        loss = 1.0 / at.component.values["isentropic_efficiency"] - 1.0
        return 1.0 - loss * (power(relative, -1.0 * at.c(e, "exponent")) - 1.0)

    def install(self, at: Place) -> None:
        station = at.component.values["from"]
        reference = scalar(self.number(at.design.flows[station]))

        def changed(e: Evaluation, factor: Value) -> Value:
            return factor * self.factor(at, e, self.number(e.flows[station]) * (1.0 / reference))

        at.change_leaf(at.site.targets[0], changed)


class ReynoldsEfficiency(ReynoldsTerm):
    """η = 1 − (1 − η_0)(RNI/RNI_design)^(−n), written as a factor on the map's efficiency."""

    NAME = "reynolds_efficiency"
    TITLE = "Reynolds number, compressor efficiency"
    STATEMENT = (
        "The thin air of altitude thickens the boundary layers on the blades: the compressor's losses grow "
        "as the Reynolds number falls."
    )
    EQUATION = "(1 − η) = (1 − η_design) (RNI/RNI_design)^(−n),  RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T) at its inlet"
    COEFFICIENTS = (
        Coefficient("exponent", "1", "exponent n of the losses", upper=0.3, sigma=0.1, typical=0.1, cited=True),
    )
    REFERENCE = (
        "NASA TN D-6640 (n 0.06 to 0.20 as Re falls, centrifugal); Wassell 1968, J. Eng. Power 90, 349; "
        "form as in NLR GSP"
    )


class ReynoldsFlowCapacity(ReynoldsTerm):
    """W_c = W_c,map (1 + k ln(RNI/RNI_design)): thicker boundary layers block the passages."""

    NAME = "reynolds_flow_capacity"
    TITLE = "Reynolds number, compressor flow"
    STATEMENT = (
        "The thick boundary layers of thin air block the compressor's passages: it swallows less corrected "
        "flow at altitude."
    )
    EQUATION = "W_c = W_c,map [1 + k ln(RNI/RNI_design)],  RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T) at its inlet"
    COEFFICIENTS = (
        Coefficient(
            "slope", "1", "k, change of corrected flow per unit of ln RNI", upper=0.05, sigma=0.012, typical=0.015
        ),
    )
    REFERENCE = "NPSS S_Re socket (s_WcRe); Walsh & Fletcher, Gas Turbine Performance, 2nd ed.; k 0 to 0.03 assumed"

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(compressors(network), "flow_capacity")

    def factor(self, at: Place, e: Evaluation, relative: Value) -> Value:
        return 1.0 + at.c(e, "slope") * log(relative)


class ReynoldsTurbineEfficiency(ReynoldsTerm):
    """η = 1 − (1 − η_design)(Re/Re_design)^(−n), written as a factor on the map's efficiency."""

    NAME = "reynolds_turbine_efficiency"
    TITLE = "Reynolds number, turbine efficiency"
    STATEMENT = (
        "Less and thinner gas flows through the turbine at altitude and low power: its boundary layers "
        "thicken and its losses grow."
    )
    EQUATION = "(1 − η) = (1 − η_design) (Re/Re_design)^(−n),  Re ∝ W/μ(T) of the entering gas"
    COEFFICIENTS = (
        Coefficient("exponent", "1", "exponent n of the losses", upper=0.35, sigma=0.1, typical=0.15, cited=True),
    )
    REFERENCE = "NASA TN D-5090 (n 0.13 to 0.20 static; 0.18 above and 0.30 below design Re, total)"

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites(turbines(network), "efficiency")

    def number(self, flow: Flow) -> Value:
        """W/μ [kg/s at the viscosity of air at 288.15 K]."""
        return flow.W / viscosity_ratio(flow.T)


class TipClearance(Term):
    """Δc = g (1 − (N/N_design)²) in % of span: centrifugal growth closes the gap as the shaft speeds up.

    η = η_map (1 − k Δc), W_c = W_c,map (1 − k_w Δc); steady states, where casing and rotor are warm. `COEFFICIENTS`:
    the growth g, then k and k_w.
    """

    EQUATION = "η = η_map (1 − k Δc),  W_c = W_c,map (1 − k_w Δc),  Δc = g [1 − (N/N_design)²]"
    DRIVER = SHAFT_SPEED

    def install(self, at: Place) -> None:
        speed = relative_speed(at, at.component.values["shaft"])
        growth, efficiency_loss, flow_loss = (c.name for c in self.COEFFICIENTS)
        efficiency, flow = at.site.targets

        def opening(e: Evaluation) -> Value:
            n = speed(e)
            return at.c(e, growth) * (1.0 - n * n)

        at.change_leaf(efficiency, lambda e, factor: factor * (1.0 - at.c(e, efficiency_loss) * opening(e)))
        at.change_leaf(flow, lambda e, factor: factor * (1.0 - at.c(e, flow_loss) * opening(e)))


ROTOR_GROWTH = Coefficient(
    "growth", "% of span", "g, growth of the rotor from standstill to design speed", upper=3.0, sigma=0.8, typical=1.0
)


class CompressorTipClearance(TipClearance):
    """Loses flow and efficiency at low speed."""

    NAME = "compressor_tip_clearance"
    TITLE = "Compressor tip clearance with speed"
    STATEMENT = (
        "At low speed the rotor is shorter and the gap over the compressor's blades wider: it loses flow and "
        "efficiency there."
    )
    COEFFICIENTS = (
        ROTOR_GROWTH,
        shape_coefficient(
            "efficiency_loss",
            "1/% of span",
            "k, relative loss of efficiency per clearance",
            value=0.015,
            lower=0.005,
            upper=0.025,
            sigma=0.004,
        ),
        shape_coefficient(
            "flow_loss",
            "1/% of span",
            "k_w, relative loss of corrected flow per clearance",
            value=0.025,
            lower=0.01,
            upper=0.04,
            sigma=0.005,
        ),
    )
    REFERENCE = (
        "Freeman 1985, VKI lecture series 1985-05; Walsh & Fletcher, 2nd ed.; 0.01 to 0.02 of efficiency and "
        "0.02 to 0.03 of flow per % of span assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        found = [c for c in core_compressor(network) if has_variable_speed(network, c)]
        return component_sites(found, "efficiency", "flow_capacity")


class TurbineTipClearance(TipClearance):
    """Leaks at low speed."""

    NAME = "turbine_tip_clearance"
    TITLE = "Turbine tip clearance with speed"
    STATEMENT = (
        "The rotor stretches with the square of its speed: at low speed the gap over the turbine's blades is "
        "wider, and it leaks."
    )
    COEFFICIENTS = (
        ROTOR_GROWTH,
        shape_coefficient(
            "efficiency_loss",
            "1/% of span",
            "k, relative loss of efficiency per clearance",
            value=0.0175,
            lower=0.003,
            upper=0.03,
            sigma=0.005,
        ),
        shape_coefficient(
            "capacity_loss",
            "1/% of span",
            "k_w, relative loss of capacity per clearance",
            value=0.002,
            upper=0.005,
            sigma=0.001,
            cited=True,
        ),
    )
    REFERENCE = (
        "NASA TM X-52552 (k 0.0033 radial; k_w 0.002); Lattime & Steinetz, NASA TM-2002-211794; k 0.015 to "
        "0.02 for axial turbines assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        found = [c for c in turbines(network) if has_variable_speed(network, c)]
        return component_sites(found, "efficiency", "flow_capacity")


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
            lower=-0.1,
            upper=0.1,
            sigma=0.03,
            typical=0.02,
        ),
        Coefficient(
            "time_constant",
            "s",
            "τ, in which the slower part grows by 63 %",
            absent=90.0,
            lower=2.0,
            upper=1800.0,
            sigma=200.0,
            typical=60.0,
            free=True,
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8; Lattime and Steinetz, NASA/TM-2002-211794 "
        "(paces of casing and disc); ranges assumed"
    )
    INPUTS = UNKNOWN_PAST
    MEASURED = True
    TRIALS = tuple({"loss": 0.02, "time_constant": t} for t in (10.0, 40.0, 150.0, 600.0))

    def sites(self, network: Network) -> Iterable[Site]:
        rotors = (*core_compressor(network), *turbines(network))
        return component_sites([c for c in rotors if has_variable_speed(network, c)], "efficiency")

    def install(self, at: Place) -> None:
        shaft = at.component.values["shaft"]
        design = scalar(at.design.shafts[shaft].speed_rpm)
        column = next(c for c, s in at.network.speed_columns.items() if s == shaft)

        def pull(speed_rpm: Array) -> Array:
            return np.asarray((speed_rpm / design) ** 2)

        behind = at.add_memory(ScaledIntegratedFilter(Lag()), ("loss", "time_constant"), recorded=column, measured=pull)

        def efficiency(e: Evaluation, factor: Value) -> Value:
            n = e.shaft(shaft).speed_rpm * (1.0 / design)
            return factor * (1.0 + behind(e, n * n))

        at.change_leaf(f"{at.site.name}.efficiency", efficiency)


class ActiveClearanceControl(Term):
    """η = η_map (1 + k c s(h)), s = 1/(1 + exp[(h_on − h)/Δh]): fan air shrinks the casing at cruise altitude."""

    NAME = "active_clearance_control"
    TITLE = "Active clearance control"
    STATEMENT = (
        "At cruise altitude fan air is blown on the turbine's casing, which shrinks onto the blades: the "
        "turbine is better there than near the ground."
    )
    EQUATION = "η = η_map (1 + k c/(1 + exp[(h_on − h)/Δh])),  h = pressure altitude"
    DRIVER = AMBIENT_PRESSURE
    COEFFICIENTS = (
        Coefficient("closing", "% of span", "c, clearance that it takes away", upper=1.5, sigma=0.5, typical=0.6),
        shape_coefficient(
            "efficiency_gain",
            "1/% of span",
            "k, relative gain of efficiency per clearance",
            value=0.0175,
            lower=0.003,
            upper=0.03,
            sigma=0.005,
        ),
        shape_coefficient(
            "on_above_m",
            "m",
            "h_on, pressure altitude at which it is half on",
            value=6000.0,
            lower=1500.0,
            upper=11000.0,
            sigma=1500.0,
        ),
        shape_coefficient(
            "width_m", "m", "Δh, altitude over which it comes on", value=300.0, lower=100.0, upper=2000.0, sigma=200.0
        ),
    )
    REFERENCE = "Lattime & Steinetz, NASA TM-2002-211794; 0.3 to 1 % of span, on above about FL200, assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        # the air is the fan's: an engine without bypass has none to blow
        if "altitude_m" in network.inputs() and any(isinstance(c, Splitter) for c in network.components):
            yield from component_sites(turbines(network), "efficiency")

    def install(self, at: Place) -> None:
        def efficiency(e: Evaluation, factor: Value) -> Value:
            off = exp((at.c(e, "on_above_m") - e["altitude_m"]) / at.c(e, "width_m"))
            return factor * (1.0 + at.c(e, "closing") * at.c(e, "efficiency_gain") / (1.0 + off))

        at.change_leaf(f"{at.site.name}.efficiency", efficiency)


HOLD_HEAT = ("compressor", "burner", "turbine")


class HeatSoak(Term):
    """The gas behind a component gives ε (W c_p)_design (T − T_metal) to its metal; τ dT_metal/dt = T − T_metal."""

    NAME = "heat_soak"
    TITLE = "Heat soak of a component's metal"
    STATEMENT = (
        "Metal that is colder than the gas takes up heat until it is as warm, and gives it back when the gas cools: "
        "for some minutes after a change of power the gas behind the component is cooler, or warmer, than in the "
        "steady state."
    )
    EQUATION = "W Δh = −ε (W c_p)_design (T − T_metal),  τ dT_metal/dt = T − T_metal,  τ = m c_metal/(ε (W c_p)_design)"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "exchange",
            "1",
            "ε, heat conductance to the metal over W c_p of the gas at the design point",
            upper=0.5,
            sigma=0.05,
            typical=0.02,
        ),
        Coefficient(
            "time_constant",
            "s",
            "τ, in which the metal warms to 63 %",
            absent=60.0,
            lower=0.5,
            upper=3600.0,
            sigma=600.0,
            typical=30.0,
            free=True,
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8 (heat soak); ranges assumed"
    INPUTS = UNKNOWN_PAST
    TRIALS = tuple({"exchange": 0.02, "time_constant": t} for t in (5.0, 30.0, 150.0, 600.0))

    def sites(self, network: Network) -> Iterable[Site]:
        return outlet_sites(c for c in network.components if c.TYPE in HOLD_HEAT)

    def install(self, at: Place) -> None:
        station = at.component.values["to"]
        design = at.design.flows[station]
        capacity = scalar(design.W * design.gas.heat_capacity(design.T, design.mixture))
        heat = at.add_memory(ScaledIntegratedFilter(Lag()), ("exchange", "time_constant"))

        def soaked(e: Evaluation, flow: Flow) -> Flow:
            # ε (T_metal − T): negative while the metal is colder than the gas
            given = heat(e, flow.T) * capacity
            return Flow(flow.gas, flow.mixture, flow.W, flow.P, h=flow.h + given / flow.W)

        at.change_flow(station, soaked)


Load = Callable[[Evaluation, Value], Value]
"""Power [W] that a shaft loses, of an evaluation and the fraction that it is of the design point's."""


class ShaftLoss(Term):
    """A power that a shaft loses, a `fraction` of its turbines' power at the design point there."""

    def sites(self, network: Network) -> Iterable[Site]:
        for shaft in network.shafts:
            if any(t.values["shaft"] == shaft for t in turbines(network)):
                yield Site(shaft, shaft, (f"{shaft}.power_offtake_W",))

    @abstractmethod
    def loss(self, at: Place, full: float) -> Load:
        """What is lost, where the turbines give `full` [W] at the design point."""

    def install(self, at: Place) -> None:
        loss = self.loss(at, scalar(at.design.shafts[at.site.name].supply_W))
        at.change_leaf(at.site.targets[0], lambda e, load_W: load_W + loss(e, at.c(e, "fraction")))


class BearingLoss(ShaftLoss):
    """P_loss = f P_turbine,design (N/N_design)²: shear of oil of regulated temperature, whatever the air's density."""

    NAME = "bearing_loss"
    TITLE = "Bearing friction"
    STATEMENT = (
        "Bearings and oil take shaft power with the square of speed; at altitude, where the engine makes less "
        "power at the same speed, that is a larger share."
    )
    EQUATION = "P_loss = f P_turbine,design (N/N_design)²"
    DRIVER = SHAFT_SPEED
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "f, loss over the shaft's turbine power at the design point",
            upper=0.02,
            sigma=0.004,
            typical=0.004,
        ),
    )
    REFERENCE = "NASA AGTF30 (shaft efficiency 0.99); law μ(T_oil) N²; 0.2 to 1 % of shaft power assumed"

    def loss(self, at: Place, full: float) -> Load:
        speed = relative_speed(at, at.site.name)

        def friction(e: Evaluation, fraction: Value) -> Value:
            n = speed(e)
            return fraction * full * (n * n)

        return friction


class WindageLoss(ShaftLoss):
    """P_loss = f P_turbine,design (ρ/ρ_design)(N/N_design)³, from P = k ρ N³ D⁵ of discs that turn in gas.

    ρ is that of the gas that fills the cavities: behind the shaft's last compressor, or behind its turbine where it
    drives none. The loss is close to a constant share of the shaft's power; only its departures from that differ
    from a loss of mechanical efficiency.
    """

    NAME = "windage_loss"
    TITLE = "Windage"
    STATEMENT = (
        "Discs and drums stir the gas in which they turn: the shaft loses power with the gas's density and "
        "the cube of its speed."
    )
    EQUATION = "P_loss = f P_turbine,design (ρ/ρ_design)(N/N_design)³"
    DRIVER = COMPRESSOR_PRESSURE
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "f, loss over the shaft's turbine power at the design point",
            upper=0.03,
            sigma=0.006,
            typical=0.005,
        ),
    )
    REFERENCE = "NASA AGTF30 (shaft efficiency 0.99); law of discs ρ N³ D⁵; 0.2 to 1 % of shaft power assumed"

    def loss(self, at: Place, full: float) -> Load:
        shaft = at.site.name
        rotors = [c for c in (*turbines(at.network), *compressors(at.network)) if c.values["shaft"] == shaft]
        station = rotors[-1].values["to"]
        reference, speed = scalar(density(at.design.flows[station])), relative_speed(at, shaft)

        def windage(e: Evaluation, fraction: Value) -> Value:
            n = speed(e)
            return fraction * (full / reference) * density(e.flows[station]) * (n * n * n)

        return windage


def density(flow: Flow) -> Value:
    """Total density P/(R T) [kg/m³]."""
    return flow.P / (flow.R * flow.T)


class PowerOfftake(ShaftLoss):
    """P_offtake = f · P_demand,design: a constant load on the shaft, relative to its power at the design point."""

    NAME = "power_offtake"
    TITLE = "Shaft power off-take"
    STATEMENT = (
        "Generators and hydraulic pumps take shaft power, whatever the engine's power: at low power they are "
        "a larger share."
    )
    EQUATION = "P_turbine η_m = P_compressor + f · P_turbine,design"
    DRIVER = CONSTANT
    COEFFICIENTS = (
        Coefficient(
            "fraction",
            "1",
            "load over the shaft's turbine power at the design point",
            upper=0.05,
            sigma=0.01,
            typical=0.005,
        ),
    )
    REFERENCE = "NLR GSP manual (PTO); Slingerland et al., AIAA 2007-7848; 0.3 to 1.5 % of HPT power on large engines"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        for shaft in network.shafts:
            if shaft not in network.loaded_shafts:
                yield Site(shaft, shaft, (f"{shaft}.power_offtake_W",))

    def loss(self, at: Place, full: float) -> Load:
        return lambda e, fraction: fraction * full


class RotorInertia(Term):
    """P_turbine η_m = P_compressor + P_offtake + d(½ I ω²)/dt, with ω as it was measured where it is recorded."""

    NAME = "rotor_inertia"
    TITLE = "Inertia of the rotor"
    STATEMENT = (
        "While a rotor speeds up, part of its turbine's power goes into it; it comes back while it slows down. Fuel "
        "and temperatures are above those of a steady engine at the same speed, or below."
    )
    EQUATION = "P_turbine η_m = P_compressor + P_offtake + I ω dω/dt"
    DRIVER = RATE
    COEFFICIENTS = (
        Coefficient(
            "inertia",
            "kg m2",
            "I, polar moment of inertia of all that turns with the shaft",
            upper=1e5,
            sigma=10.0,
            typical=0.1,
        ),
    )
    REFERENCE = (
        "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004, ch. 8; ranges from model jets to fans, assumed"
    )
    INPUTS = UNKNOWN_PAST
    MEASURED = True

    def sites(self, network: Network) -> Iterable[Site]:
        for name, shaft in network.shafts.items():
            if shaft["speed"] != "constant":
                yield Site(name, name, (f"{name}.power_offtake_W",))

    def install(self, at: Place) -> None:
        name = at.site.name

        def energy(speed_rpm: Array) -> Array:
            return 0.5 * (RAD_S_PER_RPM * speed_rpm) ** 2

        column = next(c for c, shaft in at.network.speed_columns.items() if shaft == name)
        power = at.add_memory(ScaledFilter(RateOfChange()), ("inertia",), recorded=column, measured=energy, turns=name)

        def offtake(e: Evaluation, load_W: Value) -> Value:
            omega = e.shaft(name).speed_rpm * RAD_S_PER_RPM
            return load_W + power(e, omega * omega * 0.5)

        at.change_leaf(f"{name}.power_offtake_W", offtake)
