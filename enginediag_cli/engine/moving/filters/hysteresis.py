"""Hysteresis: between two thresholds it depends on where the signal came from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.moving.filters.base import Clock, Filter, Filtered


class Hysteresis(Filter):
    """1 while u lies within [u₀, u₀ + band) and was last outside below u₀, else 0; 0 where a stretch begins within the
    band, since nobody knows. Records show where u has been: what passes between two of them is not seen.

    It jumps, and has no derivative."""

    COEFFICIENTS = 2

    def __call__(self, clock: Clock, signal: Array, along: Array, coefficients: Sequence[float]) -> Filtered:
        low, band = (float(c) for c in coefficients)
        below, above = signal < low, signal >= low + max(band, 0.0)
        # of each record the last one outside the band, and whether that is of its own stretch
        record = np.arange(len(signal))
        outside = np.maximum.accumulate(np.where(below | above, record, -1))
        begin = np.maximum.accumulate(np.where(clock.first, record, 0))
        known = outside >= begin
        value = (known & below[np.maximum(outside, 0)] & ~below & ~above).astype(float)
        return Filtered(value, np.zeros_like(along), np.zeros((2, len(signal))))
