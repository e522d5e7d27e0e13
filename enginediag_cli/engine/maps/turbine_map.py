"""Parametric turbine map: flow capacity and isentropic efficiency, smooth and monotone in pressure ratio.

    capacity    W√T/P relative to design = √(1 − PR^−k) / √(1 − PR_d^−k) · [1 − c (N/√T − 1)]
    efficiency  η/η_d = 1 − a (ν/ν_d − 1)²,   ν = N / √(ideal enthalpy drop)  (blade-speed ratio)

The capacity is Stodola's ellipse law with exponent k: k = 2 for a many-stage turbine, larger the fewer
stages there are to choke (A. Stodola, Steam and Gas Turbines, 1927; J. H. Horlock, Axial Flow Turbines, 1966).
"""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.engine.dual import Value, exp, sqrt

FIELDS = (
    Field("choking_exponent", "number", "k: how early the flow capacity saturates", 3.0, minimum=0.5, maximum=12.0),
    Field("capacity_speed_slope", "number", "c: fall of flow capacity with speed", 0.0, minimum=-0.5, maximum=0.5),
    Field("efficiency_loading", "number", "a: loss off the design blade-speed ratio", 0.5, minimum=0.0, maximum=5.0),
)
NAMES = tuple(f.name for f in FIELDS)


def saturation(log_pressure_ratio: Value, choking_exponent: Value) -> Value:
    """√(1 − PR^−k), shape (N,)."""
    return sqrt(1.0 - exp(-(choking_exponent * log_pressure_ratio)))


def relative_capacity(
    log_pressure_ratio: Value, speed: Value, design_log_ratio: float, coefficient: dict[str, Value]
) -> Value:
    """W√T/P relative to design at ln PR and relative N/√T, shape (N,)."""
    k = coefficient["choking_exponent"]
    shape = saturation(log_pressure_ratio, k) / saturation(design_log_ratio, k)
    slope = coefficient["capacity_speed_slope"]
    return shape if isinstance(slope, float) and slope == 0.0 else shape * (1.0 - slope * (speed - 1.0))


def relative_efficiency(blade_speed_ratio: Value, coefficient: dict[str, Value]) -> Value:
    """η/η_d at ν/ν_d, shape (N,)."""
    off = blade_speed_ratio - 1.0
    return 1.0 - coefficient["efficiency_loading"] * (off * off)
