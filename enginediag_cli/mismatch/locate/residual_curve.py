"""One place of a map as an engineer would plot it: the residuals that it shows in, against its driver."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.projection import Projection

BINS, LEAST_IN_BIN = 14, 3
"""Bins of equal numbers of records for the drawn means, and records in one that has a mean."""


@dataclass(frozen=True)
class Shown:
    """Of the sensor that a cell moves most: driver (n,), residual and fitted curve (n,) in the sensor's unit, after
    what identification takes, and bins of the driver: centre, mean residual, its standard error, mean curve."""

    sensor: str
    unit: str
    x: np.ndarray
    residual: np.ndarray
    curve: np.ndarray
    bins: tuple[tuple[float, float, float, float], ...]


def residual_curve_points(projection: Projection, cell: Cell) -> Shown:
    """Residuals of the most affected sensor; records without a value of the driver are left out."""
    found, frame = projection.found, projection.frame
    fitted = cell.sums.rows_along(cell.candidates, cell.score.coefficients)[frame.keep]
    moved = [float((fitted[frame.sensor == s] ** 2).sum()) for s in range(len(found.problem.sensors))]
    s = int(np.argmax(moved))
    column = found.problem.sensors[s]
    rows = frame.sensor == s
    x = cell.driver.values[found.number][frame.record[rows]]
    good = np.isfinite(x)
    sigma = found.problem.sigma[s]
    residual, curve = sigma * projection.left[rows][good], sigma * fitted[rows][good]
    return Shown(
        column, found.evidence.engine.sensors[column].unit, x[good], residual, curve, _bins(x[good], residual, curve)
    )


def _bins(x: np.ndarray, residual: np.ndarray, curve: np.ndarray) -> tuple[tuple[float, float, float, float], ...]:
    """Bins of equal numbers of records; equal values stay together."""
    edges = np.unique(np.quantile(x, np.linspace(0.0, 1.0, BINS + 1)))
    of = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, max(len(edges) - 2, 0))
    found = []
    for b in np.unique(of):
        rows = of == b
        if rows.sum() >= LEAST_IN_BIN:
            error = float(residual[rows].std(ddof=1) / np.sqrt(rows.sum()))
            found.append((float(x[rows].mean()), float(residual[rows].mean()), error, float(curve[rows].mean())))
    return tuple(found)
