"""The scorer of isolation: opens a trial's sealed answer and marks what the isolator said.

With T the places that are wrong, A the answer's and R its rivals (sets of places, each):

    false_alarm   the verdict is a fault where nothing is wrong
    right         A = T. Of physics, which isolation does not know: A lies where the effect acts
    covered       T ∈ {A} ∪ R, or the class that is told holds T; not asked of physics
    false_name    a name where nothing is wrong
    false_sensor  A names an output sensor that reads right; false_input: an input channel
    stated        probability that A changed and nothing else that matters, and whether it is so: A lies in T, and what
                  T holds besides is below `least_relevant_change`; stated_changed: of each place of A the probability
                  that it changed, whatever else did, and whether it lies in T (of physics, where the effect acts)
    interval      of every size that is told, whether its interval holds the true change, 0 of what did not change

An instrument is right by its column: whether the error is told as a bias or as a scale is no matter, but sizes of those
told in another way than they were made are not marked.

Is it right as often as it says? The reliability tables of isolation, and its score sheet with targets.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import groupby, pairwise
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli import __version__
from enginediag_cli.detection.verdict import FAULT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.isolation.posterior import least_relevant_change
from enginediag_cli.parallel import QuestionProcess, run_tasks
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import Cause, components, instrument_place
from enginediag_cli.validation.concealed_effects import engine_of
from enginediag_cli.validation.isolation_truths import Sealed, draw, group_of, record
from enginediag_cli.validation.score_sheet import PROBABLE, PROBABLE_TARGET, SURE, SURE_TARGET, right_less_stated
from enginediag_cli.validation.trials import ISOLATE, diagnoser, rate, wilson

NAMED, NOTHING, CANNOT_TELL = "named", "nothing", "cannot tell"
NO_VERDICT, NOT_IDENTIFIED, FAILED = "no verdict", "not identified", "failed"
OUTCOMES = (NAMED, NOTHING, CANNOT_TELL, NO_VERDICT, NOT_IDENTIFIED, FAILED)
JUDGED = (NAMED, NOTHING, CANNOT_TELL)
"""Outcomes that are an answer."""

OF_ALL_FAULTS = {"exact_fault": "exact", "exact_instrument": "exact", "covered_fault": "covered"}
"""Marks of every trial with a fault, judged or not, and those of judged trials that they repeat."""

Marks = dict[str, Any]


def outcome(told: Mapping[str, Any]) -> str:
    """What kind of answer the isolator gave."""
    if "error" in told:
        return FAILED
    if not told["identified"]:
        return NOT_IDENTIFIED
    window = _window(told)
    if "sets" not in window:
        return NO_VERDICT
    if window["named"]:
        return CANNOT_TELL if "class" in window else NAMED
    return CANNOT_TELL if window["sets"][0] else NOTHING


def marks(engine: Engine, sealed: Sealed, told: Mapping[str, Any]) -> Marks:
    """All marks of a trial."""
    came = outcome(told)
    found: Marks = {"judged": came in JUDGED, "cannot_tell": came == CANNOT_TELL}
    found |= {"no_verdict": came in (NO_VERDICT, FAILED), "not_identified": came == NOT_IDENTIFIED}
    window = _window(told)
    if sealed.kind == kinds.NULL:
        found["false_alarm"] = window.get("verdict") == FAULT
    elif not sealed.effects:
        found |= {"exact_fault": False, "covered_fault": False}
        if sealed.kind in kinds.INSTRUMENTS:
            found["exact_instrument"] = False
    if came not in JUDGED:
        return found
    truth = frozenset(c.place for c in sealed.changes)
    said = frozenset(window["sets"][0]) if came == NAMED else frozenset()
    outputs, inputs = ({instrument_place(c) for c in columns} for columns in (engine.sensors, engine.inputs))
    found["false_sensor"] = bool((said & outputs) - truth)
    found["false_input"] = bool((said & inputs) - truth)
    if sealed.kind == kinds.NULL:
        found["false_name"] = window["named"]  # a class, too, says that something is wrong
    else:
        found["found"] = came != NOTHING
    acting = _where_it_acts(engine, sealed) if sealed.effects else truth
    right = said <= acting if sealed.effects else said == truth
    as_stated = right if sealed.effects else said <= truth and not (truth - said) & _that_matter(engine, sealed)
    if window["named"] and "class" in window and not sealed.effects:
        one_of = [frozenset(s) for s in window["class"]]
        found["stated_class"] = [float(window["class_probability"] or 0.0), truth in one_of]
    if came == NAMED:
        found["stated"] = [float(window["probabilities"][0] or 0.0), as_stated]
        each = zip(window["sets"][0], window.get("changed", ()), strict=False)
        found["stated_changed"] = [[float(p or 0.0), place in acting] for place, p in each]
        found["right_name"] = right
    elif came == NOTHING:
        found["stated_nothing"] = [float(window["probabilities"][0] or 0.0), as_stated and not sealed.effects]
    if not sealed.effects:
        found["exact"] = came != CANNOT_TELL and right
        sets = [frozenset(s) for s in (*window["sets"], *window.get("class", ()))]
        found["covered"] = truth in sets
        found |= {name: found[of] for name, of in OF_ALL_FAULTS.items() if name in found}
        if came == NAMED:
            inside = _intervals(sealed, window["sizes"])
            found |= {"interval": inside} if inside else {}
    return found


def _window(told: Mapping[str, Any]) -> Mapping[str, Any]:
    """A recording of one flight is one window."""
    windows: Sequence[Mapping[str, Any]] = told.get("windows") or ({},)
    return windows[0]


def _intervals(sealed: Sealed, sizes: Sequence[Sequence[Any]]) -> list[float]:
    by_place = {c.place: c for c in sealed.changes}
    found = []
    for place, quantity, _, low, high in sizes:
        change = by_place.get(place)
        if change is not None and change.instrument and change.share != (quantity == "scale"):
            continue
        true = change.size if change is not None else 0.0
        found.append(float((low is None or low <= true) and (high is None or true <= high)))
    return found


def _that_matter(engine: Engine, sealed: Sealed) -> frozenset[str]:
    """Places of the changes that are as large as what matters beside others."""
    found = {c.place for c in sealed.changes if c.instrument}
    for c in sealed.changes:
        if not c.instrument and c.place in engine.parameters:
            p = engine.parameters[c.place]
            if abs(c.size) >= least_relevant_change([p], np.array([p.prior_sigma]))[0]:
                found.add(c.place)
    return frozenset(found)


def _where_it_acts(engine: Engine, sealed: Sealed) -> frozenset[str]:
    """Places of the components through which the effects act, and of the readings that they falsify."""
    acting = frozenset().union(*(components(engine, Cause(e.label)) for e in sealed.effects))
    places = {n for n, p in engine.parameters.items() if p.component in acting and not p.of_sensor}
    places |= {
        instrument_place(c) for c, s in engine.sensors.items() if {s.quantity, c, f"sensor.{s.quantity}"} & acting
    }
    if acting & {c.name for c in engine.network.components if c.TYPE == "ambient"}:
        places |= {instrument_place(c) for c in engine.inputs if c != engine.power_setting}
    return frozenset(places)


KEPT = 10
"""Sets that a trial's record keeps; the last ones are hardly possible."""


@dataclass(frozen=True)
class Plan:
    """What is asked for: trials of these truths and kinds, each on one of these engine files."""

    engines: tuple[str, ...]
    seed: int
    truths: tuple[str, ...]
    kinds: tuple[str, ...]


def run_group(plan: Plan, trials: Sequence[int], isolator: QuestionProcess) -> list[dict[str, Any]]:
    """Trials of one group of `group_of`: draw, record, ask, open the answer and mark it."""
    path = engine_of(plan.engines, plan.seed, group_of(trials[0], plan.kinds))
    engine = load_engine(path)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        return [_run_trial(plan, engine, trial, isolator, Path(folder)) for trial in trials]


def _run_trial(plan: Plan, engine: Engine, trial: int, isolator: QuestionProcess, folder: Path) -> dict[str, Any]:
    begun = process_time()
    sealed = draw(engine, plan.seed, trial, plan.truths, plan.kinds)
    files = record(engine, sealed, folder)
    told = isolator.ask(
        {
            "task": ISOLATE,
            "engine": str(files.engine),
            "healthy": [str(p) for p in files.healthy],
            "judged": str(files.judged),
        }
    )
    found = _record(sealed, told, marks(engine, sealed, told))
    return found | {
        "engine": engine.name,
        "group": group_of(trial, plan.kinds),
        "failed_records": files.failed,
        "seconds": round(process_time() - begun, 3),
        "isolator_seconds": round(told.get("seconds", 0.0), 3),
    }


def _record(sealed: Sealed, told: Mapping[str, Any], marked: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of the trial; numbers rounded, so that a line is short and the same on every machine."""
    window = (told.get("windows") or [{}])[0]
    drawn = sealed.realistic
    return {
        "trial": sealed.trial,
        "truth": sealed.truth,
        "kind": sealed.kind,
        "shape": None if drawn is None else _short(drawn.shape),
        "airline": drawn is not None and drawn.airline,
        "soaked": drawn is not None and drawn.soak is not None,
        "changes": [c.as_json() | {"size": _short(c.size)} for c in sealed.changes],
        "outcome": outcome(told),
        "reason": told.get("error") or window.get("why") or ("" if window else told.get("reason", "")),
        "fit": _short(window.get("fit")),
        "sets": window.get("sets", [])[:KEPT],
        "probabilities": [_short(p) for p in window.get("probabilities", [])[:KEPT]],
        "sizes": [[place, what, *map(_short, numbers)] for place, what, *numbers in window.get("sizes", [])],
        "marks": dict(marked),
    }


def _short(x: float | None) -> float | None:
    return float(f"{x:.6g}") if x is not None and np.isfinite(x) else None


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Number and record of each trial, those of a group together as they are finished, in any order."""
    groups = [tuple(own) for _, own in groupby(todo, lambda trial: group_of(trial, plan.kinds))]
    for trials, records in run_tasks(partial(_run, plan), groups, jobs):
        yield from zip(trials, records, strict=True)


def _run(plan: Plan, trials: tuple[int, ...]) -> list[dict[str, Any]]:
    return run_group(plan, trials, diagnoser())


def plan_key(plan: Plan) -> str:
    """Hash of all that a trial depends on but its number."""
    digest = hashlib.sha256(f"isolate {__version__} {plan.seed} {plan.truths} {plan.kinds}".encode())
    for engine in plan.engines:
        digest.update(b"\0" + Path(engine).read_bytes())
    return digest.hexdigest()


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
        by = {t: score.of([r for r in records if r["truth"] == t]) for t in kinds.ISOLATION_TRUTHS}
        found[name] = score.of(records) | {t: v for t, v in by.items() if v["of"]} | {"target": score.target or None}
    return found


def by_kind(records: Sequence[Record]) -> dict[str, Any]:
    """Outcomes and rates of every kind of trials, and of all."""
    found: dict[str, Any] = {}
    for kind in (*kinds.ISOLATION_KINDS, ALL):
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
    for kind in kinds.ISOLATION_KINDS:
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
