"""Is it right as often as it says? The reliability tables of isolation, and its score sheet with targets."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.validation.blind.sheet import PROBABLE, PROBABLE_TARGET, SURE, SURE_TARGET, right_less_stated
from enginediag_cli.validation.isolated import kinds
from enginediag_cli.validation.isolated.score import OUTCOMES
from enginediag_cli.validation.rates import rate, wilson

Record = Mapping[str, Any]

PROBABILITY_BINS = (0.0, 0.5, 0.7, 0.9, 1.0)
"""Edges of the stated probabilities whose truth is counted: below even, doubtful, probable, sure."""
ALL = "all"
LEAST_NAMES = 10
"""Names in a bin below which its gap is chance: ten that are right three times in four have a standard error of 14
points, already more than the gap that is aimed at."""


@dataclass(frozen=True)
class Score:
    """A line of the sheet: what is counted over which records, its target in words ("" for none)."""

    of: Callable[[Sequence[Record]], dict[str, Any]]
    target: str = ""


def mark(name: str, kind: str = "") -> Callable[[Sequence[Record]], dict[str, Any]]:
    """Rate of a mark over the trials that have it, of one kind or of all; those of a group share an engine."""

    def counted(records: Sequence[Record]) -> dict[str, Any]:
        own = [r for r in records if name in r["marks"] and (not kind or r["kind"] == kind)]
        return rate((r["marks"][name] for r in own), (r.get("group", k) for k, r in enumerate(own)))

    return counted


def _sure(records: Sequence[Record]) -> dict[str, Any]:
    return rate(right for p, right in stated(records) if p >= SURE)


def _probable(records: Sequence[Record]) -> dict[str, Any]:
    return right_less_stated(stated(records), PROBABLE, SURE)


def _gap(records: Sequence[Record]) -> dict[str, Any]:
    """The bin of stated probability, of at least so many names, whose truth is furthest from what is stated: right less
    stated, with the interval of what is right."""
    rows = [b for b in _bins(stated(records)) if b["of"] >= LEAST_NAMES]
    if not rows:
        return {"rate": None, "count": 0, "of": 0, "low": None, "high": None}
    worst = max(rows, key=lambda b: abs(b["gap"]))
    low, high = worst["low"] - worst["stated"], worst["high"] - worst["stated"]
    return {"rate": worst["gap"], "count": worst["count"], "of": worst["of"], "low": low, "high": high}


SCORES: Mapping[str, Score] = {
    "false_alarm": Score(mark("false_alarm"), "<= 0.0375"),
    "exact_fault": Score(mark("exact_fault"), ">= 0.55"),
    "exact_instrument": Score(mark("exact_instrument"), ">= 0.70"),
    "covered_fault": Score(mark("covered_fault"), ">= 0.95"),
    "largest_gap": Score(_gap, "within 0.08"),
    "right_when_sure": Score(_sure, SURE_TARGET),
    "right_less_stated_when_probable": Score(_probable, PROBABLE_TARGET),
    "false_name": Score(mark("false_name"), "<= 0.05"),
    "false_sensor": Score(mark("false_sensor"), "<= 0.03"),
    "false_input": Score(mark("false_input")),
    "interval": Score(mark("interval"), ">= 0.90"),
    "covered": Score(mark("covered"), ">= 0.95"),
    "exact": Score(mark("exact")),
    "right_name": Score(mark("right_name")),
    "found": Score(mark("found")),
    "cannot_tell": Score(mark("cannot_tell")),
    "no_verdict": Score(mark("no_verdict")),
    "not_identified": Score(mark("not_identified")),
}


def stated(records: Sequence[Record], what: str = "stated") -> list[tuple[float, bool]]:
    """Stated probability of every name, and whether it is right."""
    return [(float(p), bool(right)) for p, right in (r["marks"][what] for r in records if what in r["marks"])]


def sheet(records: Sequence[Record]) -> dict[str, Any]:
    """Every score over all trials, and by truth."""
    found = {}
    for name, score in SCORES.items():
        by = {t: score.of([r for r in records if r["truth"] == t]) for t in kinds.TRUTHS}
        found[name] = score.of(records) | {t: v for t, v in by.items() if v["of"]} | {"target": score.target or None}
    return found


def by_kind(records: Sequence[Record]) -> dict[str, Any]:
    """Outcomes and rates of every kind of trials, and of all."""
    found: dict[str, Any] = {}
    for kind in (*kinds.KINDS, ALL):
        own = [r for r in records if kind in (ALL, r["kind"])]
        if own:
            came = Counter(r["outcome"] for r in own)
            rates = {n: SCORES[n].of(own) for n in ("right_name", "exact", "covered", "interval", "false_sensor")}
            found[kind] = {"trials": len(own), "outcomes": {o: came[o] for o in OUTCOMES}, **rates}
    return found


def reliability(records: Sequence[Record]) -> dict[str, list[dict[str, Any]]]:
    """Stated probability against how often it is right: of all names, of those of every kind of trials, of classes
    that hold the truth or not, of the answer that nothing has changed, and of every named place that it changed."""
    found = {ALL: _bins(stated(records))}
    for kind in kinds.KINDS:
        found[kind] = _bins(stated([r for r in records if r["kind"] == kind]))
    found["class"] = _bins(stated(records, "stated_class"))
    found["nothing"] = _bins(stated(records, "stated_nothing"))
    found["changed"] = _bins([(p, right) for r in records for p, right in r["marks"].get("stated_changed", ())])
    return {kind: rows for kind, rows in found.items() if rows}


def _bins(said: Sequence[tuple[float, bool]]) -> list[dict[str, Any]]:
    rows = []
    for low, high in pairwise(PROBABILITY_BINS):
        own = [(p, right) for p, right in said if low <= p < high or (high == 1.0 and p >= 1.0)]
        if own:
            right, n = sum(bool(r) for _, r in own), len(own)
            least, most = wilson(right, n)
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "stated": float(np.mean([p for p, _ in own])),
                    "rate": right / n,
                    "gap": right / n - float(np.mean([p for p, _ in own])),
                    "count": right,
                    "of": n,
                    "low": least,
                    "high": most,
                }
            )
    return rows
