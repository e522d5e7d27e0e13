"""Faults of another simulator's engine, isolated by default options: python tests/real_runs/pycycle_isolation.py
[--seeds N]

For each noise seed: `identify` on the healthy file, `isolate` on the three fault files whole and on 60 records with
one to three random faults one by one, through the commands; and, for two of the seeds, the healthy recording of another
seed with each sensor off by three standard deviations of its noise in turn. Prints how often exactly the true
parameters are named, sensors that are named, reliability of what is stated, and coverage of the intervals.
"""

from __future__ import annotations

import csv
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pycycle_runs
import shared_data
from pycycle_runs import pycycle_concealed

NAMES = {"eff": "efficiency", "flow": "flow_capacity"}
"""Of the truth's columns."""
BINS = (0.0, 0.5, 0.7, 0.9, 1.01)
OFF = 3.0
"""Error of a sensor in standard deviations of its noise: of 80 records together it is certain."""
OFF_SEEDS = 2
"""Seeds of which every sensor is tried."""
CORES = 2
"""Seeds run side by side."""


def truth(name: str) -> list[dict[str, float]]:
    """Per record, parameter → change in parts of 1. Of components only: that is what these files hold."""
    path = shared_data.DATA / "pycycle_hbtf" / "answers" / f"{name}.csv"
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for row in rows:
        changes = {}
        for column, value in row.items():
            part = column.split("_")
            if part[1] == "d" and float(value):
                changes[f"{part[3]}.{NAMES[part[2]]}"] = -float(value)
        found.append(changes)
    return found


def command(*arguments: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-m", "enginediag_cli", *arguments], capture_output=True, text=True, check=False
    )
    return done.returncode, done.stdout if "source," in done.stdout else done.stderr


def windows(text: str) -> Iterator[list[dict[str, str]]]:
    """Rows of one window at a time: one per parameter that is named, one where none is."""
    rows: list[dict[str, str]] = []
    for row in csv.DictReader(line for line in text.splitlines() if not line.startswith("#")):
        if rows and row["first_line"] != rows[-1]["first_line"]:
            yield rows
            rows = []
        rows.append(row)
    if rows:
        yield rows


def judged(seed: int, folder: Path) -> dict[str, object]:
    nominal = str(folder / f"nominal_{seed}.yaml")
    code, told = command(
        "identify", str(folder / "hbtf.yaml"), str(folder / f"nominal_{seed}.csv"), "-q", "-o", nominal
    )
    found: dict[str, object] = {"identify": code, "told": told, "whole": [], "single": []}
    if code:
        return found
    for name in ("fault_1", "fault_2", "fault_3"):
        code, text = command("isolate", "-n", nominal, str(folder / f"{name}_{seed}.csv"), "-q")
        found["whole"].append((name, truth(name)[0], next(windows(text))))  # type: ignore[attr-defined]
    code, text = command("isolate", "-n", nominal, str(folder / f"faults_random_{seed}.csv"), "-q", "--window", "1")
    rows = list(windows(text))
    first = [int(w[0]["first_line"]) for w in rows]
    every = truth("faults_random")
    found["single"] = [(every[line - min(first)], w) for line, w in zip(first, rows, strict=True)]
    return found


def sensor_off(seed: int, other: int, folder: Path, every: int = 1) -> list[tuple[str, list[dict[str, str]]]]:
    """Each sensor, or one of `every`, and what is said of the healthy recording `other` with its error added."""
    sensors = pycycle_concealed.engine(folder).sensors
    with (folder / f"nominal_{other}.csv").open(encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    found = []
    for column in list(sensors)[::every]:
        at, error = head.index(column), OFF * sensors[column].noise_sigma
        wrong = folder / f"{column}_off_{seed}.csv"
        with wrong.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(head)
            table.writerows([*row[:at], f"{float(row[at]) + error:.9g}", *row[at + 1 :]] for row in rows)
        _, text = command("isolate", "-n", str(folder / f"nominal_{seed}.yaml"), str(wrong), "-q")
        found.append((f"sensor.{column.rpartition('_')[0]}.bias", next(windows(text))))
    return found


def main(arguments: list[str]) -> None:
    if not shared_data.available("pycycle_hbtf"):
        sys.exit(shared_data.reason("pycycle_hbtf"))
    seeds = int(arguments[arguments.index("--seeds") + 1]) if "--seeds" in arguments else 10
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        pycycle_runs.write(folder, ["nominal", "fault_1", "fault_2", "fault_3", "faults_random"], seeds)
        with ThreadPoolExecutor(CORES) as pool:
            results = list(pool.map(lambda k: judged(k, folder), range(seeds)))
            tried = [k for k in range(min(seeds - 1, OFF_SEEDS)) if results[k]["identify"] == 0]
            off = [each for some in pool.map(lambda k: sensor_off(k, k + 1, folder), tried) for each in some]
    report(results)
    named = sum(answer(rows) == {sensor} for sensor, rows in off)
    parts = sum(any(n and n.split(".")[0] not in ("sensor", "input") for n in answer(rows)) for _, rows in off)
    print(f"one sensor off by {OFF:g} sigma: it alone named {named} of {len(off)}, a component in {parts}")


def report(results: list[dict[str, object]]) -> None:
    """Print the tables."""
    converged = [r for r in results if r["identify"] == 0]
    print(f"identify converges: {len(converged)} of {len(results)}")
    for r in results:
        if r["identify"]:
            print("  ", str(r["told"]).strip().splitlines()[-1])
    exact = sensors = total = 0
    for r in converged:
        for name, true, rows in r["whole"]:  # type: ignore[attr-defined]
            total += 1
            named = answer(rows)
            if named == set(true):
                exact += 1
            else:
                print(f"  {name}: {'; '.join(sorted(named)) or 'nothing'} ({rows[0].get('probability', '')})")
            sensors += any(n.split(".")[0] in ("sensor", "input") for n in named)
    print(f"fault files whole: exact {exact} of {total}; an instrument named in {sensors}")
    single(converged)


def answer(rows: list[dict[str, str]]) -> set[str]:
    return {n for n in rows[0]["isolated"].split("; ") if n}


def single(converged: list[dict[str, object]]) -> None:
    bins: dict[float, list[tuple[float, bool, int]]] = defaultdict(list)
    exact = among = count = covered = intervals = wrong_sensor = 0
    for r in converged:
        for record, (true, rows) in enumerate(r["single"]):  # type: ignore[arg-type]
            count += 1
            named, stated = answer(rows), float(rows[0]["probability"] or 0.0)
            rivals = [set(x.rpartition(" (")[0].split(" & ")) for x in rows[0]["rivals"].split("; ") if x]
            right = named == set(true)
            exact += right
            among += right or set(true) in rivals
            wrong_sensor += any(n.split(".")[0] in ("sensor", "input") for n in named)
            low = max(b for b in BINS if b <= stated)
            bins[low].append((stated, right, record))
            for row in rows:
                if row["parameter"]:
                    intervals += 1
                    size = true.get(row["parameter"], 0.0)
                    covered += float(row["lower"]) <= size <= float(row["upper"])
    if not count:
        return
    print(
        f"random faults, one record each: exact {exact} of {count} ({100 * exact / count:.0f} %), "
        f"in answer and rivals {100 * among / count:.1f} %, an instrument named in {wrong_sensor}, "
        f"intervals {100 * covered / max(intervals, 1):.1f} % of {intervals}"
    )
    for low in sorted(bins):
        stated = sum(s for s, _, _ in bins[low]) / len(bins[low])
        right = sum(ok for _, ok, _ in bins[low]) / len(bins[low])
        records, error = by_records(bins[low])
        print(
            f"  stated from {low:.1f}: {len(bins[low])}, mean {stated:.2f}, right {right:.2f} "
            f"± {error:.2f} by the {records} records"
        )


def by_records(told: list[tuple[float, bool, int]]) -> tuple[int, float]:
    """How many records with their own faults there are, and the standard error of how often answers are right: noise
    seeds of one record are right or wrong together, so that it is the records that were drawn."""
    off: dict[int, float] = defaultdict(float)
    mean = sum(ok - stated for stated, ok, _ in told) / len(told)
    for stated, ok, record in told:
        off[record] += ok - stated - mean
    return len(off), sum(x**2 for x in off.values()) ** 0.5 / len(told)


if __name__ == "__main__":
    main(sys.argv[1:])
