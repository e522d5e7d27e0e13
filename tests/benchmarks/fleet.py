"""A fleet from recordings to ranking: python tests/benchmarks/fleet.py [--engines 10,100] [--jobs 1,2] [--table]

Simulates engines of the turbofan cheaply (one template of flights; each engine's wear by the sensitivities there, noise
of its own), a CSV file each, and runs `enginediag fleet` over the first so many of them, each time in a process of its
own. Prints JSON, or with --table the table of the README: wall and CPU seconds, CPU per engine, in proportion to the
smallest fleet, highest memory of a process, engines flagged and those among them that are not worn, and what a second
run with the store takes. --flights and --records say how much each engine flew (100 and 20), --folder keeps the
recordings from one run to the next. --once: each size and number of jobs is run once, the identification of the common
model included, as a fleet is that is seen for the first time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.config.validate import load_checked
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import write_csv
from enginediag_cli.simulation.flights import generate_flights

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
FLEET = """kind: fleet
engine: turbofan.yaml
engines: {{serial_from: file, pattern: 'engine_(\\d+)'}}
recordings: [{recordings}]
baseline: {{flights: 10}}
"""
WEAR = {"hpc.efficiency": -0.01, "hpc.flow_capacity": -0.01, "hpt.efficiency": -0.005}
"""Of one engine in five, at the end of its recording, growing evenly from its middle on."""
A_DAY = 1_000_000
"""Flights, to which the cost is extrapolated."""


def recordings(engines: int, flights: int, records: int, folder: Path) -> list[Path]:
    """One CSV file per engine, those that are there already left as they are."""
    paths = [folder / f"engine_{number:05d}.csv" for number in range(engines)]
    if all(path.exists() for path in paths):
        return paths
    engine = load_engine(CONFIGS / "turbofan.yaml")
    rng = np.random.default_rng(0)
    plan = load_checked(CONFIGS / "flights" / "airliner.yaml", "flight").values
    given = generate_flights({**plan, "flights": flights}, engine, rng).columns
    flight = np.asarray(given["flight"]).astype(int)
    # so many records of each flight, evenly chosen
    rows = np.concatenate(
        [mine[np.linspace(0, len(mine) - 1, records).round().astype(int)] for mine in _by(flight, flights)]
    )
    inputs = {c: np.asarray(given[c])[rows] for c in engine.inputs if c in given}
    healthy = engine.predict(inputs, {}, sensors=tuple(engine.sensors), wrt=tuple(WEAR))
    sigma = np.array([sensor.noise_sigma for sensor in engine.sensors.values()])
    relative = (flight[rows] - 1) / flights
    for number, path in enumerate(paths):
        own = np.random.default_rng([1, number])
        worn = np.maximum(2 * relative - 1, 0.0) * is_worn(number)
        change = np.stack([size * worn for size in WEAR.values()], axis=1)
        y = healthy.y + np.einsum("nmp,np->nm", healthy.jacobian, change)
        y = y + sigma * own.standard_normal(y.shape)
        columns = {"flight": flight[rows].astype(float), "time_s": np.asarray(given["time_s"])[rows], **inputs}
        columns |= dict(zip(engine.sensors, y.T, strict=True))
        if not path.exists():
            write_csv(path, [Recording(columns)], digits=7)
    return paths


def is_worn(number: int) -> bool:
    """Whether an engine of this number is one that wears."""
    return number % 5 == 4


def _by(flight: np.ndarray, flights: int) -> Iterator[np.ndarray]:
    for number in range(1, flights + 1):
        yield np.flatnonzero(flight == number)


def run(fleet: Path, jobs: int, store: Path | None) -> dict[str, Any]:
    """Wall and CPU seconds and peak memory of one run of the command."""
    command = [sys.executable, "-m", "enginediag_cli", "fleet", str(fleet), "--jobs", str(jobs), "-q"]
    command += ["-o", str(fleet.with_suffix(".json")), *(["--store", str(store)] if store else [])]
    since = time.perf_counter()
    process = subprocess.Popen(command)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    flagged = set(json.loads(fleet.with_suffix(".json").read_text(encoding="utf-8"))["discoveries"]["engines"])
    false = sum(not is_worn(int(serial)) for serial in flagged)
    return {
        "flagged": len(flagged),
        "false": false,
        "jobs": jobs,
        "wall_s": round(time.perf_counter() - since, 2),
        "cpu_s": round(used.ru_utime + used.ru_stime, 2),
        "memory_MB": round(used.ru_maxrss / 1024),  # of the largest process, workers included
        "exit_code": process.returncode,
    }


def measured(sizes: list[int], jobs: list[int], folder: Path, once: bool) -> Iterator[dict[str, Any]]:
    """A row for each size and number of jobs, and, unless once, one for a second run over what is known."""
    for engines in sizes:
        fleet = folder / f"fleet_{engines}.yaml"
        names = ", ".join(f"'engine_{number:05d}.csv'" for number in range(engines))
        fleet.write_text(FLEET.format(recordings=names), encoding="utf-8")
        store = folder / f"store_{engines}"
        if once:
            for number in jobs:
                subprocess.run(["rm", "-rf", str(store)], check=True)
                yield {"engines": engines, "what": "identify and all", **run(fleet, number, store)}
            continue
        for number in jobs:
            subprocess.run(["rm", "-rf", str(store / "recordings")], check=True)
            if not store.exists():  # the common model is identified once, by itself
                yield {"engines": engines, "what": "identify and all", **run(fleet, number, store)}
                subprocess.run(["rm", "-rf", str(store / "recordings")], check=True)
            yield {"engines": engines, "what": "all", **run(fleet, number, store)}
        yield {"engines": engines, "what": "again", **run(fleet, jobs[-1], store)}


def compared(rows: list[dict[str, Any]], flights: int) -> dict[str, Any]:
    """The rows with cost per engine, and what follows from them."""
    for row in rows:
        row["cpu_s_per_engine"] = round(row["cpu_s"] / row["engines"], 4)
    what = "all" if any(row["what"] == "all" for row in rows) else "identify and all"
    whole = [row for row in rows if row["what"] == what]
    found: dict[str, Any] = {"flights_per_engine": flights, "rows": rows}
    by_jobs = {n: [r for r in whole if r["jobs"] == n] for n in {r["jobs"] for r in whole}}
    for n, mine in sorted(by_jobs.items()):
        if len(mine) > 1:
            further = [(b["cpu_s"] - a["cpu_s"]) / (b["engines"] - a["engines"]) for a, b in pairwise(mine)]
            more = further[-1]
            found[f"cpu_s_per_further_engine_{n}_jobs"] = [round(each, 4) for each in further]
            found[f"over_linear_{n}_jobs"] = round(
                mine[-1]["cpu_s"] / (mine[0]["cpu_s"] + _beyond(mine) * further[0]), 3
            )
            found[f"cores_for_a_million_flights_a_day_{n}_jobs"] = round(more / flights * A_DAY / 86_400, 2)
    largest = whole[-1]["engines"]
    alone = [r["wall_s"] for r in whole if r["engines"] == largest and r["jobs"] == 1]
    for row in whole:
        if alone and row["engines"] == largest and row["jobs"] > 1:
            found[f"gain_of_{row['jobs']}_jobs"] = round(alone[0] / row["wall_s"], 2)
    return found


def _beyond(rows: list[dict[str, Any]]) -> int:
    """Engines of the largest fleet that the smallest does not have."""
    return int(rows[-1]["engines"]) - int(rows[0]["engines"])


def table(found: dict[str, Any]) -> Iterator[str]:
    heads = (
        "engines",
        "jobs",
        "run",
        "wall s",
        "CPU s",
        "CPU s an engine",
        "memory of a process, MB",
        "flagged",
        "false",
    )
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for r in found["rows"]:
        cells = (r["engines"], r["jobs"], r["what"], r["wall_s"], r["cpu_s"], r["cpu_s_per_engine"], r["memory_MB"])
        cells += (r["flagged"], r["false"])
        yield "| " + " | ".join(f"{cell:,}" if isinstance(cell, int) else str(cell) for cell in cells) + " |"
    yield ""
    yield from (f"{key}: {value}" for key, value in found.items() if key != "rows")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engines", default="10,100")
    parser.add_argument("--jobs", default="1,2")
    parser.add_argument("--flights", type=int, default=100)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--once", action="store_true")
    asked = parser.parse_args()
    sizes, jobs = ([int(n) for n in text.split(",")] for text in (asked.engines, asked.jobs))
    with tempfile.TemporaryDirectory() as temporary:
        folder = asked.folder or Path(temporary)
        folder.mkdir(exist_ok=True, parents=True)
        recordings(max(sizes), asked.flights, asked.records, folder)
        found = compared(list(measured(sizes, jobs, folder, asked.once)), asked.flights)
    print("\n".join(table(found)) if asked.table else json.dumps(found, indent=1))


if __name__ == "__main__":
    main()
