"""Convergent nozzle: swallowing capacity and thrust."""

from __future__ import annotations

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, Component, scalar
from enginediag_cli.engine.dual import Value, chain, exp, log, maximum, select, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.engine.gas import Mixture
from enginediag_cli.parameters import Parameter

SMALLEST_LOG_RATIO = 1e-4  # below it the flow falls linearly to zero, so that the iteration can pass


class Nozzle(Component):
    """Throat flow ρ V A C_d at ambient pressure, or at the critical pressure once choked.

    Throat state from φ_th = φ − R ln(P/p_th), V² = 2 (h − h_th). The critical state solves
    h − h_* = γ_* R T_*/2. Gross thrust W V C_v + A C_d (p_th − p_0).
    """

    TYPE = "nozzle"
    SECTION = Section("nozzle", "convergent nozzle to ambient", (
        NAME, FROM,
        Field("area_m2", "number", "throat area; default: what the design point needs", None, unit="m2", minimum=1e-6),
        Field("discharge_coefficient", "number", "C_d", 1.0, minimum=0.5, maximum=1.05),
        Field("velocity_coefficient", "number", "C_v", 1.0, minimum=0.5, maximum=1.05),
    ))
    reference_area_m2 = 1.0

    def parameters(self) -> tuple[Parameter, ...]:
        return (self.health("area", "throat area, factor", 0.02),
                self.design("velocity_coefficient", self.values["velocity_coefficient"], 0.005, 0.5, 1.05, "1", "C_v"))

    def evaluate(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        p0 = e.outputs["P0_Pa"]
        log_ratio = log(flow.P / p0)
        flux, V, p_throat = throat(flow, log_ratio, p0)
        area = e[f"{self.name}.area"] * (self.reference_area_m2 * self.values["discharge_coefficient"])
        e.balances[f"{self.name} flow"] = 1.0 - flux * area / flow.W
        C_v = e[f"{self.name}.velocity_coefficient"]
        e.add_output("gross_thrust_N", flow.W * V * C_v + area * (p_throat - p0))
        e.outputs[f"{self.name}_pressure_ratio"] = exp(log_ratio)

    def size(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        log_ratio = log(flow.P / e.outputs["P0_Pa"])
        if not scalar(log_ratio) > 0.0:
            raise ValueError(f"{self.name}: total pressure {scalar(flow.P):.0f} Pa is below ambient at design")
        flux, _, _ = throat(flow, log_ratio, e.outputs["P0_Pa"])
        needed = scalar(flow.W / flux) / self.values["discharge_coefficient"]
        self.reference_area_m2 = self.values["area_m2"] or needed
        self.evaluate(e)


def throat(flow: Flow, log_ratio: Value, p0: Value) -> tuple[Value, Value, Value]:
    """Mass flux ρV [kg/(s m²)], velocity [m/s] and static pressure [Pa] at the throat; arrays (N,)."""
    gas, mixture, R = flow.gas, flow.mixture, flow.R
    critical = _critical_log_ratio(flow)
    choked = np.asarray(value(log_ratio) > value(critical))
    expansion = maximum(select(choked, critical, log_ratio), SMALLEST_LOG_RATIO)
    T = gas.temperature_from_entropy(flow.phi - R * expansion, mixture)
    V = sqrt(2.0 * (flow.h - gas.enthalpy(T, mixture)))
    p = select(choked, flow.P * exp(-critical), p0)
    flux = p * V / (R * T)
    too_low = np.asarray(value(log_ratio) < SMALLEST_LOG_RATIO)
    if too_low.any():
        flux = select(too_low, flux * (log_ratio * (1.0 / SMALLEST_LOG_RATIO)), flux)
    return flux, V, p


def _critical_log_ratio(flow: Flow) -> Value:
    """ln(P/p_*) at Mach 1: Newton's method on values for T_*, one step in derivative arithmetic to finish."""
    gas, mixture = flow.gas, flow.mixture
    plain = Mixture(*(None if x is None else value(x) for x in (mixture.far, mixture.war)))
    h, R, T = value(flow.h), value(flow.R), value(flow.T)
    T_star = T * (1.0 / 1.17)
    for _ in range(3):
        parts_h, parts_cp, parts_dcp = gas.h_cp_dcp(T_star, plain)
        gamma = parts_cp / (parts_cp - R)
        f = h - parts_h - 0.5 * gamma * R * T_star
        slope = -parts_cp - 0.5 * gamma * R * (1.0 - T_star * parts_dcp * R / (parts_cp * (parts_cp - R)))
        T_star = T_star - f / slope
    cp = gas.heat_capacity(T_star, mixture)
    excess = flow.h - gas.enthalpy(T_star, mixture) - 0.5 * (cp / (cp - flow.R)) * flow.R * T_star
    T_exact = chain(T_star, (-1.0 / slope, excess))
    return (flow.phi - gas.entropy(T_exact, mixture)) / flow.R
