"""Median and quantile as numpy gives them, to the last digit, for arrays without NaN.

numpy's own import its masked arrays, which takes as long as reading an engine file, and so much of the time in which a
command starts.
"""

from __future__ import annotations

import numpy as np


def median(x: np.ndarray) -> float:
    """Of x (n,), n ≥ 1."""
    ordered, half = np.sort(x), len(x) // 2
    return float(ordered[half] if len(x) % 2 else 0.5 * (ordered[half - 1] + ordered[half]))


def quantile(x: np.ndarray, share: float) -> np.ndarray:
    """Along the last axis of x (…, n), n ≥ 1, linear between order statistics: shape (…)."""
    ordered = np.sort(x, axis=-1)
    place = share * (x.shape[-1] - 1)
    below = int(place)
    low, high = ordered[..., below], ordered[..., min(below + 1, x.shape[-1] - 1)]
    t = place - below
    step = high - low
    return np.asarray(high - step * (1.0 - t) if t >= 0.5 else low + step * t)
