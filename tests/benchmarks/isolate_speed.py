"""CPU time of `isolate` a window, all suspects: python tests/benchmarks/isolate_speed.py [--windows 20] [--table]

Windows of 20 records of the turbofan with one or two changes of 0.5 to 2 %, eleven health parameters, nine sensors and
two input channels suspected together; nominal and noise known. Apart: the statistics about the re-estimate, windows
together as in the pipeline; the exact search over sets; and the whole diagnosis with the full model's check of it, the
averaged sizes and the class. JSON, milliseconds a window, middle and worst.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "isolation"))

from turbofan_trials import ENGINE, faulty_window, score_and_solution

from enginediag_cli.engine.instrument_errors import InputErrors
from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose
from enginediag_cli.isolation.nonlinear import WindowModel
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.simulation.flights import ColumnNoise
from enginediag_cli.validation.studies import known_nominal

RECORDS = 20


def suspects() -> Monitor:
    engine = InputErrors.wrap(load_engine(ENGINE))
    noise = {c: ColumnNoise("gaussian", sigma=s.noise_sigma) for c, s in engine.sensors.items()}
    return known_nominal(engine, (*engine.monitored, "sensor.*.bias", "input.*"), noise)


def timed(windows: int, seed: int = 1) -> dict[str, list[float]]:
    """CPU seconds of each part, for every window."""
    monitor, rng = suspects(), np.random.default_rng(seed)
    health = [n for n, p in monitor.meaning.items() if not p.belongs_to_instrument]
    found: dict[str, list[float]] = {"statistics": [], "search": [], "diagnosis": []}
    for k in range(windows + 1):
        names = rng.choice(health, rng.integers(1, 3), replace=False)
        change = {str(n): -rng.uniform(0.005, 0.02) for n in names}
        inputs, y = faulty_window(rng, monitor, change, RECORDS)
        begun = [time.process_time()]
        score, x = score_and_solution(monitor, inputs, y)
        begun.append(time.process_time())
        set_posterior(score)
        begun.append(time.process_time())
        diagnose(score, DiagnosisOptions(), lambda inputs=inputs, y=y, x=x: WindowModel(monitor, inputs, y, x))
        begun.append(time.process_time())
        if k:  # the first plans the sets
            for name, seconds in zip(found, np.diff(begun), strict=True):
                found[name].append(float(seconds))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--windows", type=int, default=20)
    parser.add_argument("--table", action="store_true", help="a Markdown table instead of JSON")
    options = parser.parse_args()
    report = {
        name: {"middle_ms": round(1e3 * float(np.median(s)), 1), "worst_ms": round(1e3 * max(s), 1)}
        for name, s in timed(options.windows).items()
    }
    if not options.table:
        print(json.dumps(report, indent=2))
        return
    print("| part of a window | CPU ms, median | worst |\n|---|---|---|")
    for name, row in report.items():
        print(f"| {name} | {row['middle_ms']} | {row['worst_ms']} |")


if __name__ == "__main__":
    main()
