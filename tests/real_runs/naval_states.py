"""Answers of `isolate --by component` for the naval gas generator's states, by how far they have decayed.

    python tests/real_runs/naval_states.py STATES ISOLATED

STATES: recording with its kMc and kMt (decay of compressor and turbine); ISOLATED: what `isolate` wrote of it, one
window per state. Markdown table.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter

CLASSES = {
    "kMc ≥ 0.992, kMt ≥ 0.996": lambda c, t: c >= 0.992 and t >= 0.996,
    "kMc ≤ 0.97, kMt ≥ 0.996": lambda c, t: c <= 0.97 and t >= 0.996,
    "kMc ≥ 0.992, kMt ≤ 0.985": lambda c, t: c >= 0.992 and t <= 0.985,
    "kMc ≤ 0.97, kMt ≤ 0.985": lambda c, t: c <= 0.97 and t <= 0.985,
    "kMc 0.972–0.99, kMt ≤ 0.985": lambda c, t: 0.972 <= c <= 0.99 and t <= 0.985,
}
"""What is nearly new, one part decayed, and both."""


def rows(path: str) -> list[dict[str, str]]:
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def answer(row: dict[str, str]) -> str:
    """The components named, and the verdict where it is another than `fault`."""
    named = " + ".join(sorted(c.replace("_", " ") for c in row["components"].split("; ") if c)) or "nothing"
    return named if row["verdict"] == "fault" else f"{named} ({row['verdict']})"


def main() -> None:
    states, isolated = rows(sys.argv[1]), rows(sys.argv[2])
    found = [(states[int(r["first_line"]) - 2], answer(r)) for r in isolated]
    print(f"| state (of {len(isolated)}) | states | named (how often) |\n|---|---|---|")
    for title, inside in CLASSES.items():
        own = [named for state, named in found if inside(float(state["kMc"]), float(state["kMt"]))]
        told = "; ".join(f"{named} {count}" for named, count in Counter(own).most_common())
        print(f"| {title} | {len(own)} | {told} |")


if __name__ == "__main__":
    main()
