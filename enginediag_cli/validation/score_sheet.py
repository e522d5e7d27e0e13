"""One line of the score sheet: which marks of which trials it tells of, and how.

Lines of the score sheet of laws, with their targets.

Lines of the score sheet of several causes, with their targets.

The score sheet of many trials: every score with its interval, split by truth, by kind, and in bins.

Detectable size of every effect (λ = 25), with the model-error floor and without: what the floor costs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.floor_cost import tolerance_cost
from enginediag_cli.mismatch.fit.options import effect_option
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import drawable, noise_free_fit
from enginediag_cli.validation.concealed_effects import SIZE_STREAM, stream
from enginediag_cli.validation.trial_flights import draw_flights
from enginediag_cli.validation.trials import mean, median, rate, wilson

Record = Mapping[str, Any]

RATE, MEAN, MEDIAN, RIGHT_LESS_STATED = "rate", "mean", "median", "right less stated"
"""What a line says of its marks."""


class Score:
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

    @property
    def size(self) -> bool:
        """Whether it is no rate."""
        return self.how != RATE


def rate_of(score: Score, records: Sequence[Record]) -> dict[str, Any]:
    """A score of these trials, of those that have its mark."""
    found = [r["marks"][score.mark] for r in records if score.mark in r["marks"]]
    if not found or score.how == RATE:
        return rate(found)
    if score.how == RIGHT_LESS_STATED:
        return right_less_stated([(p, bool(right)) for p, right in found], 0.0, np.inf)
    return (median if score.how == MEDIAN else mean)([float(np.mean(x)) for x in found])


def right_less_stated(said: Sequence[tuple[float, bool]], low: float, high: float) -> dict[str, Any]:
    """Rate of right names less the mean of what was stated, of those stated from `low` to `high`."""
    own = [(p, right) for p, right in said if low <= p < high]
    found = rate(right for _, right in own)
    if not own:
        return found
    mean_stated = float(np.mean([p for p, _ in own]))
    return found | {name: found[name] - mean_stated for name in ("rate", "low", "high")}


_LAW, _NULL = (f"{kinds.SINGLE}_{kinds.LAW}",), (f"{kinds.NULL}_{kinds.LAW}",)
PLACE, DRIVER, CURVE = (">= 0.97", ">= 0.90"), (">= 0.93", ">= 0.93"), (">= 0.85", ">= 0.85")
"""Targets of truths from the same model and of truths with other maps, where a name is asked for often enough."""
WORSE, ERROR = ("<= 0.03", "<= 0.03"), ("<= 0.05", "<= 0.05")
GAIN, GAIN_HIGHER = (">= 0.95", ">= 0.95"), (">= 0.90", ">= 0.90")
STATED = ("within 0.05", "within 0.05")

LAW_SCORES: Mapping[str, Score] = {
    "law_judged": Score("law_judged", _LAW),
    "law_given": Score("law_given", _LAW),
    "law_found": Score("law_found", _LAW),
    "law_wrong_name": Score("law_wrong_name", _LAW),
    "law_place": Score("law_place", _LAW, *PLACE),
    "law_place_of_all": Score("law_place_of_all", _LAW, *PLACE),
    "law_place_exact": Score("law_place_exact", _LAW),
    "law_component": Score("law_component", _LAW),
    "law_driver": Score("law_driver", _LAW, *DRIVER),
    "law_driver_of_all": Score("law_driver_of_all", _LAW, *DRIVER),
    "law_driver_told": Score("law_driver_told", _LAW),
    "law_drivers_told": Score("law_drivers_told", _LAW, size=True),
    "law_driver_or_alike": Score("law_driver_or_alike", _LAW),
    "law_curve": Score("law_curve", _LAW, *CURVE),
    "law_curve_of_all": Score("law_curve_of_all", _LAW, *CURVE),
    "law_form": Score("law_form", _LAW),
    "law_alone": Score("law_alone", _LAW),
    "law_error": Score("law_error", _LAW, *ERROR, how=MEDIAN),
    "law_gain_unseen": Score("law_gain_unseen", _LAW, *GAIN, how=MEDIAN),
    "law_gain_higher": Score("law_gain_higher", _LAW, *GAIN_HIGHER, how=MEDIAN),
    "law_worse": Score("law_worse", _LAW, *WORSE),
    "spline_gain_unseen": Score("spline_gain_unseen", _LAW, how=MEDIAN),
    "spline_gain_higher": Score("spline_gain_higher", _LAW, how=MEDIAN),
    "spline_worse": Score("spline_worse", _LAW),
    "higher_at_ceiling": Score("higher_at_ceiling", _LAW, size=True),
    "law_place_right_less_stated": Score("stated", _LAW, *STATED, how=RIGHT_LESS_STATED),
    "law_driver_right_less_stated": Score("stated_driver", _LAW, how=RIGHT_LESS_STATED),
    "law_false": Score("law_false", _NULL, "<= 0.02", "<= 0.05"),
    "law_false_name": Score("law_false_name", _NULL),
    "law_false_finding": Score("law_false_finding", _NULL),
    "law_no_verdict": Score("no_verdict", kinds.LAW_KINDS),
}
"""What each of them counts is in `marks`."""


_TWO, _THREE, _FOUR = ((k,) for k in kinds.SEVERAL_KINDS)

SEVERAL_SCORES: Mapping[str, Score] = {
    "several_all_of_two": Score("several_all", _TWO, ">= 0.85", ">= 0.85"),
    "several_all_of_three": Score("several_all", _THREE, ">= 0.70", ">= 0.70"),
    "several_all_of_four": Score("several_all", _FOUR),
    "several_share": Score("several_share", kinds.SEVERAL_KINDS, size=True),
    "several_none_false": Score("several_none_false", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_none_told_false": Score("several_none_told_false", kinds.SEVERAL_KINDS),
    "several_unexplained": Score("several_unexplained", kinds.SEVERAL_KINDS, ">= 0.95", ">= 0.95"),
    "several_no_verdict": Score("no_verdict", kinds.SEVERAL_KINDS),
}
"""What each of them counts is in `opened`."""


_SINGLE, _NULL_TRIALS, _ALL = (kinds.SINGLE,), (kinds.NULL,), kinds.KINDS
_NAMED = tuple(k for k in kinds.KINDS if kinds.base(k) not in (kinds.NULL, kinds.WITHHELD, kinds.HIDDEN_SWITCH))

SCORES: Mapping[str, Score] = {
    "exact": Score("exact", _SINGLE, ">= 0.97", ">= 0.90"),
    "exact_no_alias": Score("exact_no_alias", _SINGLE),
    "covered": Score("covered", _SINGLE, ">= 0.97", ">= 0.90", ">= 0.95"),
    "alias_set_size": Score("alias_set_size", _SINGLE, "<= 1.3", "<= 2", size=True),
    "tight": Score("tight", _SINGLE),
    "set_score": Score("set_score", _SINGLE, size=True),
    "found": Score("found", _SINGLE),
    "false_name": Score("false_name", _NULL_TRIALS, "<= 0.05", "<= 0.05", "<= 0.05"),
    "false_name_without_floor": Score("false_name_without_floor", _NULL_TRIALS),
    "false_finding": Score("false_finding", _NULL_TRIALS),
    "none_right": Score("none_right", (kinds.WITHHELD,), ">= 0.95", ">= 0.80"),
    "wrongly_none": Score("wrongly_none", _SINGLE),
    "exact_pair": Score("exact_no_alias", (kinds.PAIR,), ">= 0.95"),
    "interval": Score("interval", _NAMED, "0.92 to 0.98", ">= 0.85", ">= 0.90"),
    "held_out_gain": Score("held_out_gain", _SINGLE, ">= 0.98", ">= 0.95"),
    "held_out_flights": Score("held_out_flights", _SINGLE),
    "log_score": Score("log_score", _SINGLE, size=True),
    "locate_driver": Score("locate_driver", _SINGLE, ">= 0.90", "", ">= 0.90"),
    "locate_driver_told": Score("locate_driver_told", _SINGLE),
    "drivers_told": Score("drivers_told", _SINGLE, size=True),
    "locate_component": Score("locate_component", _SINGLE, ">= 0.90"),
    "fault_called_fault": Score("fault_called_fault", (kinds.FAULT,)),
    "effect_called_fault": Score("effect_called_fault", _SINGLE),
    "exact_fault": Score("exact_no_alias", (kinds.FAULT,)),
    "exact_effect_and_fault": Score("exact_no_alias", (kinds.EFFECT_AND_FAULT,)),
    "hidden_found": Score("hidden_found", (kinds.HIDDEN_SWITCH,)),
    "hidden_location": Score("hidden_location", (kinds.HIDDEN_SWITCH,), ">= 0.95"),
    "hidden_states": Score("hidden_states", (kinds.HIDDEN_SWITCH,), ">= 0.95", size=True),
    "no_verdict": Score("no_verdict", _ALL, "<= 0.01", "<= 0.02"),
}

_SINGLE_DYNAMIC, _PAIR_DYNAMIC, _NULL_DYNAMIC = (
    (f"{kind}_{kinds.DYNAMIC}",) for kind in (kinds.SINGLE, kinds.PAIR, kinds.NULL)
)
_CONCEALED = (*_SINGLE_DYNAMIC, *_PAIR_DYNAMIC)
DYNAMIC_SCORES: Mapping[str, Score] = {
    "dynamic_exact": Score("exact", _SINGLE_DYNAMIC, ">= 0.90", ">= 0.90"),
    "dynamic_covered": Score("covered", _SINGLE_DYNAMIC),
    "dynamic_alias_set_size": Score("alias_set_size", _SINGLE_DYNAMIC, size=True),
    "dynamic_found": Score("found", _SINGLE_DYNAMIC),
    "dynamic_wrongly_none": Score("wrongly_none", _SINGLE_DYNAMIC),
    "dynamic_wrong_name": Score("false_name", _CONCEALED),
    "dynamic_false_name": Score("false_name", _NULL_DYNAMIC, "<= 0.05", "<= 0.05"),
    "dynamic_false_finding": Score("false_finding", _NULL_DYNAMIC),
    "dynamic_exact_pair": Score("exact", _PAIR_DYNAMIC),
    "dynamic_pair_covered": Score("covered", _PAIR_DYNAMIC),
    "dynamic_interval": Score("interval", _CONCEALED, "0.92 to 0.98", "0.92 to 0.98"),
    "dynamic_held_out_gain": Score("held_out_gain", _CONCEALED, ">= 0.95", ">= 0.95"),
    "dynamic_no_verdict": Score("no_verdict", kinds.DYNAMIC_KINDS),
}
"""Told of trials whose recordings move, apart from the others."""

_PLANNED = (kinds.PLANNED,)
PLANNED_SCORES: Mapping[str, Score] = {
    "plan_asked": Score("ambiguous", _PLANNED),
    "resolved_by_plan": Score("resolved_planned", _PLANNED),
    "resolved_in_hindsight": Score("resolved_hindsight", _PLANNED),
    "resolved_at_random": Score("resolved_random", _PLANNED),
    "resolved_by_airliner": Score("resolved_airliner", _PLANNED),
    "resolved_by_sweep": Score("resolved_sweep", _PLANNED),
    "plan_less_twice_random": Score("less_twice_random", _PLANNED, ">= 0", ">= 0", size=True),
    "plan_less_hindsight": Score("less_hindsight", _PLANNED, ">= -0.10", ">= -0.10", size=True),
    "plan_foreseen": Score("foreseen", _PLANNED, size=True),
    "plan_misled": Score("misled", _PLANNED),
}
"""Told of trials of planning alone: of how many answers with rivals, the truth among them, one more flight leaves the
truth alone, and how many were foreseen to."""

APART_SCORES: Mapping[str, Mapping[str, Score]] = {
    kinds.DYNAMIC: DYNAMIC_SCORES,
    kinds.LAW: LAW_SCORES,
    kinds.SEVERAL: SEVERAL_SCORES,
    kinds.PLANNED: PLANNED_SCORES,
}
"""By choice, where such trials were run."""

FALSE_SENSOR = Score("false_sensor", _ALL, realistic="<= 0.03")
"""Asked of realistic truths, beside what is asked of every truth."""
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


def truths_of(records: Sequence[Record]) -> tuple[str, ...]:
    """The truths that a sheet of these trials tells of."""
    return tuple(t for t in kinds.TRUTHS if t in kinds.USUAL or any(r["truth"] == t for r in records))


def sheet(records: Sequence[Record]) -> dict[str, Any]:
    """Every score: the headline over all truths, then per truth, with all kinds of trials that it has. Of realistic
    truths also whether names are right as often as they are said to be, and whether instruments are named wrongly."""
    found = {name: _score(score, records) for name, score in SCORES.items()}
    for choice, scores in APART_SCORES.items():
        if any(kinds.choice(r["kind"]) == choice for r in records):
            found |= {name: _score(score, records) for name, score in scores.items()}
    if kinds.REALISTIC not in truths_of(records):
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


def _score(score: Score, records: Sequence[Record]) -> dict[str, Any]:
    whole = rate_of(score, [r for r in records if r["kind"] in score.headline])
    for truth in truths_of(records):
        own = [r for r in records if r["truth"] == truth]
        entry = rate_of(score, [r for r in own if r["kind"] in score.headline])
        by_kind = {k: rate_of(score, [r for r in own if r["kind"] == k]) for k in kinds.beside(score.headline[0])}
        whole[truth] = entry | {
            "target": score.target[truth] or None,
            "kinds": {k: v for k, v in by_kind.items() if v["of"]},
        }
    return whole | {"headline": list(score.headline)}


def bins(records: Sequence[Record]) -> dict[str, Any]:
    """Scores of single trials by λ and by λ_sep, withheld ones by λ_out, hidden switches by signal to noise, and the
    reliability of stated probabilities; each per truth."""
    found: dict[str, Any] = {}
    for truth in truths_of(records):
        own = [r for r in records if r["truth"] == truth]
        single = [r for r in own if kinds.base(r["kind"]) == kinds.SINGLE]
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
    rows = []
    for low, high in pairwise(edges):
        own = [r for r in records if low <= of(r) < high]
        if own:
            rows.append({"from": low, "to": high if np.isfinite(high) else None, "trials": len(own), **summary(own)})
    return rows


def _marks(names: Sequence[str]) -> Callable[[Sequence[Record]], dict[str, Any]]:
    return lambda own: {n: rate_of(SCORES[n], own) for n in names}


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
    stated = np.array([r["marks"]["stated"] for r in own if "stated" in r["marks"]], float).reshape(-1, 2)
    rows = []
    for low, high in pairwise(PROBABILITY_BINS):
        inside = stated[(stated[:, 0] > low) & (stated[:, 0] <= high)]
        if len(inside):
            right, n = int(inside[:, 1].sum()), len(inside)
            least, most = wilson(right, n)
            rows.append(
                {
                    "from": low,
                    "to": high,
                    "stated": float(inside[:, 0].mean()),
                    "rate": right / n,
                    "count": right,
                    "of": n,
                    "low": least,
                    "high": most,
                }
            )
    return rows


SETS_OF_FLIGHTS = 5
"""Flights are drawn anew so many times, so that no effect's weight is that of one set of flights."""


def detectable_sizes(engine: Engine, seed: int) -> dict[str, dict[str, Any]]:
    """Per effect, the median over a few sets of flights: in the coefficient's unit and over its typical size; None
    where identification absorbs it."""
    library = drawable(engine)
    found: dict[str, list[tuple[float, float]]] = {e.label: [] for e in library}
    for k in range(SETS_OF_FLIGHTS):
        flights, training = draw_flights(engine, stream(seed, k, SIZE_STREAM))
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
            "without_floor": _short(without),
            "with_floor": _short(with_floor),
            "without_floor_over_typical": _short(without / typical),
            "with_floor_over_typical": _short(with_floor / typical),
        }
    return result


def _short(x: float) -> float | None:
    return float(f"{x:.4g}") if np.isfinite(x) else None
