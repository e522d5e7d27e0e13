"""Noise as later stages must expect it: what the model leaves on records that its fit has not seen.

A generic engine model is wrong by more than its sensors scatter, differently from one stretch of a flight to the
next. Cross-validation shows by how much; a test that reckons with the sensors' scatter alone cries wolf.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.identification.noise import NoiseEstimate, estimate_noise


def noise_on_unseen(residual: np.ndarray, gap: np.ndarray, floor: np.ndarray) -> NoiseEstimate:
    """Noise from residuals (N, m), NaN where missing, of records predicted by a fit without them;
    `gap` (N,) as for `estimate_noise`.

    The scale is the root mean square of all readings, none left out: where the model is at its worst is part of
    what it will do again. `floor` (m,) is the noise of the fit, below which prediction cannot be.
    """
    found = estimate_noise(residual, gap, np.zeros(residual.shape[1]), floor)
    there = np.isfinite(residual)
    squares = np.sum(np.where(there, residual, 0.0) ** 2, axis=0)
    rms = np.sqrt(squares / np.maximum(there.sum(axis=0), 1))
    return replace(found, sigma=np.maximum(rms, floor), sigma_from="cross_validation")
