"""What starting costs: CPU seconds of short commands, and as multiples of `import numpy, click, yaml`; prints JSON.

    python tests/benchmarks/start_up.py [REPETITIONS]

User and system time of child processes, the median and the smallest of several runs that take turns, so that a busy
machine slows all alike. Modules are compiled beforehand, as they are for whoever has run the program once.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

TOP = Path(__file__).parents[2]
REPETITIONS = 5
RECORDS = 2
"""Of the recording that is judged: starting is nearly all that this takes."""


def cpu(command: list[str], environment: dict[str, str]) -> float:
    """User and system time of one run [s]; an exit code other than 0 is an error."""
    before = os.times()
    subprocess.run(command, env=environment, cwd=TOP, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = os.times()
    return after.children_user - before.children_user + after.children_system - before.children_system


def short_recording(folder: Path) -> Path:
    """The first two records of a shipped recording."""
    lines = (TOP / "sample_data" / "fouling_snapshots.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    header = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    path = folder / "two.csv"
    path.write_text("".join(lines[: header + 1 + RECORDS]), encoding="utf-8")
    return path


def main(repetitions: int) -> int:
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
            "import numpy, click, yaml": [sys.executable, "-c", "import numpy, click, yaml"],
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
    median = {name: statistics.median(found) for name, found in seconds.items()}
    unit = median["import numpy, click, yaml"]
    rows = {
        name: {
            "median_cpu_s": round(median[name], 3),
            "smallest_cpu_s": round(min(found), 3),
            "imports": round(median[name] / unit, 2),
        }
        for name, found in seconds.items()
    }
    ratio = median["--version"] / median["import click"]
    print(json.dumps({"runs": repetitions, "commands": rows, "version_over_import_click": round(ratio, 2)}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]) if len(sys.argv) > 1 else REPETITIONS))
