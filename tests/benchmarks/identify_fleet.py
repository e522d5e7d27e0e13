"""Identification of many engines at once: python tests/benchmarks/identify_fleet.py [ENGINES]

Engines of the C-MAPSS class, simulated at one condition, twenty records each; every engine reads each sensor 0.3 % (one
standard deviation) off, which identification carries as offsets of its own. Prints CPU seconds and peak memory, without
cross-validation, for a tenth of the engines and for all of them (default 1000): both should grow in proportion.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "cmapss_turbofan.yaml"
RECORDS, SPREAD = 20, 0.003
CONDITION = {"altitude_m": (0.0, 3.0), "mach": (0.001, 2e-4), "dT_isa_K": (0.0, 0.01), "N1_rpm": (2388.06, 0.07)}
"""Mean and scatter of the inputs, as in the recordings of one condition."""


def fleet(engines: int, seed: int = 0) -> list[TrainingRecording]:
    """One healthy recording for each engine."""
    engine, rng = load_engine(ENGINE), np.random.default_rng(seed)
    recordings = []
    for number in range(engines):
        columns = {c: rng.normal(mean, scatter, RECORDS) for c, (mean, scatter) in CONDITION.items()}
        readings = engine.predict(columns, {}, sensors=list(engine.sensors)).y
        for s, (column, sensor) in enumerate(engine.sensors.items()):
            off = 1 + SPREAD * rng.standard_normal()
            columns[column] = readings[:, s] * off + sensor.noise_sigma * rng.standard_normal(RECORDS)
        recordings.append(TrainingRecording(f"engine {number + 1}", columns))
    return recordings


def row(engines: int) -> str:
    recordings, engine = fleet(engines), load_engine(ENGINE)
    before = time.process_time()
    result = identify(engine, recordings, cross_validation=False)
    seconds = time.process_time() - before
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return f"{engines:6,} engines: {seconds:5.1f} s CPU, {memory:4.0f} MB, {result.reason}"


if __name__ == "__main__":
    if "--row" in sys.argv:
        print(row(int(sys.argv[-1])))
    else:
        engines = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
        for n in (engines // 10, engines):  # each in a process of its own: memory is the highest that a process had
            subprocess.run([sys.executable, __file__, "--row", str(n)], check=True)
