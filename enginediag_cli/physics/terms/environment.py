"""Effects of the air around the engine, of how it is recorded, and of the inlet that takes it in."""

from __future__ import annotations

from collections.abc import Iterable
from types import MappingProxyType
from typing import TYPE_CHECKING

from enginediag_cli.drivers import CORRECTED_SPEED, HUMIDITY, MACH
from enginediag_cli.engine import atmosphere
from enginediag_cli.engine.atmosphere import GRAVITY, P_ISA, R_AIR, saturated_water, standard_atmosphere
from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.components.passages import Ambient, Inlet
from enginediag_cli.engine.dual import Value, select, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term, shape_coefficient
from enginediag_cli.physics.parts import flies, sites_at

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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
    low = (h - c * atmosphere.T_ISA) / (1.0 - c * atmosphere.LAPSE)
    return select(value(low) < atmosphere.H_TROPOPAUSE, low, h - c * atmosphere.T_TROPOPAUSE)


class TatProbeHeating(Term):
    """Recorded air temperature above the true one by a (p_ISA/p) M_s/√(M² + M_s²), stated for total temperature and
    taken off the static one: ∝ 1/(M p) in flight, finite standing still."""

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
            yield from sites_at(inlets(network), "pressure_recovery")

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
        return sites_at([c for c in inlets(network) if not c.values["measured_loss"]], "pressure_recovery")

    def install(self, at: Place) -> None:
        def recovery(e: Evaluation, r: Value) -> Value:
            x = e[f"{at.site.name}.corrected_flow"]
            dirt = 1.0 + at.c(e, "growth") * (e[SINCE_CHANGE] * 1e-3)
            return r * (1.0 - at.c(e, "loss") * dirt * (x * x))

        at.change_leaf(f"{at.site.name}.pressure_recovery", recovery)
