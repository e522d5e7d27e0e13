"""The reach of a 95 % interval, written once, and sums over hypotheses in logarithms of weights."""

from __future__ import annotations

import numpy as np

NORMAL_95 = 1.959964
"""Standard errors on either side of the mean that hold 95 % of a normal law: the quantile of 0.975, Φ⁻¹(0.975) =
1.959963984…, to seven digits. 95 % because that is what engineers quote."""


def log_sum(log: np.ndarray, axis: int | None = None) -> np.ndarray:
    """Logarithm of the sum of exp(log) over `axis`, or over all where that is None; −inf of no weight at all."""
    most = np.max(log, axis=axis, keepdims=True)
    most = np.where(np.isfinite(most), most, 0.0)
    with np.errstate(divide="ignore"):
        found = np.log(np.sum(np.exp(log - most), axis=axis, keepdims=True)) + most
    return np.asarray(found.reshape(()) if axis is None else np.squeeze(found, axis))


def normalized_weights(log: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Weights exp(log) that sum to 1 over `axis`, or over all where that is None."""
    total = log_sum(log, axis)
    return np.asarray(np.exp(log - (total if axis is None else np.expand_dims(total, axis))))


def log_mean(log: np.ndarray, axis: int = 0) -> np.ndarray:
    """Logarithm of the mean of exp(log) over `axis`: evidence of hypotheses that are equally probable a priori."""
    return np.asarray(log_sum(log, axis) - np.log(np.shape(log)[axis]))
