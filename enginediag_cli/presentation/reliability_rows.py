"""Trials of isolation as one document, as rows, and as tables for people."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from enginediag_cli import __version__
from enginediag_cli.presentation.outputs.prove import ISOLATED
from enginediag_cli.presentation.score_sheet_rows import met
from enginediag_cli.trials.isolated.reliability import by_kind, reliability, sheet
from enginediag_cli.trials.isolated.score import OUTCOMES
from enginediag_cli.trials.isolated.trial import Plan

LONG = ISOLATED.names


def document(plan: Plan, records: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sheet, reliability tables and outcomes by kind, and what was run."""
    return {
        "schema": ISOLATED.id,
        "sheet": sheet(records),
        "reliability": reliability(records),
        "kinds": by_kind(records),
        "engines": {e: by_kind([r for r in records if r["engine"] == e])["all"] for e in _engines(records)},
        "trials": len(records),
        "failed_records": sum(r["failed_records"] for r in records),
        "seed": plan.seed,
        "truths": list(plan.truths),
        "chosen_kinds": list(plan.kinds),
        "engine_files": [Path(e).name for e in plan.engines],
        "versions": {"enginediag": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
    }


def _engines(records: Sequence[Mapping[str, Any]]) -> list[str]:
    return sorted({r["engine"] for r in records})


def rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row per score, then per bin of stated probability and kind, then per kind and outcome."""
    return [*_sheet_rows(found), *_bin_rows(found), *_outcome_rows(found)]


def _sheet_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for name, entry in found["sheet"].items():
        target = entry["target"] or ""
        yield {"table": "sheet", "score": name, **_numbers(entry), "target": target, "met": met(entry["rate"], target)}


def _bin_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for kind, own in found["reliability"].items():
        for b in own:
            place = {"kind": kind, "bin": f"{b['from']:g} to {b['to']:g}", "stated": b["stated"], "gap": b["gap"]}
            yield {"table": "reliability", "score": "right", **place, **_numbers(b)}


def _outcome_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for kind, own in found["kinds"].items():
        for name in OUTCOMES:
            yield {
                "table": "outcomes",
                "score": name,
                "kind": kind,
                "count": own["outcomes"][name],
                "of": own["trials"],
            }
        for name, entry in own.items():
            if isinstance(entry, Mapping) and "rate" in entry and entry["of"]:
                yield {"table": "kinds", "score": name, "kind": kind, **_numbers(entry)}


def _numbers(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {k: entry[k] for k in ("rate", "count", "of", "low", "high")}


def tables(found: Mapping[str, Any]) -> list[list[dict[str, Any]]]:
    """Sheet with targets, reliability, outcomes by kind and by engine."""
    scores = [
        {
            "score": name,
            "rate": cell(entry),
            "target": (entry["target"] or "").replace(">=", "≥").replace("<=", "≤"),
            "met": met(entry["rate"], entry["target"] or ""),
        }
        for name, entry in found["sheet"].items()
        if entry["of"]
    ]
    bins = [
        {
            "names of": kind,
            "stated": f"{b['from']:g} to {b['to']:g}",
            "mean stated": f"{b['stated']:.3f}",
            "right": cell(b),
            "gap": f"{b['gap']:+.3f}",
        }
        for kind, own in found["reliability"].items()
        for b in own
    ]
    return [scores, bins, _outcomes(found["kinds"], "kind"), _outcomes(found["engines"], "engine")]


def _outcomes(groups: Mapping[str, Any], what: str) -> list[dict[str, Any]]:
    return [
        {
            what: group,
            "trials": own["trials"],
            **{name: own["outcomes"][name] for name in OUTCOMES},
            **{n: cell(own[n]) for n in ("right_name", "exact", "covered", "interval", "false_sensor")},
        }
        for group, own in groups.items()
    ]


def cell(entry: Mapping[str, Any]) -> str:
    """A rate with its interval and what it is of."""
    if not entry["of"]:
        return ""
    if entry["low"] is None:
        return f"{entry['rate']:.3f} n {entry['of']}"
    return f"{entry['rate']:.3f} ({entry['low']:.3f}–{entry['high']:.3f}) n {entry['of']}"
