"""What a model that is wrong at an operating point leaves in all records of that point, and how it weakens the data.

Records at one operating point share the model's error there, whatever their number: a thousand flights at one point say
where the model's error lies, not that there is none. With the records of the fit dealt to cells of their operating
points, n_c in cell c, the residuals of each sensor are an error σ_m of the cell and a scatter σ_w of its records,

    E (mean of cell c)² = σ_m² + σ_w²/n_c,        κ = 1 + n̄ σ_m²/σ²,    n̄ = Σ n_c²/N,

and the fit weighs the readings by 1/(κσ²), as many as they are worth. Where the model fits, σ_m vanishes and κ is 1, so
that records count in full. Only snapshots are so dealt: along a recording with a clock the model's error changes with
time and is seen as correlation (`noise.py`). Estimation: one-way analysis of variance, lack of fit against pure error
(N. R. Draper and H. Smith, Applied Regression Analysis, §2.1).
"""

from __future__ import annotations

import numpy as np

CELL = 0.1
"""Side of a cell, as a share of the range of what is predicted: the error of a generic map changes over about that."""
SAME = 0.01
"""Relative change of the readings below which operating points are one: less is the scatter of a control."""
WAYS = 3
"""Directions in which operating points are told apart: power, and two of flight and weather."""
EMPTY = 0.25
"""Part of a cell without any value that ends a cell, so that none ends within a condition that is flown again and
again: judgement."""
LEAST_WORTH = 8.0
"""Readings that a cell is worth at least. Judgement: with as few as 2 a fit of three to six conditions gives up what it
could learn of the maps, with 20 map shapes go to where no compressor is."""
BY_CHANCE = 2.0
"""Standard deviations of chance by which cells must differ more than their records do, before they count as misfit."""
LEAST_LEFT = 0.25
"""Share of the cells of which the fit has left the error at least: where it used up more, the rest says too little."""


def follows_no_clock(gap: np.ndarray) -> bool:
    """Whether the records (N,) of every recording merely follow each other, as snapshots do."""
    return bool(np.all(gap[np.isfinite(gap)] == 1.0))


def cells_of(predicted: np.ndarray) -> np.ndarray:
    """Cell of each record, (N,) int from 0, by the predicted readings (N, m), NaN where there is none."""
    return np.unique(Cells(predicted).places(predicted), axis=0, return_inverse=True)[1].reshape(-1)


class Cells:
    """Cells of operating points, laid by the predicted readings (N, m) of some records, NaN where there is none.

    Inputs have no common scale (an hour of weather, a metre of altitude): what they do to the readings has. A direction
    is cut where there are no values, and between such cuts into intervals of one length.
    """

    def __init__(self, predicted: np.ndarray):
        size = np.nanmean(np.abs(predicted), axis=0)
        self._size = np.where(size > 0, size, 1.0)
        y = self._scaled(predicted)
        self._centre = y.mean(axis=0)
        values, ways = np.linalg.eigh((y - self._centre).T @ (y - self._centre))
        self._ways = ways[:, np.argsort(values)[::-1][:WAYS]]
        scores = (y - self._centre) @ self._ways
        self._side = max(CELL * float(np.ptp(scores[:, 0])), SAME * np.sqrt(y.shape[1]))
        self._first = []  # of each direction, the lowest value of each stretch without a gap
        for score in np.sort(scores, axis=0).T:
            self._first.append(score[np.diff(score, prepend=-np.inf) > EMPTY * self._side])

    def places(self, predicted: np.ndarray) -> np.ndarray:
        """Place of the cell of each record, (N, 2 WAYS) int: stretch and interval of each direction."""
        scores = (self._scaled(predicted) - self._centre) @ self._ways
        found = np.empty((len(scores), 2 * scores.shape[1]), int)
        for i, (u, first) in enumerate(zip(scores.T, self._first, strict=True)):
            stretch = np.maximum(np.searchsorted(first, u, side="right") - 1, 0)
            found[:, 2 * i], found[:, 2 * i + 1] = stretch, np.floor((u - first[stretch]) / self._side)
        return found

    def _scaled(self, predicted: np.ndarray) -> np.ndarray:
        return np.asarray(np.nan_to_num(predicted / self._size, nan=1.0))


def lack_of_fit(
    predicted: np.ndarray, residual: np.ndarray, sigma: np.ndarray, correlated: np.ndarray, used: np.ndarray
) -> np.ndarray:
    """κ (m,), at least 1, from predictions and residuals (N, m), NaN where missing, of readings of noise `sigma` (m,).

    `correlated` (m,): readings per independent one by the correlation in time, which also makes records of one cell
    alike; `used` (m,): readings of each sensor that the fit has used up.
    """
    cell = cells_of(predicted)
    there = np.isfinite(residual)
    e = np.where(there, residual, 0.0)
    count = int(cell.max()) + 1
    n = np.stack([np.bincount(cell, t, count) for t in there.T.astype(float)], axis=1)  # (cells, m)
    mean = np.stack([np.bincount(cell, column, count) for column in e.T], axis=1) / np.maximum(n, 1)
    N, filled = np.maximum(n.sum(axis=0), 1), np.maximum((n > 0).sum(axis=0), 1)
    within = np.sum(np.where(there, (e - mean[cell]) ** 2, 0.0), axis=0) / np.maximum(N - filled, 1)
    # what chance makes of as many means, and as much again twice as it scatters
    chance = filled * within * np.maximum(correlated, 1.0) * (1 + BY_CHANCE * np.sqrt(2 / filled))
    between = np.maximum(np.sum(n * mean**2, axis=0) - chance, 0.0) / N
    between *= filled / np.maximum(filled - used, LEAST_LEFT * filled)
    crowd = np.sum(n**2, axis=0) / N
    kappa = 1.0 + crowd * between / sigma**2
    return np.clip(kappa, 1.0, np.maximum(crowd / LEAST_WORTH, 1.0))
