"""Speed of Monte-Carlo studies as JSON on stdout: python tests/benchmarks/study_speed.py [--table] [PROCESSES]

The paper's four cases, 2928 diagnoses on data of the full nonlinear engine, re-linearised, with the methods of
configs/studies/paper.yaml (its healthy case left out), through the command line.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
DIAGNOSES = 2928


def four_cases(folder: Path) -> Path:
    """The paper's study without what the paper does not have."""
    text = yaml.safe_load((ROOT / "configs" / "studies" / "paper.yaml").read_text(encoding="utf-8"))
    text["cases"] = [case for case in text["cases"] if case["name"] in "1234"]
    text["engine"] = str(ROOT / "configs" / "turbofan.yaml")
    assert sum(case["repetitions"] for case in text["cases"]) == DIAGNOSES
    file = folder / "four_cases.yaml"
    file.write_text(yaml.safe_dump(text), encoding="utf-8")
    return file


def main() -> None:
    given = [a for a in sys.argv[1:] if a != "--table"]
    processes = int(given[0]) if given else 2
    with tempfile.TemporaryDirectory() as scratch:
        file = four_cases(Path(scratch))
        before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "enginediag_cli",
                "study",
                str(file),
                "--format",
                "json",
                "--processes",
                str(processes),
            ],
            check=True,
            stdout=subprocess.PIPE,
            text=True,
        )
        wall, after = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    result = json.loads(done.stdout)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    report = {
        "diagnoses": DIAGNOSES,
        "records_per_diagnosis": result["records"],
        "methods": sorted({entry["method"] for entry in result["cases"]}),
        "processes": processes,
        "cores": os.cpu_count(),
        "wall_s": wall,
        "cpu_s": used,
        "cpu_s_per_process": used / processes,
        "cpu_ms_per_diagnosis_all_methods": 1e3 * used / DIAGNOSES,
        "seconds_per_diagnosis": {
            f"{entry['case']} {entry['method']}": entry["seconds_per_diagnosis"] for entry in result["timings"]
        },
    }
    if "--table" in sys.argv:
        print("| diagnoses | methods | processes | wall clock | CPU time, start-up included |\n|---|---|---|---|---|")
        methods = len({entry["method"] for entry in result["cases"]})
        print(f"| {DIAGNOSES} | {methods} | {processes} | {wall:.0f} s | {used:.0f} s |")
    else:
        print(json.dumps(report, indent=2))


if __name__ == "__main__":
    main()
