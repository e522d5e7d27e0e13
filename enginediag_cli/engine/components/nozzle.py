"""Convergent nozzle: swallowing capacity and thrust."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.components.base import FROM, NAME, Actuator, Component, Design, scalar
from enginediag_cli.engine.dual import Value, exp, log, maximum, select, sqrt, value
from enginediag_cli.engine.evaluation import Evaluation
from enginediag_cli.engine.flow import Flow
from enginediag_cli.parameters import Parameter, spelled

SMALLEST_LOG_RATIO = 1e-4  # within it the flow passes linearly through zero
OPENING = Field(
    "opening_range",
    "range",
    "least and greatest throat area over that of the design point, of a nozzle whose area the actuator "
    "<nozzle>.opening varies; default a fixed area",
    None,
)


class Expansion(NamedTuple):
    """What a nozzle makes of a flow, arrays (N,): mass flux at the throat [kg/(s m²)], velocity at the exit [m/s], the
    force of the exit's pressure above ambient per throat area [Pa], and exit over throat area where they differ."""

    flux: Value
    V: Value
    excess_Pa: Value
    area_ratio: Value | None = None


class Nozzle(Component):
    """Throat flow ρ V A C_d at ambient pressure, or at the critical pressure once choked.

    Throat state from φ_th = φ − R ln(P/p_th), V² = 2 (h − h_th); critical where h − h_* = γ_* R T_*/2. Gross
    thrust W V C_v + A C_d (p_th − p_0). A nozzle whose area can be varied has its throat times the opening.
    """

    TYPE = "nozzle"
    SECTION = Section(
        "nozzle",
        "convergent nozzle to ambient",
        (
            NAME,
            FROM,
            Field(
                "area_m2", "number", "throat area; default: what the design point needs", None, unit="m2", minimum=1e-6
            ),
            Field("discharge_coefficient", "number", "C_d", 1.0, minimum=0.5, maximum=1.05),
            Field("velocity_coefficient", "number", "C_v", 1.0, minimum=0.5, maximum=1.05),
            OPENING,
        ),
    )
    reference_area_m2 = 1.0
    converges = True  # its throat is its exit

    def __init__(self, values: Mapping[str, Any]):
        super().__init__(values)
        stops = self.values["opening_range"]
        if stops and not 0.0 < stops[0] <= 1.0 <= stops[1]:
            raise ValueError(f"{self.name}: opening_range must hold 1, the area of the design point, and be above 0")

    def actuators(self) -> tuple[Actuator, ...]:
        stops = self.values["opening_range"]
        if not stops:
            return ()
        return (Actuator(f"{self.name}.opening", "1", 1.0, stops[0], stops[1], f"{spelled(self.name)} opening"),)

    def parameters(self) -> tuple[Parameter, ...]:
        return (
            self.health("area", "throat area, factor", 0.02),
            self.design(
                "velocity_coefficient", Design(self.values["velocity_coefficient"], 0.005, 0.5, 1.05), "1", "C_v"
            ),
        )

    def evaluate(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        p0 = e.outputs["P0_Pa"]
        log_ratio = log(flow.P / p0)
        found = self._expanded(flow, log_ratio, p0)
        area = self._throat_area(e)
        e.balances[f"{self.name} flow"] = 1.0 - found.flux * area / flow.W
        C_v = e[f"{self.name}.velocity_coefficient"]
        e.add_output("gross_thrust_N", self._thrust(flow.W * found.V * C_v + area * found.excess_Pa))
        e.outputs[f"{self.name}_pressure_ratio"] = exp(log_ratio)
        if found.area_ratio is not None:
            e.outputs[f"{self.name}_area_ratio"] = found.area_ratio

    def _expanded(self, flow: Flow, log_ratio: Value, p0: Value) -> Expansion:
        flux, V, p_throat = throat(flow, log_ratio, p0)
        return Expansion(flux, V, p_throat - p0)

    def _thrust(self, gross: Value) -> Value:
        return gross

    def _throat_area(self, e: Evaluation) -> Value:
        """A C_d [m²] as the factor on it and the opening leave it."""
        area = e[f"{self.name}.area"] * (self.reference_area_m2 * self.values["discharge_coefficient"])
        return area * e[f"{self.name}.opening"] if self.values["opening_range"] else area

    def size(self, e: Evaluation) -> None:
        flow = e.flows[self.values["from"]]
        log_ratio = log(flow.P / e.outputs["P0_Pa"])
        if not scalar(log_ratio) > 0.0:
            ambient = scalar(e.outputs["P0_Pa"])
            raise ValueError(
                f"{self.name}: total pressure {scalar(flow.P):.0f} Pa is below ambient at design ({ambient:.0f} Pa): "
                f"{ambient / scalar(flow.P):.3f} times as much is the least; compressors give more at a higher "
                "pressure_ratio, and turbines take less from gas of a higher exit_temperature_K"
            )
        flux = self._expanded(flow, log_ratio, e.outputs["P0_Pa"]).flux
        needed = scalar(flow.W / flux) / self.values["discharge_coefficient"]
        self.reference_area_m2 = self.values["area_m2"] or needed
        self.evaluate(e)


def throat(flow: Flow, log_ratio: Value, p0: Value) -> tuple[Value, Value, Value]:
    """Mass flux ρV [kg/(s m²)], velocity [m/s] and static pressure [Pa] at the throat; arrays (N,)."""
    critical = flow.gas.critical_log_pressure_ratio(flow.T, flow.mixture)
    choked = np.asarray(value(log_ratio) > value(critical))
    expansion = select(choked, critical, log_ratio)
    backward = np.asarray(value(log_ratio) < SMALLEST_LOG_RATIO)
    if backward.any():  # met on the way to a solution only: flow out of ambient, the mirror image of flow into it
        expansion = select(backward, maximum(-1.0 * log_ratio, SMALLEST_LOG_RATIO), expansion)
        expansion = select(np.asarray(value(expansion) > value(critical)), critical, expansion)
    T, h = flow.gas.at_entropy(flow.phi - flow.R * expansion, flow.mixture)
    V = sqrt(2.0 * (flow.h - h))
    p = select(choked, flow.P * exp(-critical), p0)
    flux = p * V / (flow.R * T)
    if backward.any():
        flux = select(backward, flux * (log_ratio / expansion), flux)
    return flux, V, p
