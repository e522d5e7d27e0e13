"""A nominal state that nobody had to identify."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.identification.nominal import Estimate, Nominal, SensorNoise, learn_envelope
from enginediag_cli.recordings.source import file_sha256

ESTIMATED = {"compressor.efficiency": 0.004, "turbine.efficiency": 0.004, "nozzle.area": 0.003}
"""Parameter of the turbojet → standard error of its nominal value."""


def estimates_of(errors: Mapping[str, float]) -> tuple[Estimate, ...]:
    """Parameters that were found at 1 with these standard errors, plausible to 2 %."""
    return tuple(
        Estimate(name, "health", "", 1.0, error, 1.0, 0.02, 1 - (error / 0.02) ** 2, "identified")
        for name, error in errors.items()
    )


def nominal_of(
    engine: Engine,
    path: str | Path,
    noise: Sequence[SensorNoise],
    inputs: Mapping[str, np.ndarray],
    errors: Mapping[str, float] | None = None,
    correlation: float = 0.0,
) -> Nominal:
    """Of an engine, beside whose file it will be, that was seen at `inputs` (N,) with this noise, one for each sensor;
    errors: standard errors of parameters, any two of which have this correlation."""
    estimates = estimates_of(errors or {})
    sigma = np.array([e.standard_error for e in estimates])
    covariance = np.outer(sigma, sigma) * ((1 - correlation) * np.eye(len(sigma)) + correlation)
    return Nominal(
        engine_path=Path(path).name,
        engine_sha256=file_sha256(path),
        inputs=engine.inputs,
        estimates=estimates,
        covariance=covariance,
        noise=tuple(noise),
        noise_correlation=np.eye(len(noise)),
        offsets=(),
        recording_offsets={},
        in_sample=(),
        cross_validated=(),
        held_out=(),
        unidentified=(),
        envelope=learn_envelope(inputs),
        records={"used": len(next(iter(inputs.values())))},
        provenance={"enginediag": "test"},
    )


def noise_of(sigma: Mapping[str, float]) -> list[SensorNoise]:
    """By sensor, a little correlated in time, as 400 records of a fit told it."""
    return [SensorNoise(c, s, 0.1, 400, 350.0, 1, "fit", 380.0, 0.05) for c, s in sigma.items()]
