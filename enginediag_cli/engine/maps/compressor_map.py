"""Parametric compressor map in work and flow: smooth, monotone, from windmilling to full power.

With n = N/√θ and w = W√θ/δ, both relative to design, and flow coefficient x = w / n^e,

    work  ψ = n^q [1 + (s/c)(1 − x^c)]                         Δh/θ relative to design
    loss  L = n^q (1 − η_d) [1 + a (x − 1)² + b (n − 1)² + g (n − 1)]

and the isentropic work is ψ − L, so the isentropic efficiency is 1 − L/ψ: η_d at design. The
enthalpy rise falls with flow for every x > 0 (s, c > 0), the speed lines steepen towards choke as c grows,
and no auxiliary map coordinate is needed. Form: work–flow similarity of turbomachines (J. H. Horlock,
Axial Flow Compressors, 1958, ch. 3); coefficients are for identification, their defaults assumed.
"""

from __future__ import annotations

from enginediag_cli.config.fields import Field
from enginediag_cli.engine.dual import Value, exp, log, power

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
