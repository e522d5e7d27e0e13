"""Does the answer hang on one flight? Scores of the map when whole flights are drawn again with replacement.

A score's numerator and its information are sums over flights, g = Σ_f n_f C_fᵀe_f and G = Σ_f n_f C_fᵀC_f with n_f
how often flight f was drawn, so T* = gᵀG⁻¹g of a resample costs nothing but the sums. Linear at the fit of all
flights; the nuisance is not estimated anew.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy import stats

from enginediag_cli.mismatch.fit.by_unit import unit_sums
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.progress import stage

RESAMPLES = 200
"""Of the flights: a share of half is known to 4 %."""
LEAST_UNITS = 6
"""With fewer flights than this, parts of flights are drawn."""


def units(projection: Projection) -> tuple[np.ndarray, int, str]:
    """Of every record, which unit it is drawn with (N,); their number; and what they are."""
    recording = projection.found.problem.recording
    flights = len(np.unique(recording))
    if flights >= LEAST_UNITS:
        _, of_record = np.unique(recording, return_inverse=True)
        return of_record, flights, "flights"
    parts = -(-LEAST_UNITS // flights)
    of_record, first = np.zeros(len(recording), int), 0
    for r in np.unique(recording):
        rows = np.flatnonzero(recording == r)
        of_record[rows] = first + np.arange(len(rows)) * parts // len(rows)
        first += parts
    return of_record, first, "parts of flights"


@stage("resampling flights")
def resampled_surprise(
    projection: Projection, cells: Sequence[Cell], rng: np.random.Generator
) -> tuple[np.ndarray, str]:
    """−ln p of every cell in every resample, (RESAMPLES, cells), and what was drawn."""
    unit, count, what = units(projection)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=RESAMPLES).astype(float)
    # what the priors' rows hold of the score is part of every resample
    times = np.column_stack([drawn, np.ones(len(drawn))])
    result = np.zeros((RESAMPLES, len(cells)))
    if not cells:
        return result, what
    sums = unit_sums(cells[0].sums, unit, count)
    for j, cell in enumerate(cells):
        if cell.score.absorbed:
            continue
        g, G = sums.of(cell.candidates)
        k = g.shape[1]
        gs, Gs = times @ g, (times @ G.reshape(count + 1, k * k)).reshape(-1, k, k)
        Gs = Gs + 1e-9 * np.trace(G.sum(axis=0)) * np.eye(k)
        T = np.einsum("rk,rk->r", gs, np.linalg.solve(Gs, gs[:, :, None])[:, :, 0])
        result[:, j] = -stats.chi2.logsf(np.maximum(T, 0.0), cell.score.dof)
    return result, what
