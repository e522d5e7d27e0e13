"""The shipped fleet of six turbofans, made as the head of configs/fleets/turbofans.yaml says, with other seeds:
python tests/benchmarks/fleet_example.py [--seeds N] [--first S] [--fillers SHARE]

Fleet k has its engines simulated with the seeds S + 6 k to S + 6 k + 5. Engine 5 fouls and the T3 thermocouple of
engine 6 reads wrong, both from flight 21 on. fillers: this share of the cells, of inputs as well as of sensors, is
replaced by what recorders write where there is nothing: 999, 0 or -9999.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import numpy as np

from enginediag_cli import fleet, simulate
from enginediag_cli.recordings.read import read_all
from enginediag_cli.recordings.write import write_csv

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
FLIGHTS, ENGINES = 40, 6
FILLERS = (999.0, 0.0, -9999.0)
EXPECTED = {"5": "hpc", "6": "sensor.T3"}
"""Engines that have changed, and in what."""


def make(folder: Path, first: int, fillers: float = 0.0) -> list[Path]:
    """The recordings of one fleet."""
    flown = (CONFIGS / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    (folder / "flights.yaml").write_text(flown.replace("interval_s: 10", "interval_s: 120"), encoding="utf-8")
    faults = {5: "hpc_fouling", 6: "sensor_T3_bias"}
    for name in faults.values():
        text = (CONFIGS / "faults" / f"{name}.yaml").read_text(encoding="utf-8")
        (folder / f"{name}.yaml").write_text(text.replace("onset: 3", "onset: 21"), encoding="utf-8")
    files = []
    for e in range(1, ENGINES + 1):
        told = {"faults": str(folder / f"{faults[e]}.yaml")} if e in faults else {}
        seed = first + e - 1
        recording = simulate(
            str(CONFIGS / "turbofan.yaml"), flight=str(folder / "flights.yaml"), flights=FLIGHTS, seed=seed, **told
        )
        files.append(folder / f"engine_{e}.csv")
        recording.save(files[-1])
        if fillers:
            spoil(files[-1], fillers, seed)
    return files


def spoil(path: Path, share: float, seed: int) -> None:
    """Replace so many of the cells by a filler."""
    table, rng = read_all(str(path)), np.random.default_rng(seed)
    columns = {c: v.copy() for c, v in table.columns.items() if c != "time_s"}
    for cells in columns.values():
        struck = rng.random(len(table)) < share
        cells[struck] = rng.choice(FILLERS, int(struck.sum()))
    write_csv(path, [table.with_columns(columns)])


def judge(files: list[Path]) -> tuple[list[str], dict[str, set[str]], list[str]]:
    """Serial numbers flagged, what of each changed, and those called healthy."""
    found = fleet(CONFIGS / "fleets" / "turbofans.yaml", [str(f) for f in files], jobs=1).run.finding
    named = {f.serial: {r.component for r in f.health if r.onset and r.probability >= 0.5} for f in found.engines}
    healthy = [f.serial for f in found.engines if f.verdict == "healthy"]
    return sorted(found.flagged.engines), {s: named[s] for s in found.flagged.engines}, sorted(healthy)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seeds", type=int, default=20)
    options.add_argument("--first", type=int, default=7001)
    options.add_argument("--fillers", type=float, default=0.0)
    asked = options.parse_args()
    right = 0
    for k in range(asked.seeds):
        with tempfile.TemporaryDirectory() as folder:
            first = asked.first + ENGINES * k
            flagged, named, healthy = judge(make(Path(folder), first, asked.fillers))
        good = flagged == sorted(EXPECTED) and all(named[s] == {c} for s, c in EXPECTED.items()) and len(healthy) == 4
        right += good
        if not good:
            told = {s: sorted(named[s]) for s in flagged}
            print(f"seeds {first} to {first + ENGINES - 1}: flagged {told}, healthy {healthy}", flush=True)
    print(f"{right} of {asked.seeds} fleets: engines 5 and 6 flagged for HPC and T3 sensor, the other four healthy")


if __name__ == "__main__":
    main()
