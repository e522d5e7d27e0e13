"""The step in which a sensor is recorded: noise is not known to be smaller than its rounding."""

from __future__ import annotations

import numpy as np

ROUNDING = 1e-9
"""Relative difference below which two readings are the same number, written or converted differently."""


def quantisation_sigma(measured: np.ndarray) -> np.ndarray:
    """q/√12 of each sensor (m,) from its readings (N, m), NaN where missing; q is the smallest step between them.

    The standard deviation of rounding to steps of q (W. R. Bennett, Bell Syst. Tech. J. 27 (1948) 446–472).
    Readings that hardly ever leave one step look exact and are not. Finely recorded readings have a step
    near zero; a sensor that gives one value only has none, and 0 is returned.
    """
    out = np.zeros(measured.shape[1])
    for j in range(measured.shape[1]):
        values = np.unique(measured[np.isfinite(measured[:, j]), j])
        steps = np.diff(values)
        steps = steps[steps > ROUNDING * np.max(np.abs(values), initial=0.0)]
        if steps.size:
            out[j] = float(steps.min()) / np.sqrt(12.0)
    return out
