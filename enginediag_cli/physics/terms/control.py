"""Effects of controls and of the ambient air.

Actuators that follow their command with a lag, with a delay or at a limited rate; the air around the engine, how it is
recorded, and the inlet that takes it in.
"""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import TYPE_CHECKING, ClassVar

from enginediag_cli.drivers import CORRECTED_SPEED, HUMIDITY, MACH, RATE
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Ambient, Inlet
from enginediag_cli.engine.controls import RecordedPosition
from enginediag_cli.engine.dual import Value, select, sqrt, value
from enginediag_cli.engine.evaluation import (
    GRAVITY,
    H_TROPOPAUSE,
    LAPSE,
    P_ISA,
    R_AIR,
    T_ISA,
    T_TROPOPAUSE,
    Evaluation,
    saturated_water,
    standard_atmosphere,
)
from enginediag_cli.engine.filters import Delay, Filter, FullScaleFilter, Lag, RateLimit, SecondOrder
from enginediag_cli.engine.recall import UNKNOWN_PAST
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.registry import burners, component_sites, flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


ONE_SIDED = 0.1
"""Of the time in one direction, that of the other in trials of one direction: at 0 nothing would show whether it is."""
LONGEST_S = 1e5
"""Bound of the time for a full scale: about a day."""


class FilteredCommand(Term):
    """The engine gets what `FILTER` makes of a command, with the term's coefficients; a rate limit by the full scale of
    the site."""

    DRIVER = RATE
    INPUTS = UNKNOWN_PAST
    FILTER: ClassVar[Filter]

    def install(self, at: Place) -> None:
        filter = self.FILTER
        if isinstance(filter, RateLimit):
            assert at.site.full is not None
            filter = FullScaleFilter(filter, at.site.full[0])
        at.filter_input(at.site.targets[0], filter, [c.name for c in self.COEFFICIENTS])


class LoadCommand(FilteredCommand):
    """At the machine that gets a demand of power, where that is what sets the power."""

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "power_W":
            for name in [c.name for c in network.components if c.TYPE == "load"][:1]:
                yield Site(name, name, ("power_W",), full=(full_setting(network), "W"))


class FuelCommand(FilteredCommand):
    """At the burner, where a commanded fuel flow sets the power."""

    def sites(self, network: Network) -> Iterable[Site]:
        if network.power_setting == "Wf_kg_s":
            name = burners(network)[0].name
            yield Site(name, name, ("Wf_kg_s",), full=(full_setting(network), "kg/s"))


def full_setting(network: Network) -> float:
    """The power setting at the design point."""
    assert network.design_point is not None
    return scalar(network.read(network.design_point, network.power_setting))


def rate_limits(what: str, full: str, sigma: float, typical: float) -> tuple[Coefficient, ...]:
    """Times [s] in which what is demanded, `what`, may rise and fall by `full`."""
    return tuple(
        Coefficient(
            name,
            "s",
            f"{sign}, time in which the {what} may {name} by {full}; 0: at once",
            upper=LONGEST_S,
            sigma=sigma,
            typical=typical,
            per_full=True,
        )
        for name, sign in (("rise", "t_up"), ("fall", "t_down"))
    )


def rate_trials(*times: float) -> tuple[dict[str, float], ...]:
    """Sizes of rate limits at which a search tries them: either way alike, and one way much faster."""
    ways = ((1.0, 1.0), (1.0, ONE_SIDED), (ONE_SIDED, 1.0))
    return tuple({"rise": rise * t, "fall": fall * t} for t in times for rise, fall in ways)


class LoadControlLag(LoadCommand):
    """τ dP/dt = P_demanded − P."""

    NAME = "load_control_lag"
    TITLE = "Lag of the load controller"
    STATEMENT = (
        "The load approaches what is demanded the faster the farther it is from it: steps of all sizes take "
        "the same time."
    )
    EQUATION = "τ dP/dt = P_demanded − P"
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", upper=5000.0, sigma=500.0, typical=30.0),)
    REFERENCE = "first-order governor models: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    TRIALS = tuple({"time_constant": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))
    FILTER = Lag()


class LoadControlDelay(LoadCommand):
    """P(t) = P_demanded(t − d)."""

    NAME = "load_control_delay"
    TITLE = "Delay of the load controller"
    STATEMENT = (
        "What is demanded reaches the load some time later, unchanged: signal ways, sampling, a column that was "
        "recorded late."
    )
    EQUATION = "P(t) = P_demanded(t − d)"
    COEFFICIENTS = (Coefficient("delay", "s", "d; 0: at once", upper=3600.0, sigma=100.0, typical=10.0),)
    REFERENCE = "transport and sampling delays of control loops; the range is assumed"
    TRIALS = tuple({"delay": t} for t in (1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0, 256.0))
    FILTER = Delay()


class LoadSecondOrderLag(LoadCommand):
    """τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded."""

    NAME = "load_second_order_lag"
    TITLE = "Second-order lag of the load controller"
    STATEMENT = (
        "The load begins to follow slowly and then approaches what is demanded: two lags in a row, of actuator "
        "and machine."
    )
    EQUATION = "τ₁τ₂ d²P/dt² + (τ₁ + τ₂) dP/dt + P = P_demanded"
    COEFFICIENTS = (
        Coefficient(
            "time_constant", "s", "τ = τ₁ + τ₂, of both together; 0: at once", upper=5000.0, sigma=500.0, typical=40.0
        ),
        Coefficient(
            "second_share",
            "1",
            "τ₂/τ, share of the quicker one; 0: a lag of first order",
            absent=0.5,
            upper=0.5,
            sigma=0.5,
            typical=0.4,
            free=True,
            closed=True,
        ),
    )
    REFERENCE = "governor and actuator in series: Rowen, J. Eng. Power 105 (1983) 865; the range is assumed"
    TRIALS = tuple({"time_constant": t, "second_share": 0.4} for t in (2.0, 5.0, 12.0, 30.0, 75.0, 190.0, 480.0))
    FILTER = SecondOrder()


class LoadRateLimit(LoadCommand):
    """−P_full/t_down ≤ dP/dt ≤ P_full/t_up: the load follows what is demanded, but not faster."""

    NAME = "load_rate_limit"
    TITLE = "Rate limit of the load controller"
    STATEMENT = (
        "The controller of the load takes up and gives away power at a limited rate, whatever the size of the step "
        "that is demanded: a larger step takes longer, in proportion."
    )
    EQUATION = "dP/dt = min(max(dP_demanded/dt, −P_full/t_down), P_full/t_up) until P = P_demanded"
    COEFFICIENTS = rate_limits("load", "the design power", 1000.0, 100.0)
    REFERENCE = "IEEE Std 421.5 and IEEE Task Force on turbine-governor modelling: ramp limiters; ranges assumed"
    TRIALS = rate_trials(4.0, 10.0, 25.0, 60.0, 150.0, 400.0, 1000.0)
    FILTER = RateLimit()


class FuelControlLag(FuelCommand):
    """τ dW_f/dt = W_f,commanded − W_f."""

    NAME = "fuel_control_lag"
    TITLE = "Lag of the fuel control"
    STATEMENT = "Fuel valve and manifold let the burner have a change of the commanded fuel flow a little later."
    EQUATION = "τ dW_f/dt = W_f,commanded − W_f"
    COEFFICIENTS = (Coefficient("time_constant", "s", "τ; 0: at once", upper=60.0, sigma=2.0, typical=0.5),)
    REFERENCE = "Rowen, J. Eng. Power 105 (1983) 865: valve 0.05 s, fuel system 0.4 s; the range is assumed"
    TRIALS = tuple({"time_constant": t} for t in (0.5, 2.0, 8.0))
    FILTER = Lag()


class FuelRateLimit(FuelCommand):
    """−W_full/t_down ≤ dW_f/dt ≤ W_full/t_up: the fuel follows what is commanded, but not faster."""

    NAME = "fuel_rate_limit"
    TITLE = "Rate limit of the fuel actuator"
    STATEMENT = (
        "The fuel valve or its schedule opens and closes at a limited rate: a larger step takes longer, in proportion."
    )
    EQUATION = "dW_f/dt = min(max(dW_f,commanded/dt, −W_full/t_down), W_full/t_up) until W_f = W_f,commanded"
    COEFFICIENTS = rate_limits("fuel", "the design flow", 100.0, 10.0)
    REFERENCE = (
        "acceleration and deceleration limiters of fuel controls: Walsh and Fletcher, Gas Turbine "
        "Performance, ch. 8; ranges assumed"
    )
    TRIALS = rate_trials(2.0, 5.0, 12.0, 30.0)
    FILTER = RateLimit()


class ActuatorRateLimit(FilteredCommand):
    """−way/t_down ≤ dx/dt ≤ way/t_up: the position follows what is recorded of it, a command, but not faster."""

    NAME = "actuator_rate_limit"
    TITLE = "Rate limit of an actuator"
    STATEMENT = (
        "What is recorded is where vanes, a nozzle or a valve are to stand; they get there at a limited rate: a longer "
        "way takes longer, in proportion."
    )
    EQUATION = "dx/dt = min(max(dx_recorded/dt, −way/t_down), way/t_up) until x = x_recorded"
    COEFFICIENTS = rate_limits("position", "all its way between the stops", 20.0, 5.0)
    REFERENCE = "actuator slew limits: Walsh and Fletcher, Gas Turbine Performance, ch. 8; ranges assumed"
    TRIALS = rate_trials(1.0, 3.0, 10.0, 30.0)
    FILTER = RateLimit()

    def sites(self, network: Network) -> Iterable[Site]:
        for control in network.controls:
            if isinstance(control, RecordedPosition):
                a = control.actuator
                yield Site(control.name, control.name, (control.column,), full=(a.upper - a.lower, a.unit))


class Humidity(Term):
    """w = w_recorded + φ w_sat(T_0, p_0), with w_recorded = 0 where no column of humidity was recorded."""

    NAME = "humidity"
    TITLE = "Humidity"
    STATEMENT = (
        "Warm air carries water that was not recorded: the gas is lighter and of greater heat capacity, which "
        "changes speeds, flows and the fuel that is needed."
    )
    EQUATION = "w = w_recorded + φ w_sat(T_0, p_0),  w_sat = 0.622 e_s(T_0)/(p_0 − e_s)"
    DRIVER = HUMIDITY
    COEFFICIENTS = (
        Coefficient(
            "relative_humidity",
            "1",
            "φ, relative humidity beyond what is recorded",
            upper=1.0,
            sigma=0.4,
            typical=0.6,
            cited=True,
        ),
    )
    REFERENCE = (
        "Bird & Grabe, ASME 91-GT-329 (corrections of 0.1 to 0.8 %); saturation: Buck 1981, "
        "J. Appl. Meteorol. 20, 1527, constants of 1996"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        if any(isinstance(c, Ambient) for c in network.components):
            yield Site("ambient", "ambient", ("humidity_kg_kg",), everywhere=True)

    def install(self, at: Place) -> None:
        flight = flies(at.network)

        def humidity(e: Evaluation, recorded: Value) -> Value:
            if flight:
                T0, p0 = standard_atmosphere(e["altitude_m"])
                T0 = T0 + e["dT_isa_K"]
            else:
                T0, p0 = e["ambient_temperature_K"], e["ambient_pressure_Pa"]
            return recorded + at.c(e, "relative_humidity") * saturated_water(T0, p0)

        at.change_leaf("humidity_kg_kg", humidity)


class StaticPressureError(Term):
    """Recorded static pressure p (1 + k M²). The pitot tube and the temperature probe read total values, which are
    right: with the static pressure, the recorded Mach number and static temperature are corrected to first order in k,

        p_s = p_rec (1 − k M²)    M = M_rec [1 + k (5 + M_rec²)/7]    T_s = T_rec (1 − 2/7 k M²)

    and the altitude follows from the pressure in the standard atmosphere, h = h_rec + k M² R T_ISA(h_rec)/g.
    """

    NAME = "static_pressure_error"
    TITLE = "Position error of the static pressure"
    STATEMENT = (
        "The static ports feel the air that flows around the aircraft and read wrong with the square of Mach "
        "number: altitude, Mach number and air temperature are recorded wrong together."
    )
    EQUATION = (
        "h = h_rec + k M² R T_ISA(h_rec)/g,  M = M_rec [1 + k (5 + M_rec²)/7],  "
        "T_s = (T_ISA(h_rec) + ΔT_rec)(1 − 2 k M²/7)"
    )
    DRIVER = MACH
    COEFFICIENTS = (
        Coefficient(
            "error",
            "1",
            "error k of the recorded static pressure per M²",
            lower=-0.03,
            upper=0.03,
            sigma=0.008,
            typical=0.008,
        ),
    )
    REFERENCE = "Engineering judgement: 0 to 0.5 % of static pressure at cruise, assumed; isentropic relations, γ = 1.4"

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            yield Site("ambient", "ambient", ("altitude_m", "dT_isa_K", "mach"), everywhere=True)

    def install(self, at: Place) -> None:
        def error(e: Evaluation) -> Value:
            mach = e["mach"]
            return at.c(e, "error") * (mach * mach)

        def mach_number(e: Evaluation, recorded: Value) -> Value:
            return recorded * (1.0 + at.c(e, "error") * ((5.0 + recorded * recorded) * (1.0 / 7.0)))

        def altitude(e: Evaluation, recorded: Value) -> Value:
            T, _ = standard_atmosphere(recorded)
            return recorded + error(e) * (R_AIR / GRAVITY) * T

        def deviation(e: Evaluation, recorded: Value) -> Value:
            h, k = e["altitude_m"], error(e)
            T_recorded = standard_atmosphere(recorded_altitude(h, k * (R_AIR / GRAVITY)))[0] + recorded
            return T_recorded * (1.0 - (2.0 / 7.0) * k) - standard_atmosphere(h)[0]

        at.change_leaf("mach", mach_number)
        at.change_leaf("altitude_m", altitude)
        at.change_leaf("dT_isa_K", deviation)


def recorded_altitude(h: Value, c: Value) -> Value:
    """The recorded altitude h_rec of h = h_rec + c T_ISA(h_rec)."""
    low = (h - c * T_ISA) / (1.0 - c * LAPSE)
    return select(value(low) < H_TROPOPAUSE, low, h - c * T_TROPOPAUSE)


class TatProbeHeating(Term):
    """Recorded air temperature above the true one by a (p_ISA/p) M_s/√(M² + M_s²), stated for total temperature and
    subtracted from the static one: ∝ 1/(M p) in flight, finite standing still."""

    NAME = "tat_probe_heating"
    TITLE = "Heating of the air-temperature probe"
    STATEMENT = (
        "The anti-ice heater warms the probe of the air temperature, most in slow and thin air: the engine "
        "breathes colder air than was recorded."
    )
    EQUATION = "ΔT_ISA = recorded − a (p_ISA/p) (M_s/√(M² + M_s²))/(1 + 0.2 M²)"
    DRIVER = MACH
    COEFFICIENTS = (
        Coefficient("error_K", "K", "error a standing still at sea level", upper=6.0, sigma=1.5, typical=1.5),
        shape_coefficient(
            "mach_scale",
            "1",
            "Mach number M_s below which ventilation keeps the error finite",
            value=0.1,
            lower=0.02,
            upper=0.4,
            sigma=0.05,
        ),
    )
    REFERENCE = "Engineering judgement: + k/(M p), 0 to 3 K on the ground, assumed"
    SWITCHES = True

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            yield Site("ambient", "ambient", ("dT_isa_K",), everywhere=True)

    def install(self, at: Place) -> None:
        def deviation(e: Evaluation, recorded: Value) -> Value:
            mach, scale = e["mach"], at.c(e, "mach_scale")
            _, p = standard_atmosphere(e["altitude_m"])
            square = mach * mach
            slow = scale / sqrt(square + scale * scale) / (1.0 + 0.2 * square)
            return recorded - at.c(e, "error_K") * (slow * (P_ISA / p))

        at.change_leaf("dT_isa_K", deviation)


class InletRamRecovery(Term):
    """P₂/P₁ = r [1 + k (M² − M²_design)]: what is lost of the ram grows with the dynamic pressure, ∝ M²."""

    NAME = "inlet_ram_recovery"
    TITLE = "Inlet recovery with Mach number"
    STATEMENT = (
        "The faster the aircraft flies, the more of the ram pressure the inlet loses at its lip and walls; "
        "a few inlets recover better in flight than standing."
    )
    EQUATION = "P_2/P_1 = r [1 + k (M² − M_design²)]"
    DRIVER = MACH
    COEFFICIENTS = (
        Coefficient(
            "change", "1", "change k of the recovery per M²", lower=-0.08, upper=0.03, sigma=0.01, typical=-0.01
        ),
    )
    REFERENCE = (
        "Recovery tables: NASA AGTF30 (0.995 standing to 0.998 in flight); MIL-E-5007; S-ducts 0.95 to 0.99; "
        "the M² law is assumed"
    )

    def sites(self, network: Network) -> Iterable[Site]:
        if flies(network):
            yield from component_sites(inlets(network), "pressure_recovery")

    def install(self, at: Place) -> None:
        design = scalar(at.design.leaves["mach"]) ** 2

        def recovery(e: Evaluation, r: Value) -> Value:
            mach = e["mach"]
            return r * (1.0 + at.c(e, "change") * (mach * mach - design))

        at.change_leaf(f"{at.site.name}.pressure_recovery", recovery)


def inlets(network: Network) -> list[Inlet]:
    return [c for c in network.components if isinstance(c, Inlet)]


SINCE_CHANGE = "hours_since_filter_change_h"


class InletFilterLoss(Term):
    """ΔP/P = k (1 + g t/1000 h) x², x the corrected flow at the engine's face over its design value.

    x is the inlet's own unknown, so that the loss is known before the flow is.
    """

    NAME = "inlet_filter_loss"
    TITLE = "Inlet filter and duct loss"
    STATEMENT = (
        "Filter, screens and inlet duct take pressure from the air with the square of its flow; dirt in the "
        "filter makes it more with the hours."
    )
    EQUATION = "P_2 = r P_1 [1 − k (1 + g t/1000 h) x²],  x = (W√θ/δ)/(W√θ/δ)_design at station 2"
    DRIVER = CORRECTED_SPEED
    COEFFICIENTS = (
        Coefficient("loss", "1", "ΔP/P at design flow with a clean filter", upper=0.05, sigma=0.01, typical=0.01),
        Coefficient(
            "growth",
            "1/1000 h",
            "growth of the loss with the hours since the filter was changed",
            upper=2.0,
            sigma=0.3,
            typical=0.2,
            shape=True,
        ),
    )
    REFERENCE = "Walsh & Fletcher, Gas Turbine Performance, 2nd ed. 2004; 0 to 3 % (0 to 30 mbar) assumed"
    INPUTS = MappingProxyType({SINCE_CHANGE: 0.0})

    def sites(self, network: Network) -> Iterable[Site]:
        return component_sites([c for c in inlets(network) if not c.values["measured_loss"]], "pressure_recovery")

    def install(self, at: Place) -> None:
        def recovery(e: Evaluation, r: Value) -> Value:
            x = e[f"{at.site.name}.corrected_flow"]
            dirt = 1.0 + at.c(e, "growth") * (e[SINCE_CHANGE] * 1e-3)
            return r * (1.0 - at.c(e, "loss") * dirt * (x * x))

        at.change_leaf(f"{at.site.name}.pressure_recovery", recovery)
