"""Another simulator's engine for the commands: python tests/real_runs/pycycle_runs.py FOLDER [--seeds N] [NAME ...]

Writes FOLDER/hbtf.yaml, the CFM56-class turbofan of the public cases with its component maps beside it, and per
recording NAME (default: all but the one of all stations) and noise seed k the file FOLDER/NAME_k.csv: the simulator's
readings with the noise that the engine file states added (0.05 to 0.3 %). `enginediag identify FOLDER/hbtf.yaml
FOLDER/nominal_0.csv` then runs like any other engine. What is concealed or faulty in a recording is not written.
"""

from __future__ import annotations

import csv
import sys
import zlib
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "verification"))

import pycycle_concealed
import shared_data

ALL_STATIONS = "nominal_all_stations"
"""A file for checking a solver, not a recording."""


def recordings() -> list[str]:
    """Names of the public recordings."""
    return sorted(p.stem for p in pycycle_concealed.FOLDER.glob("*.csv") if p.stem != ALL_STATIONS)


def write(folder: Path, names: list[str], seeds: int) -> list[Path]:
    """Engine file and noisy recordings; the paths of the recordings. Another recording never shares its noise."""
    folder.mkdir(parents=True, exist_ok=True)
    engine = pycycle_concealed.engine(folder)
    written = []
    for name in names:
        columns = pycycle_concealed.columns(name)
        told = [c for c in columns if c in engine.inputs or c in engine.sensors]
        for seed in range(seeds):
            rng = np.random.default_rng([seed, zlib.crc32(name.encode())])
            noise = {c: engine.sensors[c].noise_sigma * rng.standard_normal(len(columns[c])) for c in engine.sensors}
            table = np.column_stack([columns[c] + noise.get(c, 0.0) for c in told])
            written.append(folder / f"{name}_{seed}.csv")
            with written[-1].open("w", newline="", encoding="utf-8") as file:
                rows = csv.writer(file, lineterminator="\n")
                rows.writerow(told)
                rows.writerows([[f"{v:.9g}" for v in row] for row in table])
    return written


def main(arguments: list[str]) -> None:
    if not shared_data.available("pycycle_hbtf"):
        sys.exit(shared_data.reason("pycycle_hbtf"))
    seeds = 1
    if "--seeds" in arguments:
        at = arguments.index("--seeds")
        seeds = int(arguments[at + 1])
        arguments = arguments[:at] + arguments[at + 2 :]
    if not arguments:
        sys.exit(__doc__)
    written = write(Path(arguments[0]), arguments[1:] or recordings(), seeds)
    print(f"{len(written)} recordings and hbtf.yaml in {arguments[0]}")


if __name__ == "__main__":
    main(sys.argv[1:])
