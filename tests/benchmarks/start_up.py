"""What starting costs: CPU seconds of short commands, and as multiples of imports; prints JSON.

    python tests/benchmarks/start_up.py [--table] [REPETITIONS]

User and system time of child processes, the median and the smallest of several runs that take turns, so that a busy
machine slows all alike: compare the ratios. Modules are compiled beforehand, as they are for whoever has run the
program once. `--table` prints the table of README.md beside this.
"""

from __future__ import annotations

import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TOP = Path(__file__).parents[2]
REPETITIONS = 9
RECORDS = 2
"""Of the recording that is judged: starting is nearly all that this takes."""


PEERS = {"--version": "import click"}
"""What a command is compared with that imports less than the others do."""
PEER = "import numpy, click, yaml"


def cpu(command: list[str], environment: dict[str, str]) -> float:
    """User and system time of one run [s]; an exit code other than 0 is an error."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, env=environment, cwd=TOP, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def short_recording(folder: Path) -> Path:
    """The first two records of a shipped recording."""
    lines = (TOP / "sample_data" / "fouling_snapshots.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    header = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    path = folder / "two.csv"
    path.write_text("".join(lines[: header + 1 + RECORDS]), encoding="utf-8")
    return path


def measured(repetitions: int) -> dict[str, list[float]]:
    """CPU seconds of every run of each command."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {"PYTHONPYCACHEPREFIX": str(folder / "compiled"), "OPENBLAS_NUM_THREADS": "1"}
        nominal, recording = str(folder / "nominal.yaml"), str(short_recording(folder))
        program = [sys.executable, "-m", "enginediag_cli"]
        healthy = str(TOP / "sample_data" / "healthy_snapshots.csv")
        cpu([*program, "identify", "configs/turbofan.yaml", healthy, "-o", nominal], environment)
        runs = {
            "import click": [sys.executable, "-c", "import click"],
            PEER: [sys.executable, "-c", PEER],
            "--version": [*program, "--version"],
            "detect --help": [*program, "detect", "--help"],
            "check": [*program, "check", "configs/turbofan.yaml"],
            "simulate 1 flight": [*program, "simulate", "configs/turbofan.yaml", "--flights", "1"],
            "detect 2 records": [*program, "detect", "-n", nominal, recording],
            "isolate 2 records": [*program, "isolate", "-n", nominal, recording],
        }
        for command in runs.values():  # compile, and fill the disk's cache
            cpu(command, environment)
        seconds: dict[str, list[float]] = {name: [] for name in runs}
        for _ in range(repetitions):
            for name, command in runs.items():
                seconds[name].append(cpu(command, environment))
    return seconds


def summary(seconds: Mapping[str, list[float]]) -> dict[str, Any]:
    """Of each command the median, the smallest, and both over those of the imports that it is compared with."""
    rows = {}
    for name, found in seconds.items():
        peer = seconds[PEERS.get(name, PEER)]
        rows[name] = {
            "median_cpu_s": round(statistics.median(found), 3),
            "smallest_cpu_s": round(min(found), 3),
            "over": PEERS.get(name, PEER),
            "ratio_of_medians": round(statistics.median(found) / statistics.median(peer), 2),
            "ratio_of_smallest": round(min(found) / min(peer), 2),
        }
    return {"runs": len(next(iter(seconds.values()))), "commands": rows}


def table(report: Mapping[str, Any]) -> None:
    """Markdown table of what was measured."""
    print("| CPU time | median | smallest | over | ratio of medians |\n|---|---|---|---|---|")
    for name, row in report["commands"].items():
        over = "" if name in (PEER, "import click") else f"`{row['over']}` | {row['ratio_of_medians']:.2f}"
        print(f"| {name} | {row['median_cpu_s']:.3f} s | {row['smallest_cpu_s']:.3f} s | {over or '|'} |")


def main(arguments: list[str]) -> int:
    numbers = [int(a) for a in arguments if a.isdigit()]
    report = summary(measured(numbers[0] if numbers else REPETITIONS))
    if "--table" in arguments:
        table(report)
    else:
        print(json.dumps(report, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
