"""False alarms in a fleet's early life: python tests/real_runs/fleet_shuffled.py NOMINAL FLEET [SHUFFLES]

Each engine's first 40 flights of the C-MAPSS fleet FD001 are put in a random order, so that no wear lies between the
20 that are the reference and the 20 that are judged; `detect` at its false-alarm probability of 0.01 then counts.
"""

from __future__ import annotations

import csv
import gzip
import random
import sys
import tempfile
from itertools import groupby
from pathlib import Path

from ground_recordings import CONFIGS, enginediag, table

EARLY = 40
RECORDER = CONFIGS / "recorders" / "cmapss.yaml"
REFERENCE = ("--reference", "20", "--window", "20")


def shuffled(fleet: Path, folder: Path, seed: int) -> Path:
    """The first flights of every engine in a random order, numbered as they then come."""
    with gzip.open(fleet, "rt", encoding="utf-8", newline="") as stream:
        head, *rows = list(csv.reader(stream))
    engine, cycle = 0, 1
    path, draw = folder / f"shuffled_{seed}.csv", random.Random(seed)
    with path.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        for _, own in groupby(rows, key=lambda row: row[engine]):
            early = list(own)[:EARLY]
            numbers = [row[cycle] for row in early]
            draw.shuffle(early)
            for number, row in zip(numbers, early, strict=True):
                row[cycle] = number
            writer.writerows(early)
    return path


def main() -> None:
    nominal, fleet = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
    shuffles = int(sys.argv[3]) if len(sys.argv) > 3 else 10
    alarms = judged = 0
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(shuffles):
            path = shuffled(fleet, Path(folder), seed)
            out, _ = enginediag("detect", "-n", nominal, path, "--recorder", RECORDER, *REFERENCE)
            verdicts = [row["verdict"] for row in table(out)]
            alarms, judged = alarms + verdicts.count("fault"), judged + len(verdicts)
    print(
        f"flights 21–40 with the first 40 of each engine shuffled, {shuffles} times: {alarms} of {judged} called faulty"
    )


if __name__ == "__main__":
    main()
