"""Gross outliers that need no model: single records, or two in a row, far from both sides and from all that the column
reads at any time. What lies within its usual range is judged by the model (`residuals/gross_errors.py`)."""

from __future__ import annotations

import numpy as np

WINDOW = 9
"""Records of the median: four on either side, so that a spike of two in a row does not move it."""
TOLERATED = 3
"""A spike is at most this many records less one long; what lasts longer is left for detection to judge."""
GROSS = 0.05
"""Share of the column's usual span (5th to 95th percentile) below which nothing counts as gross."""
OUTSIDE = 0.2
"""A value this share of the span (0.5th to 99.5th percentile) beyond it is not of the engine's doing."""


@np.errstate(all="ignore")  # readings near the largest number: their span is infinite, which is what it should be
def spikes(values: np.ndarray, threshold: float = 8.0, isolation: float = 2.5) -> np.ndarray:
    """Mask (N,) of the spikes of a column (N,) that lie outside its usual span, by a Hampel filter.

    Hampel (1974), Davies and Gather (1993, JASA 88): r_k = x_k − median of the 9 records around k. A spike
    has |r_k| above `threshold` robust standard deviations of r over the recording, above 4 quanta of the
    sensor, above 5 % of the column's usual span, and above `isolation` times the third largest
    deviation from the median in that window. The last condition spares steps, ramps and throttle
    transients, where the neighbours deviate too. NaN are passed over. A column that stands still in most records (a
    valve, a flap) may move at any time: it has no outliers. On Gaussian data none is marked in 10⁵.
    """
    spike = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < WINDOW:
        return spike
    x = values[finite]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, WINDOW // 2, mode="reflect"), WINDOW)
    centre = np.partition(windows, WINDOW // 2, axis=1)[:, WINDOW // 2]
    residual = np.abs(x - centre)
    scale = 1.4826 * np.median(residual)
    if scale == 0.0 or not residual.max() > threshold * scale:  # the usual case, without the search for the span
        return spike
    lowest, low, high, highest = np.percentile(x, [0.5, 5.0, 95.0, 99.5])
    least = max(threshold * scale, GROSS * (high - low))
    margin = OUTSIDE * (highest - lowest)
    suspects = np.flatnonzero((residual > least) & ((x < lowest - margin) | (x > highest + margin)))
    if not suspects.size:
        return spike
    levels = np.unique(x)
    quantum = np.diff(levels).min() if len(levels) > 1 else 0.0
    deviations = np.sort(np.abs(windows[suspects] - centre[suspects, None]), axis=1)[:, -TOLERATED]
    grave = (residual[suspects] > 4.0 * quantum) & (residual[suspects] > isolation * deviations)
    spike[finite[suspects[grave]]] = True
    return spike
