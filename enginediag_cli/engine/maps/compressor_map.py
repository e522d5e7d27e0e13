"""Parametric compressor map in work and flow: smooth, monotone, from windmilling to full power.

With n = N/√θ and w = W√θ/δ, both relative to design, and flow coefficient x = w / n^e,

    work  ψ = n^q [1 + (s/c)(1 − x^c)]                         Δh/θ relative to design
    loss  L = n^q (1 − η_d) [1 + a (x − 1)² + b (n − 1)² + g (n − 1)]

and the isentropic work is ψ − L, so the isentropic efficiency is 1 − L/ψ: η_d at design. The
enthalpy rise falls with flow for every x > 0 (s, c > 0), the speed lines steepen towards choke as c grows,
and no auxiliary map coordinate is needed. Form: work–flow similarity of turbomachines (J. H. Horlock,
Axial Flow Compressors, 1958, ch. 3); coefficients are for identification, their defaults assumed.

What guide vanes and variable stators do to a compressor's map when they close further than it holds.

With a closing Δφ in degrees beyond the schedule that the map was measured with (negative: opened),

    W_c = W_c,map exp(−a Δφ),    η = η_map/(1 + b Δφ²)

to first order −a Δφ and −b Δφ², and sensible for any angle. Form: the variable-geometry inputs of NLR GSP and GasTurb,
a flow change per degree and a loss per square degree; magnitudes assumed.

The surge line of a compressor, and how far from it the compressor works.

The margin is that of pressure ratio at constant corrected flow, SM = PR_surge(W_c)/PR − 1. Others are in use and are
other numbers for the same point: at constant corrected speed (PR_surge/PR)(W_c/W_c,surge) − 1, for which one must know
where the speed line ends, and (PR_surge − PR)/(PR_surge − 1), which counts from a ratio of one. Below zero the point
lies beyond the line.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Value, chain, exp, log, power, value

FIELDS = (
    Field("work_slope", "number", "s: fall of work with flow coefficient at design", 1.2, minimum=0.05, maximum=8.0),
    Field(
        "choking_exponent", "number", "c: how much the speed lines steepen with flow", 3.0, minimum=0.5, maximum=15.0
    ),
    Field("flow_speed_exponent", "number", "e: flow at constant work coefficient ∝ n^e", 1.1, minimum=0.1, maximum=8.0),
    Field("work_speed_exponent", "number", "q: work at constant flow coefficient ∝ n^q", 2.0, minimum=0.5, maximum=4.5),
    Field(
        "loss_incidence", "number", "a: growth of loss off the best flow coefficient", 4.0, minimum=0.0, maximum=60.0
    ),
    Field("loss_speed", "number", "b: growth of loss off design speed", 0.5, minimum=-2.0, maximum=20.0),
    Field("loss_speed_slope", "number", "g: tilt of loss with speed", 0.0, minimum=-2.0, maximum=2.0),
)
NAMES = tuple(f.name for f in FIELDS)


def work_and_loss(n: Value, w: Value, design_loss: float, coefficient: dict[str, Value]) -> tuple[Value, Value]:
    """Relative work ψ and loss L of shape (N,) at relative corrected speed n and flow w."""
    c = coefficient
    log_n = log(n)
    x = w * exp(-(c["flow_speed_exponent"] * log_n))
    q = c["work_speed_exponent"]
    level = n * n if isinstance(q, float) and q == 2.0 else exp(q * log_n)
    work = level * (1.0 + (c["work_slope"] / c["choking_exponent"]) * (1.0 - power(x, c["choking_exponent"])))
    off_flow, off_speed = x - 1.0, n - 1.0
    loss = level * (
        design_loss
        * (
            1.0
            + c["loss_incidence"] * (off_flow * off_flow)
            + off_speed * (c["loss_speed"] * off_speed + c["loss_speed_slope"])
        )
    )
    return work, loss


VANES = Section(
    "vanes",
    "guide vanes and variable stators, moved by the actuator <compressor>.vane_closing_deg",
    (
        Field(
            "flow_per_deg",
            "number",
            "a: fall of corrected flow per degree of closing",
            0.01,
            unit="1/deg",
            minimum=0.0,
            maximum=0.05,
        ),
        Field(
            "loss_per_deg2",
            "number",
            "b: fall of efficiency per square degree",
            3e-4,
            unit="1/deg2",
            minimum=0.0,
            maximum=5e-3,
        ),
        Field("open_stop_deg", "number", "closing at the open stop; 0 is where the map holds", 0.0, unit="deg"),
        Field("closed_stop_deg", "number", "closing at the closed stop", 40.0, unit="deg"),
    ),
)


def closed_flow(flow: Value, flow_per_deg: Value, closing_deg: Value) -> Value:
    """Corrected flow, or a factor on it, (N,) with the vanes closed by `closing_deg` (N,)."""
    return flow * exp(-1.0 * (flow_per_deg * closing_deg))


def closed_efficiency(efficiency: Value, loss_per_deg2: Value, closing_deg: Value) -> Value:
    """Isentropic efficiency, or a factor on it, (N,) with the vanes closed by `closing_deg` (N,)."""
    return efficiency / (1.0 + loss_per_deg2 * (closing_deg * closing_deg))


SURGE_LINE = Section(
    "surge_line",
    "points at which the compressor surges; beyond the first and last one the straight line goes on",
    (
        Field(
            "corrected_flow",
            "numbers",
            "corrected flow of each point, rising: in the units of the table, or in kg/s where there is none",
        ),
        Field("pressure_ratio", "numbers", "pressure ratio of each point: that of the table, or as it is"),
    ),
)


class SurgeLine:
    """Straight lines between the points. Raises ValueError where they are no line."""

    def __init__(self, values: Mapping[str, Any]):
        self.flow = np.asarray(values["corrected_flow"], dtype=float)
        self.ratio = np.asarray(values["pressure_ratio"], dtype=float)
        if self.flow.size != self.ratio.size or self.flow.size < 2 or (np.diff(self.flow) <= 0.0).any():
            raise ValueError("corrected_flow of its surge_line must rise, with one pressure_ratio each, at least two")

    def at(self, flow: Value) -> Value:
        """Pressure ratio of surge (N,) at a corrected flow (N,)."""
        slope = np.diff(self.ratio) / np.diff(self.flow)
        w = np.asarray(value(flow))
        k = np.clip(np.searchsorted(self.flow, w, side="right") - 1, 0, slope.size - 1)
        return chain(self.ratio[k] + slope[k] * (w - self.flow[k]), (slope[k], flow))
