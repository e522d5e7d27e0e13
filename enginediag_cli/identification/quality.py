"""How well the model reproduces readings: RMS per sensor and regime, χ² per reading.

Flows, pressures, forces and powers are judged in per cent of the prediction, temperatures, speeds and all
else in the column's own unit, as the field does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.units import find_unit, split_column

RELATIVE_DIMENSIONS = ("pressure", "mass flow", "power", "force", "torque", "flow per pressure")
EVERYTHING = "all"


@dataclass(frozen=True)
class SensorQuality:
    """Fit of one sensor in one regime: `rms` in `unit`, `chi2` the mean of (e/σ)², outliers included."""

    sensor: str
    regime: str
    n: int
    rms: float
    unit: str
    chi2: float


def shown_unit(column: str) -> str:
    """'%' for a quantity that is judged relative to its value, else the unit in the column's name."""
    suffix = split_column(column)[1]
    return "%" if suffix and find_unit(suffix).dimension in RELATIVE_DIMENSIONS else suffix


def sensor_quality(
    sensors: Sequence[str],
    residual: np.ndarray,
    predicted: np.ndarray,
    sigma: np.ndarray,
    regimes: np.ndarray,
) -> tuple[SensorQuality, ...]:
    """Quality of m sensors over everything and in each regime.

    residual and predicted: (N, m) in the column's unit, NaN = missing; regimes: (N,) text. A sensor
    without readings in a regime has no entry there.
    """
    names = sorted(set(regimes.tolist()) - {EVERYTHING})
    masks = [(EVERYTHING, np.ones(len(regimes), bool))]
    masks += [(r, regimes == r) for r in names] if len(names) > 1 else []
    table = []
    for s, sensor in enumerate(sensors):
        unit = shown_unit(sensor)
        shown = 100 * residual[:, s] / predicted[:, s] if unit == "%" else residual[:, s]
        for regime, mask in masks:
            rows = mask & np.isfinite(shown)
            if rows.any():
                chi2 = float(np.mean((residual[rows, s] / sigma[s]) ** 2))
                rms = float(np.sqrt(np.mean(shown[rows] ** 2)))
                table.append(SensorQuality(sensor, regime, int(rows.sum()), rms, unit, chi2))
    return tuple(table)
