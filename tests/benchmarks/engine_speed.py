"""Speed of the engine model as JSON on stdout: python tests/benchmarks/engine_speed.py [--table]

CPU time of one process on one core (set OPENBLAS_NUM_THREADS=1), best of five, start-up fit included;
10,000 random operating points over the envelope at 30–100 % of the corrected power range, every balance
to 1e-10. Times of other programs on another machine are quoted as ratios only for one cold point, the one
case that is alike: pyCycle 4.4 takes 1.1–3.6 s CPU per off-design point with tabular gas, GSPy 0.45 s.
"""

from __future__ import annotations

import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "verification"))

import jt9d_npss
import numpy as np
import shared_data

from enginediag_cli.config.reading import outside_allowed
from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine

ROOT = Path(__file__).resolve().parents[2]
OUTPUTS = (
    "N1_rpm",
    "N2_rpm",
    "T25_K",
    "P25_Pa",
    "T3_K",
    "P3_Pa",
    "T45_K",
    "T5_K",
    "P5_Pa",
    "Fn_N",
    "W2_kg_s",
    "P13_Pa",
)
PYCYCLE_S, GSPY_S = 1.1, 0.45


def operating_points(engine: Engine, count: int, seed: int = 3) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    points = {
        "altitude_m": rng.uniform(0, 12000, count),
        "mach": rng.uniform(0, 0.85, count),
        "dT_isa_K": rng.uniform(-15, 20, count),
    }
    points[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.3, 1.0, count), points)
    return points


def best(action, repetitions: int = 5) -> float:
    """Least CPU time of an action [s]."""
    times = []
    for _ in range(repetitions):
        start = time.process_time()
        action()
        times.append(time.process_time() - start)
    return min(times)


def measure(engine: Engine, file: str | Path) -> dict[str, float]:
    points = operating_points(engine, 10_000)

    def cold(wrt: tuple[str, ...] = ()) -> None:
        engine.forget_start()
        assert (engine.predict(points, sensors=OUTPUTS, wrt=wrt).status < 2).all()

    one = {c: v[:1] for c, v in operating_points(engine, 1).items()}

    found = engine.predict(one)
    assert found.ok.all()

    def one_warm() -> None:
        assert engine.predict(one, start=found.x).ok.all()

    def loaded() -> None:
        with outside_allowed():  # the maps of tables lie beside the public cases
            load_engine(file)

    def one_cold() -> None:
        engine.forget_start()
        assert engine.predict(one).ok.all()

    return {
        "solve_us_per_point": 1e2 * best(cold),
        "solve_and_sensitivities_us_per_point": 1e2 * best(lambda: cold(engine.monitored)),
        "one_cold_point_ms": 1e3 * best(one_cold, 20),
        "one_warm_point_ms": 1e3 * best(one_warm, 20),
        "load_engine_ms": 1e3 * best(loaded),
    }


ROWS = (
    ("solve, per point", "solve_us_per_point", "µs"),
    ("solve and ∂Φ/∂θ (12 outputs × 11 parameters), per point", "solve_and_sensitivities_us_per_point", "µs"),
    ("one cold point, no fitted start", "one_cold_point_ms", "ms"),
    ("one point from its solution", "one_warm_point_ms", "ms"),
)


def table(report: Mapping[str, Any]) -> None:
    """Markdown table of the speeds."""
    maps = [m for m in ("parametric_maps", "table_maps") if m in report]
    print("| CPU time | " + " | ".join(m.replace("_", " ") for m in maps) + " |\n" + "|---" * (1 + len(maps)) + "|")
    for title, key, unit in ROWS:
        print(f"| {title} | " + " | ".join(f"{report[m][key]:.3g} {unit}" for m in maps) + " |")
    memory = report["peak_memory_MB_100000_points_with_sensitivities"]
    print(f"| peak memory, 100,000 points with sensitivities | {memory:.0f} MB |" + " |" * (len(maps) - 1))


def main() -> None:
    engine = load_engine(ROOT / "configs" / "turbofan.yaml")
    report: dict[str, object] = {"parametric_maps": measure(engine, ROOT / "configs" / "turbofan.yaml")}
    if shared_data.available("jt9d"):
        with tempfile.TemporaryDirectory() as scratch:
            tabled = jt9d_npss.load(shared_data.DATA / "jt9d", Path(scratch))
            report["table_maps"] = measure(tabled, Path(scratch) / "jt9d_Wf_kg_s.yaml")
    engine.predict(operating_points(engine, 100_000), sensors=OUTPUTS, wrt=engine.monitored)
    report["peak_memory_MB_100000_points_with_sensitivities"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    cold_s = report["parametric_maps"]["one_cold_point_ms"] / 1e3  # type: ignore[index]
    report["one_cold_point_ratio"] = {
        "pyCycle_4.4_tabular_over_ours": PYCYCLE_S / cold_s,
        "GSPy_over_ours": GSPY_S / cold_s,
    }
    if "--table" in sys.argv:
        return table(report)
    print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
