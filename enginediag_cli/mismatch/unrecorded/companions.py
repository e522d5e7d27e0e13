"""Errors that engines of one aircraft share.

They read the same air data at the same times and are computed by one model, so that what it does wrong it does wrong
for both: their readings at a time are not two independent ones. With the correlation r of the whitened residuals of
the same sensor, of k engines side by side,

    variance of their sum  =  k (1 + (k − 1) r) σ²

(the design effect of samples in clusters), and σ² is taken as that much larger, 1 + (k − 1) r, and as known from that
much fewer readings. An effect that all of them share raises r as well: it is then seen as well as by one engine, at
the worst, and never worse.

Source: L. Kish, "Survey Sampling", Wiley (1965), sec. 5.4 and 8.2.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.unrecorded.aircraft import grid_of

LEAST_PAIRS = 20
"""Times at which two engines are read, below which nothing is known of what they share."""


def with_shared_errors(projection: Projection) -> Dataset | None:
    """The evidence of a fit with the noise of engines that fly side by side; None where none do, or share nothing."""
    found = projection.found
    grid = grid_of(found)
    if grid is None:
        return None
    sensors, noise = found.problem.sensors, found.evidence.noise
    left = grid.laid(projection.residual).reshape(grid.rows, grid.seats, -1)
    there = grid.laid(projection.frame.keep).reshape(left.shape)
    shared = {s: _alike(left[:, :, j], there[:, :, j]) for j, s in enumerate(sensors)}
    if max(shared.values()) <= 1.0:
        return None
    sigma = {s: v * np.sqrt(shared.get(s, 1.0)) for s, v in noise.sigma.items()}
    return replace(found.evidence, noise=replace(noise, sigma=sigma, shared=shared))


def _alike(left: np.ndarray, there: np.ndarray) -> float:
    """1 + (k − 1) r of residuals (rows, k) where there are readings (rows, k), r of all pairs of engines."""
    k = left.shape[1]
    product, first, second = 0.0, 0.0, 0.0
    pairs = 0
    for a in range(k):
        for b in range(a + 1, k):
            rows = there[:, a] & there[:, b]
            pairs += int(rows.sum())
            product += float(left[rows, a] @ left[rows, b])
            first += float(left[rows, a] @ left[rows, a])
            second += float(left[rows, b] @ left[rows, b])
    if pairs < LEAST_PAIRS or not first * second > 0.0:
        return 1.0
    return 1.0 + (k - 1) * float(np.clip(product / np.sqrt(first * second), 0.0, 1.0))
