"""When the two engines of the Citation departed from their nominal, and whether they agree.

    python tests/real_runs/citation_states.py LEFT RIGHT

What `detect --window 10s` wrote of flight b22 for each engine. Markdown table: starts of the 10 s records judged, by
the steps of fuel flow and ITT in the raw recording; then agreement record by record.
"""

from __future__ import annotations

import csv
import sys
from collections.abc import Mapping
from itertools import pairwise

STEPS_S = (0, 1476, 2337, 2626, 3660, 4051, 10_000)
"""Raw steps of both engines' fuel flow and ITT in flight b22: off, on, off, on, off."""

STATES = ("departed", "as nominal")
RECORD_S = 10

Rows = Mapping[int, Mapping[str, str]]
"""Start of each judged record in s: its row."""


def judged(path: str) -> Rows:
    with open(path, encoding="utf-8", newline="") as stream:
        found = csv.DictReader(line for line in stream if not line.startswith("#"))
        return {round(float(r["start_s"])): r for r in found if r["verdict"] != "no verdict"}


def cell(rows: Rows, begin: int, end: int) -> str:
    """Judged records that begin within a state: first to last, verdicts, range of the statistic."""
    own = {t: r for t, r in rows.items() if begin <= t < end}
    if not own:
        return "not judged"
    faults = sum(r["verdict"] == "fault" for r in own.values())
    statistic = [float(r["statistic"]) for r in own.values()]
    return f"{min(own)}–{max(own)}: {faults} of {len(own)} fault, statistic {min(statistic):.2g}–{max(statistic):.2g}"


def main() -> None:
    left, right = (judged(path) for path in sys.argv[1:3])
    print("| raw state | from step to step, s | left: judged records | right |\n|---|---|---|---|")
    for k, (begin, end) in enumerate(pairwise(STEPS_S)):
        span = f"{begin}–{end}" if k < len(STEPS_S) - 2 else f"{begin} on"
        print(f"| {STATES[k % 2]} | {span} | {cell(left, begin, end)} | {cell(right, begin, end)} |")
    both = sorted(set(left) & set(right))
    apart = [t for t in both if left[t]["verdict"] != right[t]["verdict"]]
    threshold = float(next(iter(left.values()))["threshold"])
    where = f"; not at {', '.join(f'{t} s' for t in apart)}" if apart else ""
    print(f"| same verdict | threshold {threshold:.3g} | {len(both) - len(apart)} of {len(both)} records{where} | |")


if __name__ == "__main__":
    main()
