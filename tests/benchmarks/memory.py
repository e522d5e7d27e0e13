"""How much memory commands take as a recording grows: peak resident set of each; prints JSON.

    python tests/benchmarks/memory.py [--lengths 10000,100000] [--commands detect,isolate] [--series 2000] [--table]

One flight of the turbofan once in 0.2 s, with the default error model, in a file of so many records, judged by a
nominal that was identified from four flights at 60 s: windows are whole flights, the worst case. `parquet` judges the
same file as Parquet. Two million records take `detect` a quarter of an hour of one core. --series: so many flights of
one record each, cruise, for `trend`, `trend --what margin` and a fleet of one engine. `--table` prints the tables of
README.md beside this.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

TOP = Path(__file__).parents[2]
PROGRAM = (sys.executable, "-m", "enginediag_cli")
STEP_S = 0.2
COMMANDS = {
    "detect": ("detect", "-n", "nominal.yaml", "{file}", "-o", "out.csv"),
    "parquet": ("detect", "-n", "nominal.yaml", "{file}.parquet", "-o", "out.csv"),
    "nominal": ("detect", "-n", "nominal.yaml", "{file}", "--linearise", "nominal", "-o", "out.csv"),
    "residual": ("residual", "-n", "nominal.yaml", "--sensors", "{file}", "-o", "out.csv"),
    "records": ("residual", "-n", "nominal.yaml", "--what", "records", "{file}", "-o", "out.csv"),
    "isolate": ("isolate", "-n", "nominal.yaml", "{file}", "-o", "out.csv"),
    "trend": ("trend", "-n", "nominal.yaml", "{file}", "-o", "out.csv"),
    "check": ("check", "--engine", "configs/turbofan.yaml", "{file}"),
    "identify": ("identify", "configs/turbofan.yaml", "{file}", "-o", "new.yaml"),
    "report": ("report", "-n", "nominal.yaml", "{file}", "-o", "out.html"),
    "locate": ("locate", "configs/turbofan.yaml", "{file}", "-o", "out.csv"),
}
SERIES = {
    "trend": ("trend", "-n", "nominal.yaml", "{file}", "-o", "out.csv"),
    "margin": (
        "trend",
        "-n",
        "nominal.yaml",
        "--what",
        "margin",
        "--limit",
        "T45_K",
        "1280",
        "{file}",
        "-o",
        "out.csv",
    ),
    "fleet": ("fleet", "fleet.yaml", "{file}", "-o", "out.json"),
}
"""Commands that follow an engine over flights."""
FLEET = """kind: fleet
engine: turbofan.yaml
nominal: nominal.yaml
recordings: ['none_*.csv']
engines: {serial_from: file, pattern: '(\\d+)'}
baseline: {flights: 50}
"""
FAULT = """kind: faults
description: a compressor that lost efficiency
source: assumed
faults:
  - {name: loss, description: loss, reference: assumed, assumed: true,
     changes: {hpc.efficiency: -0.02, hpc.flow_capacity: -0.03}, law: {type: step, clock: flight, onset: 1}}
"""


def peak(folder: Path, command: tuple[str, ...]) -> dict[str, Any]:
    """Peak memory in MB, CPU seconds and exit code of a command."""
    words = [str(TOP / w) if w.startswith("configs/") else w for w in command]
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = os.pathsep.join([str(TOP), environment.get("PYTHONPATH", "")])
    with open(os.devnull, "w", encoding="utf-8") as nowhere:
        child = subprocess.Popen([*PROGRAM, *words], cwd=folder, env=environment, stdout=nowhere, stderr=nowhere)
        _, status, used = os.wait4(child.pid, 0)
    return {
        "peak_MB": round(used.ru_maxrss / 1000),
        "cpu_s": round(used.ru_utime + used.ru_stime, 1),
        "exit": os.waitstatus_to_exitcode(status),
    }


def simulate(folder: Path, step_s: float, flights: int, seed: int, path: str, *more: str) -> None:
    """Flights of an airliner with a record every so many seconds."""
    text = (TOP / "configs" / "flights" / "airliner.yaml").read_text(encoding="utf-8")
    (folder / "flight.yaml").write_text(text.replace("interval_s: 10", f"interval_s: {step_s:g}"), encoding="utf-8")
    words = ("simulate", "configs/turbofan.yaml", "--flight", "flight.yaml", "--flights", str(flights))
    found = peak(folder, (*words, "--seed", str(seed), *more, "-o", path))
    if found["exit"]:
        raise SystemExit(f"simulate ended with {found['exit']}")


def long_recording(folder: Path, records: int) -> str:
    """A flight of so many records: the same hours again and again, on one clock. Also as Parquet, where pyarrow is."""
    name = f"{records}.csv"
    lines = [x for x in (folder / "flight.csv").read_text(encoding="utf-8").splitlines() if not x.startswith("#")]
    rows = [line.split(",", 2) for line in lines[1:]]  # flight, time, rest
    with open(folder / name, "w", encoding="utf-8") as out:
        print(lines[0], file=out)
        for i in range(records):
            flight, _, rest = rows[i % len(rows)]
            print(f"{flight},{i * STEP_S:.1f},{rest}", file=out)
    return name


def as_parquet(folder: Path, name: str) -> None:
    """The same table, some megabytes at a time."""
    from pyarrow import csv, parquet

    with csv.open_csv(folder / name) as table, parquet.ParquetWriter(folder / f"{name}.parquet", table.schema) as out:
        for batch in table:
            out.write_batch(batch)


def series_recording(folder: Path, flights: int) -> str:
    """Cruise of healthy flights, then of as many of an engine that has changed, each record a flight of its own."""
    name, rows, head = f"{flights}_flights.csv", [], ""
    for path in ("healthy.csv", "changed.csv"):
        lines = [x for x in (folder / path).read_text(encoding="utf-8").splitlines() if not x.startswith("#")]
        head = lines[0].split(",", 2)[2]
        rows.append([x.split(",", 2)[2] for x in lines[1:] if ",cruise," in x])
    half = flights // 2
    with open(folder / name, "w", encoding="utf-8") as out:
        print("flight", head, sep=",", file=out)
        for i in range(flights):
            mine = rows[i >= half]
            print(i + 1, mine[37 * i % len(mine)], sep=",", file=out)
    return name


def measured_series(counts: list[int]) -> list[dict[str, Any]]:
    """Of series of one-record flights."""
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "fault.yaml").write_text(FAULT, encoding="utf-8")
        (folder / "fleet.yaml").write_text(FLEET, encoding="utf-8")
        simulate(folder, 60, 4, 1, "training.csv")
        peak(folder, ("identify", "configs/turbofan.yaml", "training.csv", "-o", "nominal.yaml"))
        simulate(folder, 60, 40, 2, "healthy.csv")
        simulate(folder, 60, 40, 3, "changed.csv", "--fault", "fault.yaml")
        for flights in counts:
            name = series_recording(folder, flights)
            for command, words in SERIES.items():
                used = peak(folder, tuple(w.format(file=name) for w in words))
                found.append({"command": command, "flights": flights, **used})
                print(json.dumps(found[-1]), file=sys.stderr)
    return found


def measured(lengths: list[int], commands: list[str]) -> list[dict[str, Any]]:
    found = []
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        simulate(folder, 60, 4, 1, "training.csv")
        peak(folder, ("identify", "configs/turbofan.yaml", "training.csv", "-o", "nominal.yaml"))
        simulate(folder, STEP_S, 1, 2, "flight.csv")
        for records in lengths:
            name = long_recording(folder, records)
            if "parquet" in commands:
                as_parquet(folder, name)
            for command in commands:
                words = tuple(w.format(file=name) for w in COMMANDS[command])
                found.append({"command": command, "records": records, **peak(folder, words)})
                print(json.dumps(found[-1]), file=sys.stderr)
    return found


def table(found: list[dict[str, Any]], what: str) -> str:
    lengths = sorted({x[what] for x in found})
    lines = [
        "| peak memory, MB | " + " | ".join(f"{n:,} {what}" for n in lengths) + " |",
        "|---" * (len(lengths) + 1) + "|",
    ]
    for command in dict.fromkeys(x["command"] for x in found):
        cells = [
            next((str(x["peak_MB"]) for x in found if (x["command"], x[what]) == (command, n)), "") for n in lengths
        ]
        lines.append(f"| {command} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lengths", default="10000,100000")
    parser.add_argument("--series", default="")
    parser.add_argument("--commands", default=",".join(COMMANDS))
    parser.add_argument("--table", action="store_true")
    options = parser.parse_args()
    lengths, counts = ([int(n) for n in text.split(",") if n] for text in (options.lengths, options.series))
    found = measured(lengths, options.commands.split(",")) if lengths else []
    series = measured_series(counts) if counts else []
    if options.table:
        print("\n\n".join(table(part, what) for part, what in ((found, "records"), (series, "flights")) if part))
    else:
        print(json.dumps([*found, *series], indent=1))


if __name__ == "__main__":
    main()
