"""Regime of each record: ground, climb, cruise or descent where the recordings tell, else a band of power."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.units import split_column

CLIMB_RATE_M_S = 2.5
"""About 500 ft/min: beyond it an aircraft is climbing or descending."""

GROUND_MACH = 0.1
"""Below it an aircraft stands, taxies or begins its run: no airliner flies as slowly."""
AMBIENT = (
    "altitude",
    "mach",
    "dT_isa",
    "humidity",
    "P0",
    "T0",
    "Pamb",
    "Tamb",
    "ambient_pressure",
    "ambient_temperature",
    "dP_inlet",
    "dP_exhaust",
)
"""Quantities that describe the surroundings, not the power setting."""

SMALLEST_BAND = 0.005
"""A power setting that varies by less than this share of itself is one regime."""


def assign_regimes(recordings: Sequence[Mapping[str, np.ndarray]], inputs: Sequence[str]) -> list[np.ndarray]:
    """Regime label of each record, one (N,) text array per recording.

    A `phase` column is used as it is; else altitude_m against time_s; where a recording has neither, all
    recordings are cut at the pooled terciles of the first input that is not ambient; `all` without one.
    """
    labels = [_by_flight(columns) for columns in recordings]
    flown = [label for label in labels if label is not None]
    if len(flown) == len(recordings):
        return flown
    for name in inputs:
        if all(name in columns for columns in recordings) and not _is_ambient(name):
            return _by_power([np.asarray(columns[name], float) for columns in recordings], name)
    return [np.full(len(next(iter(columns.values()))), "all") for columns in recordings]


def _is_ambient(name: str) -> bool:
    return split_column(name)[0] in AMBIENT


def _by_flight(columns: Mapping[str, np.ndarray]) -> np.ndarray | None:
    if "phase" in columns:
        return np.asarray(columns["phase"]).astype(str)
    if "altitude_m" not in columns or "time_s" not in columns:
        return None
    altitude, time = (np.asarray(columns[c], float) for c in ("altitude_m", "time_s"))
    if len(time) < 3 or not np.all(np.diff(time) > 0) or not np.ptp(altitude) > 100.0:
        return None
    rate = np.gradient(altitude, time)
    label = np.where(rate > CLIMB_RATE_M_S, "climb", np.where(rate < -CLIMB_RATE_M_S, "descent", "cruise"))
    if "mach" in columns:
        slow = np.asarray(columns["mach"], float) < GROUND_MACH
        label = np.where(slow & (label == "cruise"), "ground", label)
    return label


def _by_power(values: Sequence[np.ndarray], name: str) -> list[np.ndarray]:
    pooled = np.concatenate(values)
    pooled = pooled[np.isfinite(pooled)]
    if not len(pooled) or np.ptp(pooled) <= SMALLEST_BAND * abs(np.median(pooled)):
        return [np.full(len(v), "all") for v in values]
    low, high = np.quantile(pooled, [1 / 3, 2 / 3])
    words = (f"low {name}", f"middle {name}", f"high {name}")
    return [np.where(v <= low, words[0], np.where(v <= high, words[1], words[2])) for v in values]
