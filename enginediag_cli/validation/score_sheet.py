"""The score sheet of many trials of `explain`: every score with its interval and target, by truth, by kind and in bins.

Rows, tables and the document of `enginediag prove` are made of it here, and so are the detectable sizes (λ = 25) of
every effect, with the model-error floor and without: the cost of the floor.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.floor_cost import tolerance_cost
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.tables.trials import PROVE
from enginediag_cli.validation import kinds
from enginediag_cli.validation.concealed_effects import SIZE_STREAM, random_stream
from enginediag_cli.validation.trial_flights import draw_flights, drawable_effects, noise_free_fit
from enginediag_cli.validation.trials import (
    TrialPlan,
    cell,
    mean,
    median,
    numbers,
    rate,
    reliability_bin,
    right_less_stated,
    short,
    target_met,
    target_words,
    versions,
)

Record = Mapping[str, Any]

RATE, MEAN, MEDIAN, RIGHT_LESS_STATED = "rate", "mean", "median", "right less stated"
"""Statistic of a line."""


class ScoreLine:
    """One line of the sheet: the mark that it counts, the kinds of trials of its headline, and its target for
    each truth ("" for none; what it means is in words, as the targets are). Sizes are means, not rates; `how`: one of
    those above, where it is neither."""

    def __init__(
        self,
        mark: str,
        headline: tuple[str, ...],
        same_model: str = "",
        map_error: str = "",
        realistic: str = "",
        size: bool = False,
        how: str = "",
    ):
        self.mark, self.headline, self.how = mark, headline, how or (MEAN if size else RATE)
        self.target = {kinds.SAME_MODEL: same_model, kinds.MAP_ERROR: map_error, kinds.REALISTIC: realistic}


def score_rate(score: ScoreLine, records: Sequence[Record]) -> dict[str, Any]:
    """A score of these trials, of those that have its mark."""
    found = [r["marks"][score.mark] for r in records if score.mark in r["marks"]]
    if not found or score.how == RATE:
        return rate(found)
    if score.how == RIGHT_LESS_STATED:
        return right_less_stated([(p, bool(right)) for p, right in found], 0.0, np.inf)
    return (median if score.how == MEDIAN else mean)([float(np.mean(x)) for x in found])


_LAW, _NULL = (f"{kinds.SINGLE}_{kinds.LAW}",), (f"{kinds.NULL}_{kinds.LAW}",)
PLACE, DRIVER, CURVE = (">= 0.97", ">= 0.90"), (">= 0.93", ">= 0.93"), (">= 0.85", ">= 0.85")
"""Targets of truths from the same model and of truths with other maps, where enough trials require a name."""
WORSE, ERROR = ("<= 0.03", "<= 0.03"), ("<= 0.05", "<= 0.05")
GAIN, GAIN_HIGHER = (">= 0.95", ">= 0.95"), (">= 0.90", ">= 0.90")
STATED = ("within 0.05", "within 0.05")

LAW_SCORES: Mapping[str, ScoreLine] = {
    "law_judged": ScoreLine("law_judged", _LAW),
    "law_given": ScoreLine("law_given", _LAW),
    "law_found": ScoreLine("law_found", _LAW),
    "law_wrong_name": ScoreLine("law_wrong_name", _LAW),
    "law_place": ScoreLine("law_place", _LAW, *PLACE),
    "law_place_of_all": ScoreLine("law_place_of_all", _LAW, *PLACE),
    "law_place_exact": ScoreLine("law_place_exact", _LAW),
    "law_component": ScoreLine("law_component", _LAW),
    "law_driver": ScoreLine("law_driver", _LAW, *DRIVER),
    "law_driver_of_all": ScoreLine("law_driver_of_all", _LAW, *DRIVER),
    "law_driver_told": ScoreLine("law_driver_told", _LAW),
    "law_drivers_told": ScoreLine("law_drivers_told", _LAW, size=True),
    "law_driver_or_alike": ScoreLine("law_driver_or_alike", _LAW),
    "law_curve": ScoreLine("law_curve", _LAW, *CURVE),
    "law_curve_of_all": ScoreLine("law_curve_of_all", _LAW, *CURVE),
    "law_form": ScoreLine("law_form", _LAW),
    "law_alone": ScoreLine("law_alone", _LAW),
    "law_error": ScoreLine("law_error", _LAW, *ERROR, how=MEDIAN),
    "law_gain_unseen": ScoreLine("law_gain_unseen", _LAW, *GAIN, how=MEDIAN),
    "law_gain_higher": ScoreLine("law_gain_higher", _LAW, *GAIN_HIGHER, how=MEDIAN),
    "law_worse": ScoreLine("law_worse", _LAW, *WORSE),
    "spline_gain_unseen": ScoreLine("spline_gain_unseen", _LAW, how=MEDIAN),
    "spline_gain_higher": ScoreLine("spline_gain_higher", _LAW, how=MEDIAN),
    "spline_worse": ScoreLine("spline_worse", _LAW),
    "higher_at_ceiling": ScoreLine("higher_at_ceiling", _LAW, size=True),
    "law_place_right_less_stated": ScoreLine("stated", _LAW, *STATED, how=RIGHT_LESS_STATED),
    "law_driver_right_less_stated": ScoreLine("stated_driver", _LAW, how=RIGHT_LESS_STATED),
    "law_false": ScoreLine("law_false", _NULL, "<= 0.02", "<= 0.05"),
    "law_false_name": ScoreLine("law_false_name", _NULL),
    "law_false_finding": ScoreLine("law_false_finding", _NULL),
    "law_no_verdict": ScoreLine("no_verdict", kinds.LAW_KINDS),
}
"""Their marks are defined in `formula_marks`."""


_TWO, _THREE, _FOUR = ((k,) for k in kinds.SEVERAL_KINDS)

SEVERAL_SCORES: Mapping[str, ScoreLine] = {
    "several_all_of_two": ScoreLine("several_all", _TWO, ">= 0.85", ">= 0.85"),
    "several_all_of_three": ScoreLine("several_all", _THREE, ">= 0.70", ">= 0.70"),
    "several_all_of_four": ScoreLine("several_all", _FOUR),
    "several_share": ScoreLine("several_share", kinds.SEVERAL_KINDS, size=True),
    "several_none_false": ScoreLine("several_none_false", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_none_told_false": ScoreLine("several_none_told_false", kinds.SEVERAL_KINDS),
    "several_unexplained": ScoreLine("several_unexplained", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_no_verdict": ScoreLine("no_verdict", kinds.SEVERAL_KINDS),
}
"""Their marks are defined in `several_marks`."""


_SINGLE, _NULL_TRIALS, _ALL = (kinds.SINGLE,), (kinds.NULL,), kinds.KINDS
_NAMED = tuple(k for k in kinds.KINDS if kinds.base_kind(k) not in (kinds.NULL, kinds.WITHHELD, kinds.HIDDEN_SWITCH))

SCORES: Mapping[str, ScoreLine] = {
    "exact": ScoreLine("exact", _SINGLE, ">= 0.97", ">= 0.90"),
    "exact_no_alias": ScoreLine("exact_no_alias", _SINGLE),
    "covered": ScoreLine("covered", _SINGLE, ">= 0.97", ">= 0.90", ">= 0.95"),
    "alias_set_size": ScoreLine("alias_set_size", _SINGLE, "<= 1.3", "<= 2", size=True),
    "tight": ScoreLine("tight", _SINGLE),
    "set_score": ScoreLine("set_score", _SINGLE, size=True),
    "found": ScoreLine("found", _SINGLE),
    "false_name": ScoreLine("false_name", _NULL_TRIALS, "<= 0.05", "<= 0.05", "<= 0.05"),
    "false_name_without_floor": ScoreLine("false_name_without_floor", _NULL_TRIALS),
    "false_finding": ScoreLine("false_finding", _NULL_TRIALS),
    "none_right": ScoreLine("none_right", (kinds.WITHHELD,), ">= 0.95", ">= 0.80"),
    "wrongly_none": ScoreLine("wrongly_none", _SINGLE),
    "exact_pair": ScoreLine("exact_no_alias", (kinds.PAIR,), ">= 0.95"),
    "interval": ScoreLine("interval", _NAMED, "0.92 to 0.98", ">= 0.85", ">= 0.90"),
    "held_out_gain": ScoreLine("held_out_gain", _SINGLE, ">= 0.98", ">= 0.95"),
    "held_out_flights": ScoreLine("held_out_flights", _SINGLE),
    "log_score": ScoreLine("log_score", _SINGLE, size=True),
    "locate_driver": ScoreLine("locate_driver", _SINGLE, ">= 0.90", "", ">= 0.90"),
    "locate_driver_told": ScoreLine("locate_driver_told", _SINGLE),
    "drivers_told": ScoreLine("drivers_told", _SINGLE, size=True),
    "locate_component": ScoreLine("locate_component", _SINGLE, ">= 0.90"),
    "fault_called_fault": ScoreLine("fault_called_fault", (kinds.FAULT,)),
    "effect_called_fault": ScoreLine("effect_called_fault", _SINGLE),
    "exact_fault": ScoreLine("exact_no_alias", (kinds.FAULT,)),
    "exact_effect_and_fault": ScoreLine("exact_no_alias", (kinds.EFFECT_AND_FAULT,)),
    "hidden_found": ScoreLine("hidden_found", (kinds.HIDDEN_SWITCH,)),
    "hidden_location": ScoreLine("hidden_location", (kinds.HIDDEN_SWITCH,), ">= 0.95"),
    "hidden_states": ScoreLine("hidden_states", (kinds.HIDDEN_SWITCH,), ">= 0.95", size=True),
    "no_verdict": ScoreLine("no_verdict", _ALL, "<= 0.01", "<= 0.02"),
}

_SINGLE_DYNAMIC, _PAIR_DYNAMIC, _NULL_DYNAMIC = (
    (f"{kind}_{kinds.DYNAMIC}",) for kind in (kinds.SINGLE, kinds.PAIR, kinds.NULL)
)
_CONCEALED = (*_SINGLE_DYNAMIC, *_PAIR_DYNAMIC)
DYNAMIC_SCORES: Mapping[str, ScoreLine] = {
    "dynamic_exact": ScoreLine("exact", _SINGLE_DYNAMIC, ">= 0.90", ">= 0.90"),
    "dynamic_covered": ScoreLine("covered", _SINGLE_DYNAMIC),
    "dynamic_alias_set_size": ScoreLine("alias_set_size", _SINGLE_DYNAMIC, size=True),
    "dynamic_found": ScoreLine("found", _SINGLE_DYNAMIC),
    "dynamic_wrongly_none": ScoreLine("wrongly_none", _SINGLE_DYNAMIC),
    "dynamic_wrong_name": ScoreLine("false_name", _CONCEALED),
    "dynamic_false_name": ScoreLine("false_name", _NULL_DYNAMIC, "<= 0.05", "<= 0.05"),
    "dynamic_false_finding": ScoreLine("false_finding", _NULL_DYNAMIC),
    "dynamic_exact_pair": ScoreLine("exact", _PAIR_DYNAMIC),
    "dynamic_pair_covered": ScoreLine("covered", _PAIR_DYNAMIC),
    "dynamic_interval": ScoreLine("interval", _CONCEALED, "0.92 to 0.98", "0.92 to 0.98"),
    "dynamic_held_out_gain": ScoreLine("held_out_gain", _CONCEALED, ">= 0.95", ">= 0.95"),
    "dynamic_no_verdict": ScoreLine("no_verdict", kinds.DYNAMIC_KINDS),
}
"""Scores of trials with moving recordings, apart from the others."""

_PLANNED = (kinds.PLANNED,)
PLANNED_SCORES: Mapping[str, ScoreLine] = {
    "plan_asked": ScoreLine("ambiguous", _PLANNED),
    "resolved_by_plan": ScoreLine("resolved_planned", _PLANNED),
    "resolved_in_hindsight": ScoreLine("resolved_hindsight", _PLANNED),
    "resolved_at_random": ScoreLine("resolved_random", _PLANNED),
    "resolved_by_airliner": ScoreLine("resolved_airliner", _PLANNED),
    "resolved_by_sweep": ScoreLine("resolved_sweep", _PLANNED),
    "plan_less_twice_random": ScoreLine("less_twice_random", _PLANNED, ">= 0", ">= 0", size=True),
    "plan_less_hindsight": ScoreLine("less_hindsight", _PLANNED, ">= -0.10", ">= -0.10", size=True),
    "plan_foreseen": ScoreLine("foreseen", _PLANNED, size=True),
    "plan_misled": ScoreLine("misled", _PLANNED),
}
"""Scores of trials of planning alone: of the answers with alternatives, the truth among them, how many one more
flight resolves, and how many were predicted to be."""

SPECIAL_SCORES: Mapping[str, Mapping[str, ScoreLine]] = {
    kinds.DYNAMIC: DYNAMIC_SCORES,
    kinds.LAW: LAW_SCORES,
    kinds.SEVERAL: SEVERAL_SCORES,
    kinds.PLANNED: PLANNED_SCORES,
}
"""By choice, where such trials were run."""

FALSE_SENSOR = ScoreLine("false_sensor", _ALL, realistic="<= 0.03")
"""Of realistic truths, beside the scores of every truth."""
SURE, PROBABLE = 0.9, 0.7
"""From what is stated as sure, and as probable."""
SURE_TARGET, PROBABLE_TARGET = ">= 0.88", "within 0.07"

LAMBDA_BINS = (0.0, 5.0, 15.0, 25.0, 40.0, 150.0, 600.0, np.inf)
SEPARATION_BINS = (0.0, 2.0, 5.0, 11.0, 22.0, 40.0, 100.0, np.inf)
SIGNAL_BINS = (0.0, 0.5, 1.2, 2.0, 4.0, np.inf)
PROBABILITY_BINS = (0.0, 0.35, 0.5, 0.65, 0.8, 0.9, 0.97, 1.0)
"""Edges of the stated probabilities whose truth is counted: finer towards 1, where most are."""
BINNED = (
    "found",
    "exact",
    "covered",
    "alias_set_size",
    "false_name",
    "wrongly_none",
    "held_out_gain",
    "locate_component",
    "locate_driver",
)


def truths_on_sheet(records: Sequence[Record]) -> tuple[str, ...]:
    """The truths on a sheet of these trials."""
    return tuple(t for t in kinds.TRUTHS if t in kinds.USUAL or any(r["truth"] == t for r in records))


def sheet(records: Sequence[Record]) -> dict[str, Any]:
    """Every score: the headline over all truths, then per truth, with all kinds of trials that it has. Of realistic
    truths also whether names are right as often as they are said to be, and whether instruments are named wrongly."""
    found = {name: _score(score, records) for name, score in SCORES.items()}
    for choice, scores in SPECIAL_SCORES.items():
        if any(kinds.special_choice(r["kind"]) == choice for r in records):
            found |= {name: _score(score, records) for name, score in scores.items()}
    if kinds.REALISTIC not in truths_on_sheet(records):
        return found
    said = [(p, bool(right)) for p, right in (r["marks"]["answered"] for r in records if "answered" in r["marks"])]
    return found | {
        "false_sensor": _score(FALSE_SENSOR, records),
        "right_when_sure": _stated(rate(right for p, right in said if p >= SURE), SURE_TARGET),
        "right_less_stated_when_probable": _stated(right_less_stated(said, PROBABLE, SURE), PROBABLE_TARGET),
    }


def _stated(found: dict[str, Any], target: str) -> dict[str, Any]:
    """A score of realistic truths alone, in the form of the others."""
    own = found | {"target": target, "kinds": {}}
    empty = rate(()) | {"target": None, "kinds": {}}
    return found | {**dict.fromkeys(kinds.USUAL, empty), kinds.REALISTIC: own, "headline": list(_ALL)}


def _score(score: ScoreLine, records: Sequence[Record]) -> dict[str, Any]:
    whole = score_rate(score, [r for r in records if r["kind"] in score.headline])
    for truth in truths_on_sheet(records):
        own = [r for r in records if r["truth"] == truth]
        entry = score_rate(score, [r for r in own if r["kind"] in score.headline])
        by_kind = {
            k: score_rate(score, [r for r in own if r["kind"] == k]) for k in kinds.kinds_on_sheet(score.headline[0])
        }
        whole[truth] = entry | {
            "target": score.target[truth] or None,
            "kinds": {k: v for k, v in by_kind.items() if v["of"]},
        }
    return whole | {"headline": list(score.headline)}


def bins(records: Sequence[Record]) -> dict[str, Any]:
    """Scores of single trials by λ and by λ_sep, withheld ones by λ_out, hidden switches by signal to noise, and the
    reliability of stated probabilities; each per truth."""
    found: dict[str, Any] = {}
    for truth in truths_on_sheet(records):
        own = [r for r in records if r["truth"] == truth]
        single = [r for r in own if kinds.base_kind(r["kind"]) == kinds.SINGLE]
        withheld = [r for r in own if r["kind"] == kinds.WITHHELD]
        hidden = [r for r in own if r["kind"] == kinds.HIDDEN_SWITCH]
        visible = [r for r in single if "covered" in r["marks"]]
        found[truth] = {
            "lambda": _binned(single, LAMBDA_BINS, _number("lambda"), _marks(BINNED)),
            "lambda_sep": _binned(visible, SEPARATION_BINS, _number("lambda_sep"), _marks(BINNED)),
            "lambda_out": _binned(withheld, LAMBDA_BINS, _number("lambda_sep"), _statuses),
            "signal_to_noise": _binned(hidden, SIGNAL_BINS, _number("signal_to_noise"), _hidden),
            "probability": _reliability(own),
        }
    return found


def _number(name: str) -> Callable[[Record], float]:
    return lambda r: np.nan if r[name] is None else float(r[name])


def _binned(
    records: Sequence[Record],
    edges: Sequence[float],
    of: Callable[[Record], float],
    summary: Callable[[Sequence[Record]], dict[str, Any]],
) -> list[dict[str, Any]]:
    sheet_rows = []
    for low, high in pairwise(edges):
        own = [r for r in records if low <= of(r) < high]
        if own:
            sheet_rows.append(
                {"from": low, "to": high if np.isfinite(high) else None, "trials": len(own), **summary(own)}
            )
    return sheet_rows


def _marks(names: Sequence[str]) -> Callable[[Sequence[Record]], dict[str, Any]]:
    return lambda own: {n: score_rate(SCORES[n], own) for n in names}


def _statuses(own: Sequence[Record]) -> dict[str, Any]:
    return {"status": {s: sum(r["status"] == s for r in own) for s in sorted({r["status"] for r in own})}}


def _hidden(own: Sequence[Record]) -> dict[str, Any]:
    result = {}
    for name in ("hidden_found", "hidden_location", "hidden_states"):
        marks = [r["marks"].get(name, r["marks"].get(f"{name}_weak")) for r in own]
        marks = [m for m in marks if m is not None]
        result[name] = mean([m[0] for m in marks]) if marks and isinstance(marks[0], list) else rate(marks)
    return result


def _reliability(own: Sequence[Record]) -> list[dict[str, Any]]:
    """Stated probability of the first name, against how often it is the truth or an unavoidable alias of it."""
    stated = [(float(p), bool(right)) for p, right in (r["marks"]["stated"] for r in own if "stated" in r["marks"])]
    sheet_rows = []
    for low, high in pairwise(PROBABILITY_BINS):
        inside = [(p, right) for p, right in stated if low < p <= high]
        if inside:
            row = reliability_bin(low, high, inside)
            sheet_rows.append({name: value for name, value in row.items() if name != "gap"})
    return sheet_rows


SETS_OF_FLIGHTS = 5
"""Flights are drawn anew so many times, so that no effect's weight is that of one set of flights."""


def detectable_sizes(engine: Engine, seed: int) -> dict[str, dict[str, Any]]:
    """Per effect, the median over a few sets of flights: in the coefficient's unit and over its typical size; None
    where identification absorbs it."""
    library = drawable_effects(engine)
    found: dict[str, list[tuple[float, float]]] = {e.label: [] for e in library}
    for k in range(SETS_OF_FLIGHTS):
        flights, training = draw_flights(engine, random_stream(seed, k, SIZE_STREAM))
        base = noise_free_fit(engine, flights[:training], kinds.MODEL_ERROR[kinds.MAP_ERROR] or 0.0)
        for cost in tolerance_cost(HypothesisFit((), base, Projection(base)), [effect_option(e) for e in library]):
            found[cost.label].append((cost.visible_without, cost.visible))
    result = {}
    for e in library:
        first = e.term.amplitudes()[0]
        without, with_floor = np.median(np.array(found[e.label] or [(np.inf, np.inf)]), axis=0)
        typical = abs(first.typical - first.absent)
        result[e.label] = {
            "coefficient": first.name,
            "unit": first.unit,
            "without_floor": short(without, 4),
            "with_floor": short(with_floor, 4),
            "without_floor_over_typical": short(without / typical, 4),
            "with_floor_over_typical": short(with_floor / typical, 4),
        }
    return result


def sheet_rows(sheet: Mapping[str, Any], bins: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One row per score, truth and kind of trials, kind "" being the score's headline, then one per bin."""
    found = [row for name in sheet for row in _score_rows(name, sheet[name])]
    for truth, by in bins.items():
        for what, own in by.items():
            for b in own:
                place = {"truth": truth, "kind": "", "bin": f"{what} {_span(b)}", "target": "", "met": ""}
                if "rate" in b:  # reliability of stated probabilities: one rate a bin
                    found.append({"score": "stated", **place, **numbers(b)})
                found += [
                    {"score": n, **place, **numbers(x)}
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
                **numbers(own),
                "target": target,
                "met": target_met(own["rate"], target),
            }
        for kind, other in own["kinds"].items():
            yield {"score": name, "truth": truth, "kind": kind, "bin": "", **other, "target": "", "met": ""}


def sheet_table(sheet: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Headlines only: rate with its interval in a cell, truths side by side."""
    found = []
    for name, entry in sheet.items():
        row: dict[str, Any] = {"score": name, "trials": _kinds(entry["headline"])}
        for truth in _truths(entry):
            own = entry[truth]
            row[truth] = cell(own)
            row[f"target {truth}"] = f"{target_words(own['target'])} {target_met(own['rate'], own['target'])}".strip()
        found.append(row)
    return [r for r in found if any(r.get(truth) for truth in kinds.TRUTHS)]


def _truths(entry: Mapping[str, Any]) -> list[str]:
    return [truth for truth in kinds.TRUTHS if truth in entry]


def _kinds(headline: list[str]) -> str:
    if len(headline) == 1:
        return headline[0]
    whole = tuple(headline) == kinds.kinds_on_sheet(headline[0])
    return (kinds.special_choice(headline[0]) or "all") if whole else "with something in it"


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


def score_sheet_document(plan: TrialPlan, records: Sequence[Mapping[str, Any]], sizes: bool) -> dict[str, Any]:
    """Scores by name, then bins, detectable sizes, counts and what was run."""
    scores, truths = sheet(records), truths_on_sheet(records)
    found: dict[str, Any] = {
        "schema": PROVE.id,
        **scores,
        "scores": list(scores),
        "bins": bins(records),
        "held_out_misfit": {t: _mean_misfit(records, t) for t in truths},
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
        "engine": Path(plan.engines[0]).name,
        "versions": versions(),
    }
    if len(plan.engines) > 1:
        found["engines"] = [Path(e).name for e in plan.engines]
    if sizes:
        found["detectable_size"] = detectable_sizes(load_engine(plan.engines[0]), plan.seed)
    return found


def _mean_misfit(records: Sequence[Mapping[str, Any]], truth: str) -> dict[str, Any]:
    """Mean χ² per reading of the held-back flights of single trials: before, after, with the true effect."""
    own = [
        r["held_out"]
        for r in records
        if r["truth"] == truth and kinds.base_kind(r["kind"]) == kinds.SINGLE and "held_out" in r
    ]
    values = {
        what: [x for h in own for x in h[what] if x is not None and np.isfinite(x)]
        for what in ("before", "after", "true")
    }
    return {what: float(np.mean(v)) if v else None for what, v in values.items()} | {"trials": len(own)}
