"""Noise without memory, and the statistics of records that are one block."""

from __future__ import annotations

import numpy as np

from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.statistics import block_statistics


def white_noise(sigma):
    """Independent noise of standard deviation `sigma` (m,)."""
    sigma = np.asarray(sigma, float)
    return NoiseModel(sigma, np.zeros_like(sigma))


def local_statistics(e, J, noise, frame, *, lags=None, information=None):
    """Statistics of all records together; arguments as in `block_statistics`, information (p, p)."""
    known = None if information is None else information[None]
    return next(block_statistics(e, J, noise, np.array([0]), frame, lags=lags, information=known)).statistics
