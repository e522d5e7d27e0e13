"""How well the model reproduces readings: RMS per sensor and regime, χ² per reading.

Flows, pressures, forces and powers are judged in per cent of the prediction, temperatures, speeds and all
else in the column's own unit, as the field does.

Regime of each record: ground, climb, cruise or descent where the recordings tell, else a band of power.

What a fit says of recordings that it has not seen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.identification.normal_equations import predict
from enginediag_cli.identification.problem import (
    IdentificationSettings,
    Model,
    Problem,
    TrainingRecording,
    build_problem,
)
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


def on_unseen(
    problem: Problem, fit: Fit, held_out: Sequence[TrainingRecording], settings: IdentificationSettings
) -> tuple[Problem, np.ndarray]:
    """The problem of the held-out recordings, and its readings as predicted (N, m) at the fit of another one. Offsets
    of a recording are those of the fitted one of its label, else zero."""
    other = build_problem(problem.model, with_regimes(problem.model, held_out), settings)
    other = replace(
        other,
        parameters=problem.parameters,
        prior_mean=problem.prior_mean,
        prior_sigma=problem.prior_sigma,
        lower=problem.lower,
        upper=problem.upper,
    )
    z = np.zeros((len(other.labels), len(other.offsets)))
    known = {(o.sensor, o.kind): j for j, o in enumerate(problem.offsets)}
    for r, label in enumerate(other.labels):
        if label in problem.labels:
            for j, o in enumerate(other.offsets):
                z[r, j] = fit.z[problem.labels.index(label), known[o.sensor, o.kind]]
    predicted, _ = predict(other, fit.x, z)
    return other, predicted


def with_regimes(engine: Model, recordings: Sequence[TrainingRecording]) -> list[TrainingRecording]:
    """The recordings with a regime for each record; regimes that are given stay."""
    recordings = [TrainingRecording(*r) for r in recordings]
    found = assign_regimes([r.columns for r in recordings], engine.inputs) if recordings else []
    return [
        r if r.regimes is not None else r._replace(regimes=label) for r, label in zip(recordings, found, strict=True)
    ]
