"""A turbofan that is known exactly: its nominal file, and readings of a descent in power while it climbs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from made_nominal import nominal_of

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.nominal import SensorNoise
from enginediag_cli.identification.nominal_file import write_nominal


def climb(engine: Engine, records: int) -> dict[str, np.ndarray]:
    """The engine's inputs (N,)."""
    phase = np.linspace(0, 1, records)
    columns = {"altitude_m": 9e3 * phase, "mach": 0.3 + 0.5 * phase, "dT_isa_K": np.full(records, 5.0)}
    columns[engine.power_setting] = engine.power_from_fraction(0.95 - 0.3 * phase, columns)
    return {c: columns[c] for c in engine.inputs}


def recorded(
    engine: Engine, inputs: Mapping[str, np.ndarray], health: Mapping[str, float], rng: np.random.Generator
) -> dict[str, np.ndarray]:
    """Inputs, times and noisy readings (N,), a record every 10 s."""
    records = len(next(iter(inputs.values())))
    y = engine.predict(inputs, health).y
    readings = {
        c: y[:, j] + s.noise_sigma * rng.standard_normal(records) for j, (c, s) in enumerate(engine.sensors.items())
    }
    return {**inputs, "time_s": 10.0 * np.arange(records), **readings}


def write_known(engine: Engine, path: str | Path, inputs: Mapping[str, np.ndarray], to: Path) -> None:
    """A nominal file of an engine of which nothing had to be identified."""
    records = len(next(iter(inputs.values())))
    noise = [SensorNoise(c, s.noise_sigma, 0.0, records, float(records), 0) for c, s in engine.sensors.items()]
    write_nominal(replace(nominal_of(engine, path, noise, inputs), engine_path=str(path)), to)
