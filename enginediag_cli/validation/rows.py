"""Trials and studies as rows, documents and tables.

Trials of isolation as one document, as rows, and as tables for people.

The score sheet as rows: for people, and for CSV.

The whole result of `prove` as one JSON object.

What a study found, as rows and as JSON: counts, and rates with intervals that hold between seeds, by batches.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from enginediag_cli import __version__
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.tables.trials import ISOLATED, PROVE, STUDY
from enginediag_cli.validation import kinds
from enginediag_cli.validation.explain_trials import Plan as TrialPlan
from enginediag_cli.validation.isolation_trials import OUTCOMES, Plan, by_kind, reliability, sheet
from enginediag_cli.validation.score_sheet import bins, detectable_sizes, truths_of
from enginediag_cli.validation.score_sheet import sheet as trials_sheet
from enginediag_cli.validation.studies import Study
from enginediag_cli.validation.study_runs import BLOCK, EDGES, Finished, Tally
from enginediag_cli.validation.trials import counted, design_effect


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


def isolation_sheet_rows(found: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row per score, then per bin of stated probability and kind, then per kind and outcome."""
    return [*_sheet_rows(found), *_bin_rows(found), *_outcome_rows(found)]


def _sheet_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for name, entry in found["sheet"].items():
        target = entry["target"] or ""
        yield {
            "table": "sheet",
            "score": name,
            **_reliability_rows_numbers(entry),
            "target": target,
            "met": met(entry["rate"], target),
        }


def _bin_rows(found: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    for kind, own in found["reliability"].items():
        for b in own:
            place = {"kind": kind, "bin": f"{b['from']:g} to {b['to']:g}", "stated": b["stated"], "gap": b["gap"]}
            yield {"table": "reliability", "score": "right", **place, **_reliability_rows_numbers(b)}


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
                yield {"table": "kinds", "score": name, "kind": kind, **_reliability_rows_numbers(entry)}


def _reliability_rows_numbers(entry: Mapping[str, Any]) -> dict[str, Any]:
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


def score_sheet_document(plan: TrialPlan, records: Sequence[Mapping[str, Any]], sizes: bool) -> dict[str, Any]:
    """Scores by name, then bins, detectable sizes, counts and what was run."""
    scores, truths = trials_sheet(records), truths_of(records)
    found: dict[str, Any] = {
        "schema": PROVE.id,
        **scores,
        "scores": list(scores),
        "bins": bins(records),
        "held_out_misfit": {t: _held_out(records, t) for t in truths},
        "trials": len(records),
        "trials_by_kind": {
            t: dict(sorted(Counter(r["kind"] for r in records if r["truth"] == t).items())) for t in truths
        },
        "unscored": sum(not r["scorer_converged"] for r in records),
        "failed_records": sum(r["failed_records"] for r in records),
        "seed": plan.seed,
        "truths": list(plan.truths),
        "kinds": list(plan.kinds),
        "model_error": {t: kinds.MODEL_ERROR[t] for t in truths},
        "false_alarm": plan.false_alarm,
        "engine": Path(plan.engine).name,
        "versions": {"enginediag": __version__, "numpy": np.__version__, "scipy": scipy.__version__},
    }
    if len(plan.engines) > 1:
        found["engines"] = [Path(e).name for e in plan.engines]
    if sizes:
        found["detectable_size"] = detectable_sizes(load_engine(plan.engine), plan.seed)
    return found


def _held_out(records: Sequence[Mapping[str, Any]], truth: str) -> dict[str, Any]:
    """Mean χ² per reading of the held-back flights of single trials: before, after, with the true effect."""
    own = [
        r["held_out"]
        for r in records
        if r["truth"] == truth and kinds.base(r["kind"]) == kinds.SINGLE and "held_out" in r
    ]
    values = {
        what: [x for h in own for x in h[what] if x is not None and np.isfinite(x)]
        for what in ("before", "after", "true")
    }
    return {what: float(np.mean(v)) if v else None for what, v in values.items()} | {"trials": len(own)}


Results = Mapping[tuple[str, str], Tally]


def totals(study: Study, finished: Finished) -> dict[tuple[str, str], Tally]:
    """Tally of every (case, method), added up in the order of the batches whoever finished first."""
    found: dict[tuple[str, str], Tally] = {}
    for batch in sorted(finished):
        for method in study.methods:
            key, one = (study.cases[batch.case].name, method), finished[batch][method]
            found[key] = found[key] + one if key in found else one
    return found


def as_json(study: Study, results: Results, seed: int) -> dict[str, Any]:
    """Everything, with counts that a script can check; `timings` alone differ from one run to the next."""
    names = study.monitor.names
    return {
        "schema": STUDY.id,
        "cases": [_entry(case, method, one, names, study.reliability) for (case, method), one in results.items()],
        "study": study.path.name,
        "engine": study.monitor.engine.name,
        "records": study.records,
        "seed": seed,
        "parameters": list(names),
        "timings": [
            {"case": case, "method": method, "seconds_per_diagnosis": _seconds(one)}
            for (case, method), one in results.items()
        ],
    }


def _seconds(x: Tally) -> float:
    """CPU time of one diagnosis."""
    return x.seconds / x.repetitions


def _entry(case: str, method: str, x: Tally, names: tuple[str, ...], reliability: bool) -> dict[str, Any]:
    named = x.isolates
    per = {name: x.of_blocks(name) for name in BLOCK}
    per["changed"], per["seen"] = per["repetitions"] - per["unchanged"], per["detected"] - per["false_alarms"]

    def found(hits: str, of: str) -> dict[str, float] | None:
        return counted(int(per[hits].sum()), int(per[of].sum()), design_effect(per[hits], per[of]))

    entry: dict[str, Any] = {
        "case": case,
        "method": method,
        "repetitions": x.repetitions,
        "no_verdict": x.repetitions - x.judged,
        "detected": x.detected,
        "exact": x.exact if named else None,
        "contained": x.contained if named else None,
        "right_size": x.right_size if named else None,
        "mean_size": x.isolated / x.judged if named and x.judged else None,
        "parameter_counts": dict(zip(names, map(int, x.counts), strict=True)) if named else None,
        "parameter_counts_contained": dict(zip(names, map(int, x.counts_contained), strict=True)) if named else None,
        "unchanged": x.unchanged,
        "false_alarms": x.false_alarms,
        "false_alarm_rate": found("false_alarms", "unchanged"),
        "detected_rate": found("seen", "changed"),
        "exact_rate": found("exact", "repetitions") if named else None,
        "contained_rate": found("contained", "repetitions") if named else None,
        "failed_records": x.failed_records,
    }
    if reliability and x.bins[:, 0].any():
        entry["reliability"] = reliability_rows(x)
    return entry


def reliability_rows(x: Tally) -> list[dict[str, Any]]:
    """Per bin of stated probability: answers, mean stated probability, how many were right, the rate."""
    study_rows = []
    for low, high, (count, right, stated) in zip(EDGES[:-1], EDGES[1:], x.bins, strict=True):
        if count:
            realised = counted(int(right), int(count)) or {}
            study_rows.append(
                {
                    "from": float(low),
                    "to": min(float(high), 1.0),
                    "answers": int(count),
                    "stated": stated / count,
                    "right": int(right),
                    **realised,
                }
            )
    return study_rows


def study_rows(study: Study, results: Results, show: str) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
    """Rows and columns of one table: "rates", "counts" per parameter as in the paper, or "reliability"."""
    found: list[dict[str, Any]] = []
    for (case, method), x in results.items():
        entry = _entry(case, method, x, study.monitor.names, False)
        place = {"case": case, "method": method}
        if show == "rates":
            found.append(STUDY.row(place | _rates(entry) | {"seconds_per_diagnosis": _seconds(x)}))
        elif show == "counts":
            found.append(place | {"repetitions": x.repetitions} | (entry["parameter_counts"] or {}))
        else:
            found += [place | row for row in reliability_rows(x)]
    columns = ("case", "method", "repetitions", *study.monitor.names) if show == "counts" else ()
    return found, columns or tuple(found[0]) if found else ()


def _rates(entry: Mapping[str, Any]) -> dict[str, Any]:
    row = {"repetitions": entry["repetitions"], "no_verdict": entry["no_verdict"]}
    for what in ("detected", "false_alarm", "exact", "contained"):
        found = entry[f"{what}_rate"]
        row[what] = found["rate"] if found else None
        row[f"{what}_low"], row[f"{what}_high"] = (found["low"], found["high"]) if found else (None, None)
    return row | {"mean_size": entry["mean_size"]}


def shortened(row: Mapping[str, Any]) -> dict[str, Any]:
    """A row of rates for people: rate and interval in one cell, in per cent."""
    short: dict[str, Any] = {}
    ends = {f"{name}_{end}" for name in row for end in ("low", "high")}
    for name, value in row.items():
        if name in ends:
            continue
        if f"{name}_low" in row:
            value = (
                f"{100 * value:.1f} ({100 * row[f'{name}_low']:.1f}–{100 * row[f'{name}_high']:.1f})"
                if (value is not None)
                else ""
            )
            name = f"{name}_%"
        elif isinstance(value, float):
            value = float(f"{value:.3g}")
        short[name] = value
    return short
