"""Speed of the engine model as JSON on stdout: python tests/benchmarks/engine_speed.py [--table]

CPU time of one process on one core (set OPENBLAS_NUM_THREADS=1), best of five, start-up fit included;
10,000 random operating points over the envelope at 30–100 % of the corrected power range, every balance
to 1e-10. Ratios are to bare evaluations of the same model at the solution, without derivatives, of 10,000 points
at once and of one. Times of other programs on another machine are quoted as ratios only for one cold point, the one
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

from enginediag_cli.config.files import outside_allowed
from enginediag_cli.engine import solver
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
NO_SOLUTION = 60.0
"""Times the power setting of a row that has no solution."""
STEP = 1.005
"""Power setting of the next step, over that of the last: of an engine that accelerates."""


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

    found = engine.predict(points)
    one = {c: v[:1] for c, v in operating_points(engine, 1).items()}
    forty = {c: v[:40] for c, v in points.items()}
    thousand = {c: v[:1000] for c, v in points.items()}
    failing = {**thousand, engine.power_setting: thousand[engine.power_setting].copy()}
    failing[engine.power_setting][500] *= NO_SOLUTION
    solved, solved_forty = engine.predict(one), engine.predict(forty)
    assert found.ok.all() and solved.ok.all() and (~engine.predict(failing).ok).sum() == 1

    def one_warm() -> None:
        assert engine.predict(one, start=solved.x).ok.all()

    def stepped(at: Mapping[str, np.ndarray], x: np.ndarray) -> None:
        moved = {**at, engine.power_setting: at[engine.power_setting] * STEP}
        assert engine.predict(moved, start=x).ok.all()

    def loaded() -> None:
        with outside_allowed():  # the maps of tables lie beside the public cases
            load_engine(file)

    def one_cold() -> None:
        engine.forget_start()
        assert engine.predict(one).ok.all()

    bare = 1e2 * best(lambda: bare_evaluation(engine, points, found.x))
    bare_one = 1e3 * best(lambda: bare_evaluation(engine, one, solved.x), 50)
    report = {
        "bare_evaluation_us_per_point": bare,
        "solve_us_per_point": 1e2 * best(cold),
        "solve_and_sensitivities_us_per_point": 1e2 * best(lambda: cold(engine.monitored)),
        "bare_evaluation_of_one_point_ms": bare_one,
        "one_cold_point_ms": 1e3 * best(one_cold, 20),
        "one_warm_point_ms": 1e3 * best(one_warm, 20),
        "one_point_stepped_ms": 1e3 * best(lambda: stepped(one, solved.x), 20),
        "forty_points_stepped_ms": 1e3 * best(lambda: stepped(forty, solved_forty.x), 20),
        "a_failing_row_of_1000_costs_ms": 1e3
        * (best(lambda: engine.predict(failing)) - best(lambda: engine.predict(thousand))),
        "load_engine_ms": 1e3 * best(loaded),
    }
    report["solve_over_bare"] = report["solve_us_per_point"] / bare
    report["solve_and_sensitivities_over_bare"] = report["solve_and_sensitivities_us_per_point"] / bare
    report["one_cold_point_over_bare"] = report["one_cold_point_ms"] / bare_one
    report["one_warm_point_over_bare"] = report["one_warm_point_ms"] / bare_one
    report["share_batch_independent_percent"] = 100.0 * batch_independent(engine)
    return report


def bare_evaluation(engine: Engine, points: Mapping[str, np.ndarray], x: np.ndarray) -> None:
    """One pass of the model at unknowns x, without derivatives."""
    nominal = {name: p.nominal for name, p in engine.parameters.items()}
    solver.evaluate(engine.network, {**engine.optional_inputs, **points}, nominal, x, frozenset())


def batch_independent(engine: Engine) -> float:
    """Share of 2,000 points whose values and sensitivities in batches of 50 to 700 points are those of one batch, to
    the last digit."""
    points = operating_points(engine, 2000, seed=5)
    wrt = engine.monitored[:3]
    whole, same = engine.predict(points, sensors=OUTPUTS, wrt=wrt), np.ones(2000, dtype=bool)
    for size in (50, 125, 700):
        engine.forget_start()
        for first in range(0, 2000, size):
            rows = slice(first, first + size)
            part = engine.predict({c: v[rows] for c, v in points.items()}, sensors=OUTPUTS, wrt=wrt)
            same[rows] &= (part.y == whole.y[rows]).all(axis=1) & (part.jacobian == whole.jacobian[rows]).all(
                axis=(1, 2)
            )
    return float(same.mean())


ROWS = (
    ("a bare evaluation, per point", "bare_evaluation_us_per_point", "{:.2g} µs"),
    ("solve, per point", "solve_us_per_point", "{:.3g} µs"),
    ("… over a bare evaluation", "solve_over_bare", "{:.2g}"),
    ("solve and ∂Φ/∂θ (12 outputs × 11 parameters), per point", "solve_and_sensitivities_us_per_point", "{:.3g} µs"),
    ("… over a bare evaluation", "solve_and_sensitivities_over_bare", "{:.2g}"),
    ("a bare evaluation of one point", "bare_evaluation_of_one_point_ms", "{:.2g} ms"),
    ("one cold point, no fitted start", "one_cold_point_ms", "{:.3g} ms"),
    ("… over a bare evaluation", "one_cold_point_over_bare", "{:.2g}"),
    ("one point from its solution", "one_warm_point_ms", "{:.3g} ms"),
    ("… over a bare evaluation", "one_warm_point_over_bare", "{:.2g}"),
    ("one point, its power 0.5 % higher, from the last solution", "one_point_stepped_ms", "{:.3g} ms"),
    ("forty points likewise", "forty_points_stepped_ms", "{:.3g} ms"),
    ("what one row without a solution adds to 1,000", "a_failing_row_of_1000_costs_ms", "{:.0f} ms"),
    ("rows the same to the last digit in batches of 50 to 2,000", "share_batch_independent_percent", "{:.3g} %"),
)


def table(report: Mapping[str, Any]) -> None:
    """Markdown table of the speeds."""
    maps = [m for m in ("parametric_maps", "table_maps") if m in report]
    print("| CPU time | " + " | ".join(m.replace("_", " ") for m in maps) + " |\n" + "|---" * (1 + len(maps)) + "|")
    for title, key, unit in ROWS:
        print(f"| {title} | " + " | ".join(unit.format(report[m][key]) for m in maps) + " |")
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
