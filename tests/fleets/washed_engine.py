"""A turbojet whose compressor wears by 1.4 % of efficiency in 14 flights and is washed, by which one per cent comes
back: its recording, nominal file, maintenance, and the fleet of it alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from made_nominal import ESTIMATED, noise_of, nominal_of
from small_fleet import SHIPPED, conditions, texts

from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

FLIGHTS, BASELINE, WASHED = 24, 3, 15
WEAR, BACK = 0.001, 0.01
"""Of the compressor's efficiency: lost in every flight, and given back by the wash before flight WASHED."""
LIMIT_K = 1050.0

FLEET = """\
kind: fleet
nominal: nominal.yaml
recordings: ['engine_*.csv']
engines: {serial_from: file, pattern: 'engine_(\\d+)'}
baseline: {flights: 3}
events: washes.csv
judge: {limits_K: {T5_K: 1050}}
"""


def make(folder: Path) -> Path:
    """Write everything; returns the recording."""
    engine_path = folder / "engine.yaml"
    engine_path.write_text((SHIPPED / "turbojet.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    engine = load_engine(engine_path)
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    columns, flight = conditions(engine, 7, FLIGHTS)
    lost = WEAR * flight - BACK * (flight >= WASHED)
    y = engine.predict(columns, {"compressor.efficiency": 1 - lost}).y
    rng = np.random.default_rng(5)
    readings = {c: y[:, j] + sigma[c] * rng.standard_normal(len(y)) for j, c in enumerate(sigma)}
    recording = folder / "engine_7.csv"
    write_csv(recording, [Recording({**columns, **readings}, {"flight": texts(flight)})])
    trained, _ = conditions(engine, 0)
    inputs = {c: trained[c] for c in engine.inputs}
    write_nominal(nominal_of(engine, engine_path, noise_of(sigma), inputs, ESTIMATED), folder / "nominal.yaml")
    (folder / "washes.csv").write_text(f"engine,kind,flight\n7,wash,{WASHED}\n", encoding="utf-8")
    (folder / "fleet.yaml").write_text(FLEET, encoding="utf-8")
    return recording
