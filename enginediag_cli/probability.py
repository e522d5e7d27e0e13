"""The reach of a 95 % interval, written once, and sums over hypotheses in logarithms of weights."""

from __future__ import annotations

import numpy as np

NORMAL_95 = 1.959964
"""Standard errors on either side of the mean that hold 95 % of a normal law: the quantile of 0.975, Φ⁻¹(0.975) =
1.959963984…, to seven digits. 95 % because that is what engineers quote."""


def normalized_weights(log: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Weights exp(log) that sum to 1 over `axis`, or over all where that is None."""
    total = np.logaddexp.reduce(log, axis=axis)
    return np.asarray(np.exp(log - (total if axis is None else np.expand_dims(total, axis))))


def log_mean(log: np.ndarray, axis: int = 0) -> np.ndarray:
    """Logarithm of the mean of exp(log) over `axis`: evidence of hypotheses that are equally probable a priori."""
    return np.asarray(np.logaddexp.reduce(log, axis=axis) - np.log(np.shape(log)[axis]))
