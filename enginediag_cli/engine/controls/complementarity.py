"""What a control between stops solves: the smooth form of "held, or at a stop that lets it be no nearer"."""

from __future__ import annotations

from enginediag_cli.engine.dual import Value, sqrt

TINY = 1e-30
"""Keeps the derivative finite where both arguments are zero; no residual is that small."""


def fischer_burmeister(a: Value, b: Value) -> Value:
    """φ(a, b) = a + b − √(a² + b²): zero where a ≥ 0, b ≥ 0 and a b = 0 (A. Fischer, Optimization 24, 1992), (N,)."""
    return a + b - sqrt(a * a + b * b + TINY)


def between_stops(above_low: Value, below_high: Value, surplus: Value) -> Value:
    """ψ = φ(a, −φ(b, −F)): zero where F = 0 between the stops, F ≥ 0 at the low one (a = 0) and F ≤ 0 at the high one
    (b = 0); F rises with the position (S. C. Billups, 1995). All (N,)."""
    return fischer_burmeister(above_low, -1.0 * fischer_burmeister(below_high, -1.0 * surplus))
