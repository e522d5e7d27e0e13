"""Readings that stand still where the model says that they should move: the mark of a control in a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

WIDTH = 2.5
"""Half of the window in which a reading stands still, in standard deviations of its noise as stated."""
FLANKS = 4.0
"""Half of the window with which that is compared, in such windows."""
PEAK = 4.0
"""Records per unit in the window against those beside it from which a value is held: a spread that is smooth over a few
standard deviations of noise has 1. Judgement."""
SHARE, LEAST = 0.08, 40
"""Share of the records, and number, that must stand still."""
MOVES = 4.0
"""What the model says that the reading does over these records, in what it does."""
RUNS = 16
"""Of the records that stand still: hours that follow each other say the same."""
ROBUST = 1.4826
"""Standard deviation of a normal spread over the median of its absolute deviations."""


@dataclass(frozen=True)
class Still:
    """`sensor` stands at `value` in the records `at` (N,), where it scatters by `scatter` and the model as it is says
    `predicted`; in its unit. `standard_error` of the value, by what runs of records say of it."""

    sensor: str
    value: float
    at: np.ndarray
    scatter: float
    predicted: float
    standard_error: float


def still_readings(
    sensors: Sequence[str], noise: Mapping[str, float], measured: np.ndarray, predicted: np.ndarray
) -> list[Still]:
    """Of each sensor the value at which it stands still most often, where it does so for no reason that the model
    knows, the most records first. `noise`: standard deviations as stated; `measured`, `predicted`: (N, m)."""
    found = []
    for j, sensor in enumerate(sensors):
        y, model = measured[:, j], predicted[:, j]
        known = np.isfinite(y) & np.isfinite(model)
        width = WIDTH * noise[sensor]
        if int(known.sum()) < LEAST or not width > 0.0:
            continue
        s = np.sort(y[known])
        count = np.searchsorted(s, s + 2.0 * width, side="right") - np.arange(len(s))
        middle = float(s[int(np.argmax(count))]) + width
        middle = float(np.median(s[np.abs(s - middle) <= width]))
        at = known & (np.abs(y - middle) <= width)
        beside = int((known & (np.abs(y - middle) <= FLANKS * width)).sum()) - int(at.sum())
        peak = at.sum() / max(beside / (FLANKS - 1.0), 1.0)
        if at.sum() < max(LEAST, SHARE * known.sum()) or peak < PEAK:
            continue
        own, expected = robust_scatter(y[at]), robust_scatter(model[at])
        if expected > MOVES * max(own, noise[sensor]):
            means = [float(np.mean(part)) for part in np.array_split(y[at], RUNS)]
            error = float(np.std(means, ddof=1) / np.sqrt(RUNS))
            found.append(Still(sensor, middle, at, own, expected, error))
    return sorted(found, key=lambda f: -int(f.at.sum()))


def robust_scatter(values: np.ndarray) -> float:
    """Standard deviation of most of the values (N,), NaN aside: from the median of absolute deviations."""
    return float(ROBUST * np.nanmedian(np.abs(values - np.nanmedian(values))))
