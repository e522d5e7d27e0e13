"""What guide vanes and variable stators do to a compressor's map when they close further than it holds.

With a closing Δφ in degrees beyond the schedule that the map was measured with (negative: opened),

    W_c = W_c,map exp(−a Δφ),    η = η_map/(1 + b Δφ²)

to first order −a Δφ and −b Δφ², and sensible for any angle. Form: the variable-geometry inputs of NLR GSP and GasTurb,
a flow change per degree and a loss per square degree; magnitudes assumed.
"""

from __future__ import annotations

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.engine.dual import Value, exp

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
