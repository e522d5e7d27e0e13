"""CPU time and memory of `explain` against the number of flights as JSON: python tests/benchmarks/explain_scale.py
[--flights 5 --flights 20 --flights 200]

Flies the shipped turbofan with an effect that its engine file lacks, and runs the command on the CSV as a user would,
on one core: records, CPU seconds (start-up included), peak memory, and whether the effect came first.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from detect_throughput import TOOL, measured

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
CONCEALED = "physics:\n  - {term: reynolds_efficiency, at: hpc, coefficients: {exponent: 0.15}}\n"
"""Within the published range of the exponent (0.06 to 0.20, NASA TN D-6640)."""
SEED = "3"


def scaled(command: str, folder: str, flights: int) -> dict[str, object]:
    """Of one number of flights."""
    truth, recorded, answer = f"{folder}/configs/truth.yaml", f"{folder}/flights.csv", f"{folder}/answer.csv"
    fly = ["simulate", truth, "--flights", str(flights), "--seed", SEED, "-q", "-o", recorded]
    subprocess.run([*TOOL, *fly], check=True)
    with open(recorded, encoding="utf-8") as stream:
        records = sum(not line.startswith("#") for line in stream) - 1
    run = [*TOOL, command, "-q", str(CONFIGS / "turbofan.yaml"), recorded, "--no-header", "-o", answer]
    cpu, wall, memory = measured(run)
    with open(answer, encoding="utf-8", newline="") as stream:
        first = next(csv.DictReader(stream), {})
    found = first.get("name") or f"{first.get('location')} along {first.get('driver')}"
    return {
        "records": records,
        "cpu_s": round(cpu, 1),
        "wall_s": round(wall, 1),
        "cpu_ms_per_record": round(1e3 * cpu / records, 2),
        "peak_memory_MB": round(memory),
        "first": found,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--flights", type=int, action="append", help="may be given several times; default 5 and 20")
    parser.add_argument("--command", choices=("explain", "locate"), default="explain")
    options = parser.parse_args()
    report: dict[str, object] = {"command": options.command}
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(CONFIGS, f"{folder}/configs")
        text = (CONFIGS / "turbofan.yaml").read_text(encoding="utf-8")
        Path(f"{folder}/configs/truth.yaml").write_text(f"{text}\n{CONCEALED}", encoding="utf-8")
        for flights in options.flights or (5, 20):
            report[f"{flights} flights"] = scaled(options.command, folder, flights)
    report["machine_load"] = os.getloadavg()[0]
    json.dump(report, sys.stdout, indent=2)
    print()


if __name__ == "__main__":
    main()
