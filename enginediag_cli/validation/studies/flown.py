"""A batch of trials: engines with known faults, flown by the full nonlinear model, recorded with noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.methods.base import Windows
from enginediag_cli.simulation.flights import engine_inputs, generate_flights
from enginediag_cli.simulation.noise import ColumnNoise, noise_sources

if TYPE_CHECKING:
    from enginediag_cli.residuals.monitor import Monitor
    from enginediag_cli.validation.studies.cases import FaultCase


@dataclass(frozen=True)
class Trials:
    """W windows of n records with the changes (W, p) that made them; failed: records that the engine could not
    compute, which have no reading."""

    windows: Windows
    changes: np.ndarray
    failed: int


def make_trials(
    monitor: Monitor,
    case: FaultCase,
    count: int,
    records: int,
    plan: Mapping[str, Any],
    noise: Mapping[str, ColumnNoise],
    rng: np.random.Generator,
) -> Trials:
    """`count` trials of one case, all in one call of the engine."""
    engine = monitor.engine
    changes = case.changes_of(monitor, count, rng)
    changes = np.clip(monitor.theta0 + changes, monitor.lower, monitor.upper) - monitor.theta0
    inputs = _conditions(engine, count, records, plan, rng)
    values = {
        name: np.repeat(monitor.theta0[i] + changes[:, i], records)
        for i, name in enumerate(monitor.names)
        if np.any(changes[:, i])
    }
    prediction = engine.predict(inputs, values, sensors=monitor.sensors)
    true = np.asarray(prediction.y).reshape(count, records, -1)
    readings = {column: true[:, :, j] for j, column in enumerate(monitor.sensors)}
    readings.update({c: v.reshape(count, records) for c, v in inputs.items()})
    read = _with_noise(readings, noise, count, rng)
    y = np.stack([read[column] for column in monitor.sensors], axis=2)
    return Trials(Windows({c: read[c] for c in inputs}, y), changes, int(np.sum(~np.asarray(prediction.ok))))


def _conditions(
    engine: Any, count: int, records: int, plan: Mapping[str, Any], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Engine inputs (count · records,). Missions whose points are independent are drawn at once."""
    if plan["mission"]["type"] in ("sweep", "snapshots"):
        return engine_inputs(engine, generate_flights(plan, engine, rng, records=count * records))
    parts = [engine_inputs(engine, generate_flights(plan, engine, rng, records=records)) for _ in range(count)]
    return {column: np.concatenate([part[column] for part in parts]) for column in parts[0]}


def _with_noise(
    true: Mapping[str, np.ndarray], noise: Mapping[str, ColumnNoise], count: int, rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Readings (count, n) by column; every window has noise of its own, also where noise remembers its past."""
    read = {column: np.array(values) for column, values in true.items()}
    for k in range(count):
        for column, source in noise_sources(noise, rng).items():
            read[column][k] = source.apply(true[column][k])
    return read
