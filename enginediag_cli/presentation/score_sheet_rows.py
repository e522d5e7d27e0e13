"""The score sheet as rows: for people, and for CSV."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from enginediag_cli.presentation.outputs.prove import PROVE
from enginediag_cli.trials.blind import kinds

LONG = PROVE.names


def rows(sheet: Mapping[str, Any], bins: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row per score, truth and kind of trials, kind "" being the score's headline, then one per bin."""
    found = [row for name in sheet for row in _score_rows(name, sheet[name])]
    for truth, by in bins.items():
        for what, own in by.items():
            for b in own:
                place = {"truth": truth, "kind": "", "bin": f"{what} {_span(b)}", "target": "", "met": ""}
                if "rate" in b:  # reliability of stated probabilities: one rate a bin
                    found.append({"score": "stated", **place, **_numbers(b)})
                found += [
                    {"score": n, **place, **_numbers(x)}
                    for n, x in b.items()
                    if isinstance(x, Mapping) and "rate" in x and x["of"]
                ]
    return found


def bin_rows(bins: Mapping[str, Any], what: str) -> list[dict[str, Any]]:
    """One row per truth and bin of λ, λ_sep or signal to noise: rates with the trials that they are of."""
    found = []
    for truth, by in bins.items():
        for b in by[what]:
            cells = {
                n: f"{x['rate']:.2f} of {x['of']}" if x["of"] else ""
                for n, x in b.items()
                if isinstance(x, Mapping) and "rate" in x
            }
            found.append({"truth": truth, what: _span(b), "trials": b["trials"], **cells})
    return found


def _numbers(entry: Mapping[str, Any]) -> dict[str, Any]:
    return {k: entry[k] for k in ("rate", "count", "of", "low", "high")}


def _span(b: Mapping[str, Any]) -> str:
    return f"{b['from']:g} and more" if b["to"] is None else f"{b['from']:g} to {b['to']:g}"


def _score_rows(name: str, entry: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for truth in _truths(entry):
        own = entry[truth]
        target = own["target"] or ""
        if own["of"]:
            yield {
                "score": name,
                "truth": truth,
                "kind": "",
                "bin": "",
                **_numbers(own),
                "target": target,
                "met": met(own["rate"], target),
            }
        for kind, other in own["kinds"].items():
            yield {"score": name, "truth": truth, "kind": kind, "bin": "", **other, "target": "", "met": ""}


def met(value: float | None, target: str) -> str:
    """Whether the rate itself, not its interval, meets a target: "yes", "no", or "" without one."""
    if not target or value is None:
        return ""
    if " to " in target:
        low, high = map(float, target.split(" to "))
        return "yes" if low <= value <= high else "no"
    sign, limit = target.split()
    if sign == "within":
        return "yes" if abs(value) <= float(limit) else "no"
    return "yes" if (value >= float(limit) if sign == ">=" else value <= float(limit)) else "no"


def table(sheet: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Headlines only: rate with its interval in a cell, truths side by side."""
    found = []
    for name, entry in sheet.items():
        row: dict[str, Any] = {"score": name, "trials": _kinds(entry["headline"])}
        for truth in _truths(entry):
            own = entry[truth]
            target = own["target"] or ""
            row[truth] = _cell(own)
            words = target.replace(">=", "≥").replace("<=", "≤")
            row[f"target {truth}"] = f"{words} {met(own['rate'], target)}".strip()
        found.append(row)
    return [r for r in found if any(r.get(truth) for truth in kinds.TRUTHS)]


def _truths(entry: Mapping[str, Any]) -> list[str]:
    return [truth for truth in kinds.TRUTHS if truth in entry]


def _kinds(headline: list[str]) -> str:
    if len(headline) == 1:
        return headline[0]
    whole = tuple(headline) == kinds.beside(headline[0])
    return (kinds.choice(headline[0]) or "all") if whole else "with something in it"


def _cell(entry: Mapping[str, Any]) -> str:
    if not entry["of"]:
        return ""
    if entry["low"] is None:
        return f"{entry['rate']:.3f} n {entry['of']}"
    return f"{entry['rate']:.3f} ({entry['low']:.3f}–{entry['high']:.3f}) n {entry['of']}"


def size_rows(sizes: Mapping[str, Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Detectable sizes over typical ones, what the floor costs most first."""

    def cost(e: Mapping[str, Any]) -> float:
        without, with_floor = e["without_floor"], e["with_floor"]
        return float("inf") if with_floor is None and without else (with_floor or 1.0) / (without or 1.0)

    ordered = sorted(sizes.items(), key=lambda item: -cost(item[1]))
    return [
        {
            "effect": label,
            "unit": e["unit"],
            "detectable without floor": e["without_floor"],
            "with floor": e["with_floor"],
            "over typical": e["without_floor_over_typical"],
            "with floor, over typical": e["with_floor_over_typical"],
        }
        for label, e in ordered
    ]
