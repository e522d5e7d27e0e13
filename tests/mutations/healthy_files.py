"""The sound files that are damaged: a turbojet, its nominal, two flights, a foreign recording, statistics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from made_nominal import ESTIMATED, noise_of, nominal_of

from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

SHIPPED = Path(__file__).parents[2] / "configs"
RECORDS = 24

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
    nominal = nominal_of(engine, engine_path, noise_of(sigma), columns, ESTIMATED, correlation=0.5)
    write_nominal(nominal, folder / "nominal.yaml")
    texts = {p.name: p.read_text(encoding="utf-8") for p in sorted(folder.iterdir())}
    return Files(folder, texts)
