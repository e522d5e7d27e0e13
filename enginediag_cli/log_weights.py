"""Sums over hypotheses whose weights are known by their logarithms."""

from __future__ import annotations

import numpy as np


def normalized_weights(log: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Weights exp(log) that sum to 1 over `axis`, or over all where that is None."""
    total = np.logaddexp.reduce(log, axis=axis)
    return np.asarray(np.exp(log - (total if axis is None else np.expand_dims(total, axis))))


def log_mean(log: np.ndarray, axis: int = 0) -> np.ndarray:
    """Logarithm of the mean of exp(log) over `axis`: evidence of hypotheses that are equally probable a priori."""
    return np.asarray(np.logaddexp.reduce(log, axis=axis) - np.log(np.shape(log)[axis]))
