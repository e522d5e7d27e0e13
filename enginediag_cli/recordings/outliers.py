"""Gross outliers: single records, or two in a row, that stand far from both sides."""

from __future__ import annotations

from collections.abc import Mapping

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
def spikes(values: np.ndarray, threshold: float = 8.0, isolation: float = 2.5) -> tuple[np.ndarray, np.ndarray]:
    """Masks (N,), (N,) of the spikes by a Hampel filter, and of those that lie outside the usual span.

    Hampel (1974), Davies and Gather (1993, JASA 88): r_k = x_k − median of the 9 records around k. A spike
    has |r_k| above `threshold` robust standard deviations of r over the recording, above 4 quanta of the
    sensor, above 5 % of the column's usual span, and above `isolation` times the third largest
    deviation from the median in that window. The last condition spares steps, ramps and throttle
    transients, where the neighbours deviate too. NaN are passed over. On Gaussian data none is marked in 10⁵.
    """
    spike = np.zeros(len(values), dtype=bool)
    outside = np.zeros(len(values), dtype=bool)
    finite = np.flatnonzero(np.isfinite(values))
    if len(finite) < WINDOW:
        return spike, outside
    x = values[finite]
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, WINDOW // 2, mode="reflect"), WINDOW)
    centre = np.partition(windows, WINDOW // 2, axis=1)[:, WINDOW // 2]
    residual = np.abs(x - centre)
    scale = 1.4826 * np.median(residual)
    if not residual.max() > threshold * scale:  # the usual case, without the search for the span
        return spike, outside
    lowest, low, high, highest = np.percentile(x, [0.5, 5.0, 95.0, 99.5])
    least = max(threshold * scale, GROSS * (high - low))
    suspects = np.flatnonzero(residual > least)
    if not suspects.size:
        return spike, outside
    levels = np.unique(x)
    quantum = np.diff(levels).min() if len(levels) > 1 else 0.0
    deviations = np.sort(np.abs(windows[suspects] - centre[suspects, None]), axis=1)[:, -TOLERATED]
    grave = (residual[suspects] > 4.0 * quantum) & (residual[suspects] > isolation * deviations)
    spike[finite[suspects[grave]]] = True
    margin = OUTSIDE * (highest - lowest)
    outside[finite] = spike[finite] & ((x < lowest - margin) | (x > highest + margin))
    return spike, outside


def outliers(columns: Mapping[str, np.ndarray], threshold: float = 8.0) -> dict[str, np.ndarray]:
    """Column → mask (N,) of gross outliers: spikes of one column alone, or outside that column's usual span.

    A short event of the engine (one hour at part load in hourly data, a throttle blip) makes several columns
    jump in the same record, each to a value that it takes at other times too: that is not a bad reading.
    """
    found = {name: spikes(values, threshold) for name, values in columns.items()}
    if not found:
        return {}
    together = np.sum([spike for spike, _ in found.values()], axis=0)
    return {name: spike & ((together < 2) | outside) for name, (spike, outside) in found.items()}
