"""Position error of the aircraft's static-pressure source."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from enginediag_cli.drivers import MACH
from enginediag_cli.engine import atmosphere
from enginediag_cli.engine.atmosphere import GRAVITY, R_AIR, standard_atmosphere
from enginediag_cli.engine.dual import Value, select, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.term import Coefficient, Place, Site, Term
from enginediag_cli.physics.parts import flies

if TYPE_CHECKING:
    from enginediag_cli.engine.network import Network


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
            "error", "1", "error k of the recorded static pressure per M²", 0.0, -0.03, 0.03, 0.008, 0.008, assumed=True
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
            T_recorded = standard_atmosphere(_recorded(h, k * (R_AIR / GRAVITY)))[0] + recorded
            return T_recorded * (1.0 - (2.0 / 7.0) * k) - standard_atmosphere(h)[0]

        at.on_leaf("mach", mach_number)
        at.on_leaf("altitude_m", altitude)
        at.on_leaf("dT_isa_K", deviation)


def _recorded(h: Value, c: Value) -> Value:
    """The recorded altitude h_rec of h = h_rec + c T_ISA(h_rec)."""
    low = (h - c * atmosphere.T_ISA) / (1.0 - c * atmosphere.LAPSE)
    return select(value(low) < atmosphere.H_TROPOPAUSE, low, h - c * atmosphere.T_TROPOPAUSE)
