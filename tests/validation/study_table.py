"""A study as Markdown tables: python tests/validation/study_table.py STUDY [--methods-down | --reliability …]

Runs `enginediag study STUDY --format json` (or reads what it wrote, `--result FILE`) and prints exact isolation in per
cent with Clopper–Pearson 95 % intervals, one row per case; `--methods-down`: counts, one row per method. Healthy cases
tell false alarms; methods that name no parameter tell how many faults they saw. `--reliability`: stated probability
against how often it was right, of one method. `--times`: CPU time per diagnosis, which is the machine's.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import Any

PAPER = {"1": 96.8, "2": 89.2, "3": 55.1, "4": 0.0}
"""Exact isolation in % that the paper's section 5 tells of its incremental algorithm, by case."""

Entry = Mapping[str, Any]


def result(options: argparse.Namespace) -> Mapping[str, Any]:
    if options.result:
        with open(options.result, encoding="utf-8") as stream:
            return dict(json.load(stream))
    command = [sys.executable, "-m", "enginediag_cli", "study", options.study, "--format", "json", "-q"]
    done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True, encoding="utf-8")
    return dict(json.loads(done.stdout))


def percent(rate: Entry) -> str:
    return f"{100 * rate['rate']:.1f} ({100 * rate['low']:.1f}–{100 * rate['high']:.1f})"


def cell(e: Entry) -> str:
    """Exact isolation; of a healthy case false alarms; of a method that names nothing what it detected."""
    if e["unchanged"] == e["repetitions"]:
        return percent(e["false_alarm_rate"])
    if e["exact_rate"] is None:
        return f"seen: {percent(e['detected_rate'])}"
    return percent(e["exact_rate"])


def count(e: Entry) -> str:
    """As `cell`, as counts; faults that were not detected are told where there are any."""
    if e["unchanged"] == e["repetitions"]:
        return f"{e['false_alarms']} alarms"
    seen = e["detected"] - e["false_alarms"]
    missed = "" if seen == e["repetitions"] - e["unchanged"] else f"seen in {seen}"
    return missed or "seen" if e["exact"] is None else f"{e['exact']}{f', {missed}' if missed else ''}"


def table(entries: Sequence[Entry], paper: bool) -> None:
    cases, methods = (list(dict.fromkeys(e[what] for e in entries)) for what in ("case", "method"))
    by = {(e["case"], e["method"]): e for e in entries}
    print(f"| case (repetitions) |{' paper |' * paper} " + " | ".join(m.replace("_", " ") for m in methods) + " |")
    print("|---" * (1 + paper + len(methods)) + "|")
    for case in cases:
        first = by[case, methods[0]]
        told = f" {PAPER[case]:g} |" if case in PAPER else " – |"
        words = f"{case}{', false alarms' * (first['unchanged'] == first['repetitions'])}"
        cells = " | ".join(cell(by[case, m]) for m in methods)
        print(f"| {words} ({first['repetitions']}) |{told * paper} {cells} |")


def methods_down(entries: Sequence[Entry]) -> None:
    cases, methods = (list(dict.fromkeys(e[what] for e in entries)) for what in ("case", "method"))
    by = {(e["case"], e["method"]): e for e in entries}
    print("| method | " + " | ".join(f"{c} (of {by[c, methods[0]]['repetitions']})" for c in cases) + " |")
    print("|---" * (1 + len(cases)) + "|")
    for m in methods:
        print(f"| {m.replace('_', ' ')} | " + " | ".join(count(by[c, m]) for c in cases) + " |")


def reliability(entries: Sequence[Entry], method: str) -> None:
    print("| stated, mean | answers | right, % |\n|---|---|---|")
    for e in entries:
        for b in e.get("reliability", ()) if e["method"] == method else ():
            print(f"| {b['stated']:.2f} | {b['answers']} | {percent(b)} |")


def times(entries: Sequence[Entry]) -> None:
    print("| method | CPU time per diagnosis, ms |\n|---|---|")
    for m in dict.fromkeys(e["method"] for e in entries):
        own = [1e3 * e["seconds_per_diagnosis"] for e in entries if e["method"] == m]
        print(f"| {m.replace('_', ' ')} | {min(own):.2g} to {max(own):.2g} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study")
    parser.add_argument("--result", help="JSON that `study --format json` wrote")
    parser.add_argument("--methods-down", action="store_true")
    parser.add_argument("--paper", action="store_true", help="with what the paper tells of the same cases")
    parser.add_argument("--reliability", metavar="METHOD")
    parser.add_argument("--only", metavar="METHOD,…", help="these methods alone")
    parser.add_argument("--times", action="store_true")
    options = parser.parse_args()
    entries = result(options)["cases"]
    if options.only:
        entries = [e for e in entries if e["method"] in options.only.split(",")]
    if options.times:
        times(entries)
    elif options.reliability:
        reliability(entries, options.reliability)
    elif options.methods_down:
        methods_down(entries)
    else:
        table(entries, options.paper)


if __name__ == "__main__":
    main()
