"""Four turbojets of which one wears, a CSV file each, a nominal file, and the fleet file of all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from made_nominal import ESTIMATED, noise_of, nominal_of

from enginediag_cli.fleets.fleet_file import Fleet, FleetRecording, find_recordings, load_fleet
from enginediag_cli.fleets.models import BuildModel, build_model
from enginediag_cli.fleets.store import FleetStore
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv

SHIPPED = Path(__file__).parents[2] / "configs"
ENGINES, FLIGHTS, RECORDS = 4, 8, 20
WEAR = 0.02
"""Of the compressor's efficiency of engine 2, at its last flight."""

FLEET = """\
kind: fleet
description: four turbojets
nominal: nominal.yaml
recordings: ['engine_*.csv']
engines: {serial_from: file, pattern: 'engine_(\\d+)'}
baseline: {flights: 3}
"""


def make(folder: Path) -> Path:
    """Write everything; returns the fleet file."""
    engine_path = folder / "engine.yaml"
    engine_path.write_text((SHIPPED / "turbojet.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    engine = load_engine(engine_path)
    sigma = {c: s.noise_sigma for c, s in engine.sensors.items()}
    for number in range(1, ENGINES + 1):
        columns, flight = conditions(engine, number)
        worn = (flight - 1) / (FLIGHTS - 1) * (number == 2)
        y = engine.predict(columns, {"compressor.efficiency": 1 - WEAR * worn}).y
        rng = np.random.default_rng([1, number])
        readings = {c: y[:, j] + sigma[c] * rng.standard_normal(len(y)) for j, c in enumerate(sigma)}
        write_csv(folder / f"engine_{number}.csv", [Recording({**columns, **readings}, {"flight": texts(flight)})])
    columns, _ = conditions(engine, 0)
    inputs = {c: columns[c] for c in engine.inputs}
    nominal = nominal_of(engine, engine_path, noise_of(sigma), inputs, ESTIMATED)
    write_nominal(nominal, folder / "nominal.yaml")
    fleet = folder / "fleet.yaml"
    fleet.write_text(FLEET, encoding="utf-8")
    return fleet


def texts(flight: np.ndarray) -> list[str]:
    return [str(int(f)) for f in flight]


def conditions(engine, number: int, flights: int = FLIGHTS) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Columns of the flights of an engine, and the number of each record's flight."""
    rng = np.random.default_rng([2, number])
    phase = np.tile(np.linspace(0, 1, RECORDS), flights)
    flight = np.repeat(np.arange(1, flights + 1), RECORDS)
    n = len(phase)
    columns = {
        "time_s": 10.0 * np.arange(n),
        "altitude_m": 6e3 * phase,
        "mach": 0.2 + 0.4 * phase,
        "dT_isa_K": np.repeat(rng.uniform(0, 10, flights), RECORDS),
    }
    columns["Wf_kg_s"] = engine.power_from_fraction(0.9 - 0.2 * phase, columns)
    return columns, flight


def opened(
    fleet_file: Path, folder: Path
) -> tuple[Fleet, tuple[FleetRecording, ...], dict[str, BuildModel], FleetStore]:
    """The fleet, its recordings, models, and a store in `folder`."""
    fleet, store = load_fleet(fleet_file), FleetStore(folder)
    recordings = find_recordings(fleet)
    return fleet, recordings, {b.name: build_model(fleet, b, recordings, store) for b in fleet.builds}, store
