"""What a study found, as rows and as JSON: counts, and rates with intervals that hold between seeds, by batches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.presentation.outputs.study import STUDY
from enginediag_cli.trials.rates import counted, design_effect
from enginediag_cli.trials.studies.journal import Finished
from enginediag_cli.trials.studies.study_file import Study
from enginediag_cli.trials.studies.tally import BLOCK, EDGES, Tally

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
    rows = []
    for low, high, (count, right, stated) in zip(EDGES[:-1], EDGES[1:], x.bins, strict=True):
        if count:
            realised = counted(int(right), int(count)) or {}
            rows.append(
                {
                    "from": float(low),
                    "to": min(float(high), 1.0),
                    "answers": int(count),
                    "stated": stated / count,
                    "right": int(right),
                    **realised,
                }
            )
    return rows


def rows(study: Study, results: Results, show: str) -> tuple[list[dict[str, Any]], tuple[str, ...]]:
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
