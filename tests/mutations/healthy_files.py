"""The sound files that are damaged: a turbojet, its nominal, two flights, a foreign recording, statistics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from enginediag_cli.identification.envelope import learn_envelope
from enginediag_cli.identification.nominal import Estimate, Nominal, SensorNoise
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.provenance import sha256_of
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

SHIPPED = Path(__file__).parents[2] / "configs"
RECORDS = 24
ESTIMATED = {"compressor.efficiency": 0.004, "turbine.efficiency": 0.004, "nozzle.area": 0.003}
"""Parameter → standard error of its nominal value."""

RECORDER = """\
kind: recorder
description: A made-up recorder of a test bench
columns:
  altitude_m: {from: ALT, unit: ft, limits: [-1000, 60000]}
  mach: {from: MN}
  Wf_kg_s: {from: FF, unit: kg_s}
  N1_rpm: {from: N1, unit: rpm, limits: [0, 20000]}
  T3_K: {from: CDT, unit: degC}
  P3_Pa: {from: CDP, unit: kPa}
  T5_K: {from: EGT, unit: K}
constants: {dT_isa_K: 5}
masks:
  stuck_records: 10
  outlier_sigma: 8
"""


@dataclass(frozen=True)
class Files:
    """Texts by name, as they lie in `folder`."""

    folder: Path
    texts: dict[str, str]


def make(folder: Path, records: int = RECORDS) -> Files:
    """Write the sound files, of so many records each; nothing in them depends on the day."""
    engine_path = folder / "engine.yaml"
    engine_path.write_text((SHIPPED / "turbojet.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "recorder.yaml").write_text(RECORDER, encoding="utf-8")
    engine, rng = load_engine(engine_path), np.random.default_rng(7)
    phase = np.linspace(0, 1, records)
    columns = {"altitude_m": 6e3 * phase, "mach": 0.2 + 0.4 * phase, "dT_isa_K": np.full(records, 5.0)}
    columns["Wf_kg_s"] = engine.power_from_fraction(0.9 - 0.2 * phase, columns)
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    read = {}
    for name, health in (("flight", {}), ("faulty", {"compressor.efficiency": 0.97})):
        y = engine.predict(columns, health).y
        readings = {c: y[:, j] + sigma[c] * rng.standard_normal(records) for j, c in enumerate(sigma)}
        read[name] = Recording({**columns, "time_s": 10.0 * np.arange(records), **readings})
        write_csv(folder / f"{name}.csv", [read[name]])
    flights = np.repeat(["1", "2", "3"], records // 3).tolist()
    write_csv(folder / "flights.csv", [Recording(read["flight"].columns, {"flight": flights})])
    foreign = {
        "ALT": columns["altitude_m"] / 0.3048,
        "MN": columns["mach"],
        "FF": columns["Wf_kg_s"],
        "N1": read["flight"]["N1_rpm"],
        "CDT": read["flight"]["T3_K"] - 273.15,
        "CDP": read["flight"]["P3_Pa"] / 1e3,
        "EGT": read["flight"]["T5_K"],
    }
    write_csv(folder / "foreign.csv", [Recording(foreign)])
    write_nominal(_nominal(engine, engine_path, sigma, columns), folder / "nominal.yaml")
    texts = {p.name: p.read_text(encoding="utf-8") for p in sorted(folder.iterdir())}
    return Files(folder, texts)


def _nominal(engine, engine_path, sigma, columns) -> Nominal:
    estimates = tuple(
        Estimate(name, "health", "", 1.0, error, 1.0, 0.02, 1 - (error / 0.02) ** 2, "identified")
        for name, error in ESTIMATED.items()
    )
    errors = np.array([*ESTIMATED.values()])
    covariance = np.outer(errors, errors) * (0.5 * np.eye(len(errors)) + 0.5)
    covariance[np.diag_indices(len(errors))] = errors**2
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
        envelope=learn_envelope(columns),
        records={"used": 400},
        provenance={"enginediag": "test"},
    )
