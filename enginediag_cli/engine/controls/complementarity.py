"""What a control between stops solves: "held, or at a stop that lets it be no nearer"."""

from __future__ import annotations

from enginediag_cli.engine.dual import Value, maximum, minimum


def between_stops(above_low: Value, below_high: Value, surplus: Value) -> Value:
    """The middle one of a, −b and F: zero where F = 0 between the stops, F ≥ 0 at the low one (a = 0) and F ≤ 0 at the
    high one (b = 0); F rises with the position. All (N,).

    Source: J.-S. Pang, Math. Oper. Res. 15 (1990) 311–341 (the natural residual of a mixed complementarity problem).
    """
    return maximum(-1.0 * below_high, minimum(above_low, surplus))
