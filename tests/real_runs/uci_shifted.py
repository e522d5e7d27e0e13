"""A thermocouple of the power plant that steps by 5 K from a random hour of a year on: what `trend` says of it.

    python tests/real_runs/uci_shifted.py [places] [seed] [year of identification] [year watched]

The engine is identified on 2011 and 2012 is watched, as a user would, with default options; or the other
way round. The recorder is that of base load with its limit of TIT 9 K lower, so that a TIT that reads too low does not
hide base load; TAT, which the vanes hold near 550 °C at part load, still tells the two apart. No time stamps: a line
of the file is an hour.
"""

from __future__ import annotations

import csv
import json
import sys
import tempfile
from pathlib import Path

import numpy as np
from ground_recordings import CONFIGS, enginediag, public_data

BASE_LOAD = CONFIGS / "recorders" / "uci_gas_turbine_base_load.yaml"
COLUMNS = {"TIT": "TIT_degC", "TAT": "TAT_degC"}
CLASS = {"input.T4", "sensor.T5"}
FORTNIGHT = 14 * 24
EDGE = 0.1
"""Part of the year at either end in which no reading steps: too little is left to compare there."""


def shifted(source: Path, target: Path, column: str, line: int, size: float) -> None:
    """A copy of the recording in which `column` reads `size` more from physical line `line` on."""
    with open(source, newline="", encoding="utf-8") as stream:
        header, *rows = list(csv.reader(stream))
    k = header.index(column)
    for row in rows[line - 2 :]:
        row[k] = f"{float(row[k]) + size:.10g}"
    with open(target, "w", newline="", encoding="utf-8") as stream:
        csv.writer(stream).writerows([header, *rows])


def told(nominal: Path, recorder: Path, recording: Path) -> list[dict]:
    """Events by component, likeliest first."""
    words = ("trend", "-n", nominal, recording, "--recorder", recorder, "--by", "component", "--format", "json", "-q")
    return [row for row in json.loads(enginediag(*words)[0]) if row["components"]]


def main(places: int, seed: int, before: int, watched: int) -> None:
    rng = np.random.default_rng(seed)
    folder = public_data("uci_gas_turbine")
    year = folder / f"gt_{watched}.csv"
    with open(year, encoding="utf-8") as stream:
        hours = sum(1 for _ in stream) - 1
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        recorder, nominal = work / "watched.yaml", work / "plant.yaml"
        text = BASE_LOAD.read_text(encoding="utf-8")
        recorder.write_text(text.replace("T4_K: 1372.45", "T4_K: 1363.15"), encoding="utf-8")
        engine = CONFIGS / "power_plant.yaml"
        enginediag("identify", engine, folder / f"gt_{before}.csv", "--recorder", recorder, "-o", nominal)
        print("| reading | step, K | from line | leading answer | onset line | class first | within 2 weeks |")
        print("|---|---|---|---|---|---|---|")
        events = told(nominal, recorder, year)
        print(f"| none | | | {'; '.join(map(describe, events)) or 'nothing'} | | | |")
        first = right = wrong = 0
        for _ in range(places):
            reading = str(rng.choice(list(COLUMNS)))
            size = 5.0 if rng.random() < 0.5 else -5.0
            line = int(rng.integers(int(EDGE * hours), int((1 - EDGE) * hours)))
            copy = work / "shifted.csv"
            shifted(year, copy, COLUMNS[reading], line, size)
            events = told(nominal, recorder, copy)
            best = events[0] if events else None
            named = best is not None and set(best["components"]) <= CLASS
            dated = best is not None and abs(best["onset_line"] - line) <= FORTNIGHT
            first, right = first + named, right + (named and dated)
            wrong += any(not set(event["components"]) & CLASS for event in events)
            print(
                f"| {reading} | {size:+.0f} | {line} | {describe(best) if best else 'nothing'} "
                f"| {best['onset_line'] if best else ''} | {'yes' if named else 'no'} | {'yes' if dated else 'no'} |"
            )
        print(f"\nclass first in {first} of {places}, and dated within two weeks in {right}; something else in {wrong}")


def describe(event: dict) -> str:
    return f"{' or '.join(event['components'])} ({event['kind']}, {event['probability']:.2f}, {event['verdict']})"


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]]
    main(*given, *(20, 1, 2011, 2012)[len(given) :])
