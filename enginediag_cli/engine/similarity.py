"""Quantities of the gas path that several terms vary with, from an evaluation under way."""

from __future__ import annotations

from enginediag_cli.engine.atmosphere import P_ISA, T_ISA
from enginediag_cli.engine.dual import Value, power, sqrt
from enginediag_cli.engine.flow import Flow

SUTHERLAND_K = 110.4  # Sutherland's constant of air


def viscosity_ratio(T_K: Value) -> Value:
    """μ(T)/μ(288.15 K) by Sutherland's law, μ ∝ T^1.5/(T + 110.4 K) (U.S. Standard Atmosphere 1976, eq. 51)."""
    t = T_K * (1.0 / T_ISA)
    return power(t, 1.5) * ((T_ISA + SUTHERLAND_K) / (T_K + SUTHERLAND_K))


def reynolds_index(flow: Flow) -> Value:
    """RNI = (P/P_ISA)(μ_ISA/μ)√(T_ISA/T): Reynolds number at equal Mach numbers over that at ISA sea level."""
    return reynolds_index_of(flow.T, flow.P)


def corrected_flow(flow: Flow) -> Value:
    """W √θ/δ [kg/s]."""
    return flow.W * sqrt(flow.T * (1.0 / T_ISA)) / (flow.P * (1.0 / P_ISA))


def reynolds_index_of(T_K: Value, P_Pa: Value) -> Value:
    """RNI at total temperature [K] and pressure [Pa]."""
    return P_Pa * (1.0 / P_ISA) / (viscosity_ratio(T_K) * sqrt(T_K * (1.0 / T_ISA)))
