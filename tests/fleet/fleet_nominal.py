"""A nominal state that nobody had to identify."""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.envelope import learn_envelope
from enginediag_cli.identification.nominal import Estimate, Nominal, SensorNoise
from enginediag_cli.recordings.provenance import sha256_of

ESTIMATED = {"compressor.efficiency": 0.004, "turbine.efficiency": 0.004, "nozzle.area": 0.003}
"""Parameter → standard error of its nominal value."""


def nominal_of(engine, engine_path, sigma, inputs) -> Nominal:
    """Of an engine file, with noise sigma by sensor, seen at `inputs`."""
    estimates = tuple(
        Estimate(name, "health", "", 1.0, error, 1.0, 0.02, 1 - (error / 0.02) ** 2, "identified")
        for name, error in ESTIMATED.items()
    )
    covariance = np.diag(np.square([*ESTIMATED.values()]))
    noise = tuple(SensorNoise(c, s, 0.1, 400, 350.0, 1, "fit", 380.0, 0.05) for c, s in sigma.items())
    return Nominal(
        engine_path=engine_path.name,
        engine_sha256=sha256_of(engine_path),
        inputs=engine.inputs,
        estimates=estimates,
        covariance=covariance,
        noise=noise,
        noise_correlation=np.eye(len(sigma)),
        offsets=(),
        recording_offsets={},
        in_sample=(),
        cross_validated=(),
        held_out=(),
        unidentified=(),
        envelope=learn_envelope(inputs),
        records={"used": 400},
        provenance={"enginediag": "test"},
    )
