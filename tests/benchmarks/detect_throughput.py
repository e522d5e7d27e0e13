"""Throughput of `detect` end to end as JSON: python tests/benchmarks/detect_throughput.py [--records 1000000] [--quick]

Simulates an airliner's recording, identifies the engine from other flights, and runs the command on the CSV as a user
would, one process on one core: records per second of CPU time (start-up included) and of wall clock, and peak memory.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ENGINE = Path(__file__).resolve().parents[2] / "configs" / "turbofan.yaml"
TOOL = [sys.executable, "-m", "enginediag_cli"]
CHILD = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL)
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(done.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss / 1e3)
"""


def measured(command: list[str]) -> tuple[float, float, float]:
    """CPU seconds, wall seconds and peak memory [MB] of a command on one core."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    start = time.perf_counter()
    told = subprocess.run(
        [sys.executable, "-c", CHILD, *command], check=True, capture_output=True, text=True, env=environment
    ).stdout.split()
    if told[0] != "0":
        raise RuntimeError(f"{' '.join(command)} ended with {told[0]}")
    return float(told[1]), time.perf_counter() - start, float(told[2])


def table(report: Mapping[str, Any]) -> None:
    """Markdown table of what was measured."""
    print("| `detect` | records per CPU second | per second of wall clock | peak memory |\n|---|---|---|---|")
    for name, found in report.items():
        if isinstance(found, Mapping):
            print(
                f"| {name} | {found['records_per_cpu_second']:,} | {found['records_per_second']:,} "
                f"| {found['peak_memory_MB']} MB |"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=1_000_000)
    parser.add_argument("--quick", action="store_true", help="100,000 records")
    parser.add_argument("--table", action="store_true", help="a Markdown table instead of JSON")
    options = parser.parse_args()
    records = 100_000 if options.quick else options.records
    report: dict[str, object] = {"records": records}
    with tempfile.TemporaryDirectory() as folder:
        healthy, nominal, flown = (f"{folder}/{name}" for name in ("healthy.csv", "nominal.yaml", "flown.csv"))
        for command in (
            ["simulate", str(ENGINE), "--flights", "6", "--seed", "1", "-q", "-o", healthy],
            ["identify", str(ENGINE), healthy, "--no-cross-validation", "-q", "-o", nominal],
            ["simulate", str(ENGINE), "--records", str(records), "--seed", "5", "-q", "-o", flown],
        ):
            subprocess.run([*TOOL, *command], check=True)
        report["file_MB"] = os.path.getsize(flown) / 1e6
        for name, extra in (
            ("default", []),
            ("linearised at nominal", ["--linearise", "nominal"]),
            ("windows of 10 min", ["--window", "10min"]),
        ):
            cpu, wall, memory = measured([*TOOL, "detect", "-q", "-n", nominal, flown, *extra])
            report[name] = {
                "records_per_cpu_second": round(records / cpu),
                "records_per_second": round(records / wall),
                "peak_memory_MB": round(memory),
            }
    report["machine_load"] = os.getloadavg()[0]
    report["children_cpu_s"] = round(resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime, 1)
    if options.table:
        table(report)
    else:
        print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
