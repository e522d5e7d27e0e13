"""What the commands wrote, counted: Markdown tables for the documents.

    python tests/real_runs/windows.py answers ISOLATED…     every answer, by how often it was given
    python tests/real_runs/windows.py alarms ISOLATED…      the windows whose verdict is not `healthy`, one a row
    python tests/real_runs/windows.py detectable DETECTED…  median over windows of the smallest detectable changes

ISOLATED is what `isolate` wrote, by parameter or by component; DETECTED what `detect --detectable` wrote.
"""

from __future__ import annotations

import csv
import sys
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import median

Row = Mapping[str, str]
MOST = 8
"""Answers told of a file, most frequent first; how many others there were is told, too."""


def rows(path: str) -> list[Row]:
    """Rows of a CSV that a command wrote."""
    with open(path, encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(line for line in stream if not line.startswith("#")))


def windows(path: str) -> list[list[Row]]:
    """Rows of each window, in the order of the file; `isolate` writes one per parameter."""
    found: defaultdict[tuple[str, ...], list[Row]] = defaultdict(list)
    for row in rows(path):
        found[tuple(row[c] for c in ("source", "flight", "engine", "first_line"))].append(row)
    return list(found.values())


def named(window: Sequence[Row]) -> list[str]:
    """Parameters or components of the answer; none where nothing stands out."""
    column = "components" if "components" in window[0] else "isolated"
    return [w for w in window[0][column].replace(" & ", "; ").split("; ") if w]


def answer(window: Sequence[Row]) -> str:
    told = " + ".join(sorted(named(window))) or "no significant change"
    verdict = window[0]["verdict"]
    return told if verdict == "fault" else f"{told} ({verdict})"


def answers(paths: Sequence[str]) -> None:
    print("| file | windows | answer (how often) |\n|---|---|---|")
    for path in paths:
        judged = [w for w in windows(path) if w[0]["verdict"] != "no verdict"]
        counted = Counter(answer(w) for w in judged).most_common()
        told = "; ".join(f"{name} {count}" for name, count in counted[:MOST])
        if len(counted) > MOST:
            told += f"; others {sum(count for _, count in counted[MOST:])}"
        print(f"| `{Path(path).name}` | {len(judged)} | {told} |")


def alarms(paths: Sequence[str]) -> None:
    print("| file | lines | verdict | answer | probability of exactly this | lack of fit |\n|---|---|---|---|---|---|")
    for path in paths:
        for w in windows(path):
            first = w[0]
            if first["verdict"] in ("healthy", "no verdict"):
                continue
            told = "; ".join(change(r) for r in w if r.get("change")) or answer(w)
            print(
                f"| `{Path(path).name}` | {first['first_line']}–{first['last_line']} | {first['verdict']} | {told} "
                f"| {float(first['probability']):.2f} | {float(first['fit']):.2g} |"
            )


def change(row: Row) -> str:
    """A parameter's change with its 95 % interval, in per cent of nominal or in its unit, and how probable it is."""
    probable = f"probability {float(row['inclusion']):.2f}"
    if not row["lower"]:  # an instrument that is stuck or scatters has a size without an interval
        return f"{row['parameter']} {float(row['change']):.3g} {row['unit']} ({probable})"
    size, low, high = (float(row[c]) for c in ("change", "lower", "upper"))
    if row["percent"]:
        scale = float(row["percent"]) / size if size else 100.0
        return f"{row['parameter']} {scale * size:+.1f} % ({scale * low:+.1f} to {scale * high:+.1f}; {probable})"
    return f"{row['parameter']} {size:+.3g} {row['unit']} ({low:+.3g} to {high:+.3g}; {probable})"


def detectable(paths: Sequence[str]) -> None:
    print("| file | parameter | smallest change that is seen, median |\n|---|---|---|")
    for path in paths:
        found: defaultdict[str, list[float]] = defaultdict(list)
        for row in rows(path):
            for column, value in row.items():
                if column.startswith("detectable:") and value:
                    found[column.removeprefix("detectable:")].append(float(value))
        for name, values in found.items():
            print(f"| `{Path(path).name}` | {name} | {100 * median(values):.1f} % |")


def main() -> None:
    what, *paths = sys.argv[1:]
    {"answers": answers, "alarms": alarms, "detectable": detectable}[what](paths)


if __name__ == "__main__":
    main()
