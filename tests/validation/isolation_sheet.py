"""Blind trials of isolation as Markdown tables: python tests/validation/isolation_sheet.py SHEET [--reliability]

SHEET: what `enginediag prove --question isolate --format json` wrote. Counts with Wilson 95 % intervals beside the
targets, and what came of every kind of trials; `--reliability`: stated probabilities against how often they are right.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from typing import Any

from enginediag_cli.validation.isolation_trials import OUTCOMES

DIFFERENCE, GAP = "right_less_stated_when_probable", "largest_gap"
ROWS = {
    "false_alarm": ("false alarms of healthy flights", "≤ 3 of 80"),
    "exact_fault": ("exactly the truth, of all faults", "≥ 55 %"),
    "exact_instrument": ("exactly the truth, of faults of instruments", "≥ 70 %"),
    "covered_fault": ("the truth in answer and alternatives, of all faults", "≥ 95 %"),
    GAP: ("right less stated, the bin furthest off", "within 8 points"),
    "right_when_sure": ("stated at least 0.9 and right", "≥ 88 %"),
    DIFFERENCE: ("right less stated, where 0.7 to 0.9 is stated", "within 7 points"),
    "false_name": ("something named where nothing had changed", "≤ 5 %"),
    "false_sensor": ("an output sensor named that was right", "≤ 3 %"),
    "false_input": ("an input channel named that was right", ""),
    "interval": ("intervals that hold", "≥ 90 %"),
    "covered": ("the truth in answer and alternatives", "≥ 95 %"),
    "exact": ("exactly the truth", ""),
    "cannot_tell": ('"cannot tell"', ""),
    "no_verdict": ("no verdict", ""),
}

Sheet = Mapping[str, Any]


def counted(name: str, own: Mapping[str, Any]) -> str:
    if not own["of"]:
        return "–"
    if name in (DIFFERENCE, GAP):
        points = [f"{100 * own[n]:+.0f}" for n in ("rate", "low", "high")]
        return f"{points[0]} points ({points[1]} to {points[2]}, of {own['of']})"
    return f"{own['count']} of {own['of']} ({100 * own['low']:.0f}–{100 * own['high']:.0f} %)"


def scores(found: Sheet) -> None:
    print("| | found | aimed at |\n|---|---|---|")
    for name, (words, target) in ROWS.items():
        print(f"| {words} | {counted(name, found['sheet'][name])} | {target} |")
    print(f"\n| kind | trials | {' | '.join(OUTCOMES)} | exact | in answer and alternatives | intervals |")
    print("|---" * (len(OUTCOMES) + 5) + "|")
    for kind, own in found["kinds"].items():
        rates = " | ".join(f"{own[n]['count']} of {own[n]['of']}" for n in ("exact", "covered", "interval"))
        came = " | ".join(str(own["outcomes"][o]) for o in OUTCOMES)
        print(f"| {kind.replace('_', ' ')} | {own['trials']} | {came} | {rates} |")


def reliable(found: Sheet) -> None:
    print("| of | stated | on average | right |\n|---|---|---|---|")
    for kind, bins in found["reliability"].items():
        for b in bins:
            stated = f"{b['from']:g} to {b['to']:g} | {b['stated']:.2f}"
            print(f"| {kind.replace('_', ' ')} | {stated} | {counted(kind, b)} |")


def main() -> None:
    with open(sys.argv[1], encoding="utf-8") as stream:
        sheet = json.load(stream)
    (reliable if "--reliability" in sys.argv[2:] else scores)(sheet)


if __name__ == "__main__":
    main()
