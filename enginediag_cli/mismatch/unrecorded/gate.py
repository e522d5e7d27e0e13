"""What the largest likelihood ratio of many hidden amplitudes is worth when nothing is hidden.

Residuals in which nothing is missing are drawn, the nuisance is projected out of them as it is out of the data, and
the largest LR over locations, kernels and τ is kept. Its tail is exponential (½χ² with a slowly varying factor), so
the threshold is read from the tail's mean excess over its upper quarter, which needs fewer draws than the quantile:

    P(LR > t) = ¼ exp(−(t − u)/m),  t > u        u upper quartile, m mean excess over it
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.unrecorded.amplitude import Likelihood, likelihood
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction

TAIL = 0.25
"""Share of the drawn null that the exponential tail is fitted to: 50 draws at least, of the 200 that are made."""
MOST_DRAWS, LEAST_DRAWS, WORK = 600, 200, 100_000
"""Draws, and records times draws that a search may cost."""


def draws_for(records: int) -> int:
    """Number of null draws of a search over so many records."""
    return int(np.clip(WORK // max(records, 1), LEAST_DRAWS, MOST_DRAWS))


def likelihoods(
    of: Basis, along: Sequence[Direction], residuals: Sequence[np.ndarray], believed: Sequence[float]
) -> list[Likelihood]:
    """Per location, of several arrays of projected residuals (N, m, D); `believed`: standard deviation of each one's
    amplitude."""

    def gathered(d: Direction) -> np.ndarray:
        return np.concatenate([d.gathered(r) for r in residuals], axis=1)

    return [likelihood(d, of.gap, gathered(d), b) for d, b in zip(along, believed, strict=True)]


def largest(found: Sequence[Likelihood]) -> np.ndarray:
    """Largest LR of each residual over all locations, (D,)."""
    return np.asarray(np.max([f.best for f in found], axis=0))


def threshold(null: np.ndarray, level: float) -> float:
    """LR that null draws (D,) exceed with probability `level`."""
    if level >= TAIL:
        return float(np.quantile(null, 1.0 - level))
    u = float(np.quantile(null, 1.0 - TAIL))
    above = null[null > u] - u
    return u + (float(above.mean()) if above.size else 0.0) * float(np.log(TAIL / level))
