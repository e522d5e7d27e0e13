"""Hysteresis: between two thresholds it depends on where the signal came from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.moving.filters.base import Clock, Filter, Filtered


def came_from(clock: Clock, above: Array, below: Array) -> tuple[Array, Array]:
    """Whether a signal was last above a band, not below it, and whether its stretch tells (…, N); `above` and `below`
    it is now, (…, N)."""
    record = np.arange(len(clock.first))
    outside = np.maximum.accumulate(np.where(below | above, record, -1), axis=-1)
    begin = np.maximum.accumulate(np.where(clock.first, record, 0))
    return np.take_along_axis(above, np.maximum(outside, 0), axis=-1), outside >= begin


class Hysteresis(Filter):
    """1 while u lies within [u₀, u₀ + band) and was last outside below u₀, else 0; 0 where a stretch begins within the
    band, since nobody knows. Records show where u has been: what passes between two of them is not seen.

    It jumps, and has no derivative."""

    COEFFICIENTS = 2

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        low, band = (float(c) for c in coefficients)
        below, above = signal < low, signal >= low + max(band, 0.0)
        from_above, known = came_from(clock, above, below)
        value = (known & ~from_above & ~below & ~above).astype(float)
        return Filtered(value, np.zeros_like(along), np.zeros((2, len(signal))))
