"""The C-MAPSS fleet along life: python tests/real_runs/fleet_life.py DETECTED ISOLATED

What `detect --window 20` and `isolate --window 20 --by component` wrote. Markdown table: by the share of life at the
middle of the window, how many windows are called faulty and how many are isolated to the HPC alone.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable

from windows import Row, rows

REFERENCE = 20
"""Flights at the beginning of life that every window is judged against."""


def life(detected: str, isolated: str) -> None:
    judged, answered = rows(detected), rows(isolated)
    first, last = {}, {}
    for row in judged:
        first.setdefault(row["engine"], int(row["first_line"]) - REFERENCE)
        last[row["engine"]] = int(row["last_line"])

    def tenth(row: Row) -> int:
        begin, end = first[row["engine"]], last[row["engine"]]
        middle = (int(row["first_line"]) + int(row["last_line"])) / 2
        return min(int(10 * (middle - begin) / (end - begin + 1)), 9)

    def shares(found: Iterable[Row], yes: Callable[[Row], bool]) -> dict[int, float]:
        by: defaultdict[int, list[bool]] = defaultdict(list)
        for row in found:
            by[tenth(row)].append(yes(row))
        return {t: sum(v) / len(v) for t, v in sorted(by.items())}

    table = {
        "`detect`, without allowance for model error": shares(judged, lambda r: r["verdict"] == "fault"),
        "`isolate`: fault": shares(answered, lambda r: r["verdict"] == "fault"),
        "… and the HPC alone": shares(answered, lambda r: r["components"] == "hpc" and r["verdict"] == "fault"),
    }
    tenths = sorted(set().union(*table.values()))
    print("| share of life | " + " | ".join(f"{10 * t}–{10 * t + 10} %" for t in tenths) + " |")
    print("|---" * (1 + len(tenths)) + "|")
    for title, found in table.items():
        print(f"| {title} | " + " | ".join(f"{found[t]:.2f}" if t in found else "" for t in tenths) + " |")


if __name__ == "__main__":
    life(*sys.argv[1:3])
