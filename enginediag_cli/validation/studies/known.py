"""The monitor of an engine whose nominal state and noise are known: what the paper's experiment assumes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from enginediag_cli.errors import DataError
from enginediag_cli.residuals.monitor import Monitor, watched_parameters
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.simulation.noise import ColumnNoise


def known_nominal(engine: Any, patterns: Sequence[str], noise: Mapping[str, ColumnNoise]) -> Monitor:
    """Monitor of the parameters that `patterns` name, nothing about nominal being uncertain."""
    sensors = tuple(engine.sensors)
    names = watched_parameters(engine, patterns)
    parameters = [engine.parameters[name] for name in names]
    silent = [column for column in sensors if standard_deviation(noise[column]) == 0]
    if silent:
        raise DataError(f"{', '.join(silent)}: sensors without noise cannot be weighed against each other")
    return Monitor(
        engine=engine,
        sensors=sensors,
        base={},
        names=names,
        monitored=names,
        meaning={p.name: p for p in parameters},
        offsets=(),
        theta0=np.array([p.nominal for p in parameters], float),
        prior_sigma=np.array([p.prior_sigma for p in parameters], float),
        lower=np.array([p.lower for p in parameters], float),
        upper=np.array([p.upper for p in parameters], float),
        uncertainty=np.zeros((len(names), len(names))),
        noise=NoiseModel(
            np.array([standard_deviation(noise[column]) for column in sensors]),
            np.array([noise[column].correlation for column in sensors]),
        ),
    )


def standard_deviation(noise: ColumnNoise) -> float:
    """Of the noise of one column, gross errors left out; uniform noise of range w, and rounding, have w/√12."""
    size = {"gaussian": noise.sigma, "uniform": noise.width / 12**0.5, "none": 0.0}[noise.distribution]
    return float(np.hypot(size, noise.quantum / 12**0.5))
