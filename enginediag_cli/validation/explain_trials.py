"""Trials of `explain`, from the seed to the marks; and trials of planning.

A trial of planning explains, plans, flies the plan on the concealed truth, and explains again. Its first flights are
recorded in cruise alone, as many an airline records them, and show an effect that has alternatives; trials are drawn
until there is one. Beside the planned flight others of the same candidates are flown: one at random, an airliner
flight, a power sweep, and the best in hindsight, which sets the truth farthest from its nearest alternative. All have
the same number of records.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.answer import FORMULA, HIDDEN_STATE, IDENTIFIED, Coefficient, Explanation
from enginediag_cli.mismatch.explain.foreseen import PredictedReadings
from enginediag_cli.mismatch.explain.judging import ALIAS
from enginediag_cli.mismatch.explain.plan import (
    PlannedEvidence,
    expected_separation,
    fitted_alternatives,
    predictions_by_flight,
)
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, Hypothesis, identify_with, nuisance, stack_column
from enginediag_cli.mismatch.fit.options import EFFECT, Option
from enginediag_cli.parallel import QuestionProcess
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.planning.flights import AIRLINER, RECORDS, SWEEP, WEATHER, Corner, PlannedFlight
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import VISIBLE, Cause, CauseNames, cause_names, causes_hypothesis
from enginediag_cli.validation.concealed_effects import (
    ConcealedTruth,
    TrialFlights,
    draw_engine_file,
    draw_truth,
    random_stream,
    record_trial,
    true_flight_readings,
    write_recording,
    write_trial_files,
)
from enginediag_cli.validation.formula_marks import mark_formula_trial
from enginediag_cli.validation.marks import ExplainAnswer, mark_trial, trial_dataset
from enginediag_cli.validation.separability import separability
from enginediag_cli.validation.several_marks import mark_several_trial
from enginediag_cli.validation.trial_flights import hour_columns
from enginediag_cli.validation.trials import EXPLAIN, LOCATE, PLAN, TrialPlan, diagnoser, short

RECORDED = (0.3, 0.75)
"""Share of a flight, from and to, that is recorded before the plan: its cruise."""
MOST_DRAWS = 80
"""Draws of a trial: one in eight is ambiguous with exact maps, one in thirty with wrong ones."""
FURTHER_DRAWS = 1_000_000
"""Draw k of trial t is draw t + k FURTHER_DRAWS of the seed: no trial of its own."""


def draw_ambiguous(path: str, seed: int, trial: int, truth: str) -> ConcealedTruth:
    """A visible single effect with at least one alternative that is expected in the answer from the first flights; the
    last draw where none of MOST_DRAWS is one."""
    for k in range(MOST_DRAWS):
        engine = load_engine(path)
        drawn = draw_truth(engine, seed, trial + k * FURTHER_DRAWS, (truth,), (kinds.SINGLE,))
        concealed = replace(
            drawn,
            trial=trial,
            kind=kinds.PLANNED,
            flights=[
                {c: v[int(RECORDED[0] * len(v)) : int(RECORDED[1] * len(v))] for c, v in f.items()}
                for f in drawn.flights[: drawn.training]
            ],
        )
        if _is_ambiguous(engine, concealed):
            break
    return concealed


def _is_ambiguous(engine: Engine, concealed: ConcealedTruth) -> bool:
    clean = trial_dataset(engine, concealed, record_trial(engine, concealed), clean=True)
    separation = separability(
        clean, concealed.causes, dict(concealed.health), concealed.withheld_terms, concealed.values
    )
    return bool(separation.ok and separation.total >= VISIBLE and separation.nearest < ALIAS)


def best_in_hindsight(
    engine: Engine,
    concealed: ConcealedTruth,
    recorded: TrialFlights,
    reported: ExplainAnswer,
    flights: Sequence[PlannedFlight],
) -> int:
    """Which of the flights sets what the truth reads, without noise, farthest from every reported alternative, each
    fitted to the first flights without noise; the first where no alternative can be fitted."""
    evidence = trial_dataset(engine, concealed, recorded, clean=True)
    course = PlannedEvidence(evidence, flights)
    rivals = [
        _explanation(engine, [Cause.from_json(c) for c in x["causes"]], evidence.records, x["coefficients"])
        for x, name in zip(reported.raw["explanations"], reported.aliases, strict=True)
        if name != cause_names(concealed.causes)
    ]
    base = identify_with(evidence, NULL_HYPOTHESIS, nuisance(evidence))
    fitted = fitted_alternatives(course, base, rivals)
    if not fitted:
        return 0
    flown = [
        {c: stack_column(course.evidence, c)[rows] for c in ("time_s", *engine.inputs, *hour_columns())}
        for _, rows in course.planned
    ]
    true = true_flight_readings(engine, replace(concealed, flights=flown), exact_model=True)
    problem = fitted[0].found.problem
    true = true[:, [list(engine.sensors).index(c) for c in problem.sensors]] / problem.sigma
    chances = []
    for rows, foreseen, whitening in predictions_by_flight(fitted, course):
        at = slice(rows.start - course.recorded, rows.stop - course.recorded)
        ok = np.isfinite(true[at]).all(axis=1)
        exact = PredictedReadings(np.where(ok[:, None], true[at], 0.0), np.zeros((*true[at].shape, 0)), ok)
        found = expected_separation(np.ones(1 + len(fitted)), [exact, *foreseen], whitening)
        chances.append(-1.0 if found is None else float(found.chance_each(RECORDS)[0]))
    return int(np.argmax(chances))


def _explanation(
    engine: Engine, causes: Sequence[Cause], records: int, coefficients: Mapping[str, Sequence[float]]
) -> Explanation:
    """What an explainer said, as something to fit."""
    values = {n: float(c[0]) for n, c in coefficients.items()}
    found: Hypothesis = causes_hypothesis(engine, causes, records, values)
    option = Option(EFFECT, found.label, "", CONSTANT, found)
    reported = tuple(Coefficient(n, "", v, 0.0, v, v) for n, v in values.items())
    return Explanation((option,), reported, 0.0, 0.0, 1.0, 0.0, 0.0)


PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT = "planned", "random", "airliner", "sweep", "hindsight"
ARMS = (PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT)
"""What is flown next."""
PLAN_STREAM = 5
"""Of random numbers, beside those of `sealed`: which flights are flown for comparison."""
RESOLVED = 0.95
"""Probability from which a truth that comes first counts as resolved from its alternatives."""


QuestionMaker = Callable[[ConcealedTruth, Path, Sequence[Path]], dict[str, Any]]
"""Makes the question of a trial from the engine file and the recordings."""


def run_planned(
    path: str, seed: int, trial: int, truth: str, explainer: QuestionProcess, asking: QuestionMaker
) -> dict[str, Any]:
    """Draw, ask for an answer and a plan, fly every arm, ask again, and mark the answers."""
    begun = process_time()
    concealed = draw_ambiguous(path, seed, trial, truth)
    engine = load_engine(path)
    recorded = record_trial(engine, concealed)
    t, arms = cause_names(concealed.causes), dict[str, Any]()
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        model, files = write_trial_files(Path(folder), engine, recorded, concealed.training)
        first = explainer.ask(asking(concealed, model, files) | {"task": PLAN})
        reported, seconds = ExplainAnswer.from_json(first), float(first.get("seconds", 0.0))
        flights = [flight_from_json(f) for f in first.get("flights", ())]
        ambiguous = (
            reported.status == IDENTIFIED and len(reported.aliases) > 1 and t in reported.aliases and bool(flights)
        )
        if ambiguous:
            best = best_in_hindsight(load_engine(path), concealed, recorded, reported, flights)
            chosen = choose_flights(flights, random_stream(seed, trial, PLAN_STREAM), best)
            answers: dict[int, tuple[ExplainAnswer, int]] = {}
            for arm, k in chosen.items():
                if k not in answers:
                    file = Path(folder) / f"next_{k}.csv"
                    flown = _fly(engine, concealed, flights[k], file)
                    answer = explainer.ask(asking(concealed, model, [*files, file]))
                    seconds += float(answer.get("seconds", 0.0))
                    answers[k] = ExplainAnswer.from_json(answer), flown
                after, flown = answers[k]
                arms[arm] = _answer_columns(after) | {
                    "flight": flights[k].words,
                    "records": flown,
                    "resolved": is_resolved(after, t),
                    "misled": after.status == IDENTIFIED and t not in after.aliases,
                }
    marks = {"ambiguous": ambiguous} | {f"resolved_{arm}": a["resolved"] for arm, a in arms.items()}
    if arms:
        plan, random, hindsight = (float(arms[a]["resolved"]) for a in (PLANNED, RANDOM, HINDSIGHT))
        marks |= {
            "misled": arms[PLANNED]["misled"],
            "foreseen": [float(first["chance"])],
            "less_twice_random": [plan - 2.0 * random],
            "less_hindsight": [plan - hindsight],
        }
    return {
        "trial": trial,
        "truth": truth,
        "kind": kinds.PLANNED,
        "causes": [c.to_json() for c in concealed.causes],
        "values": {n: short(v) for n, v in concealed.values.items()},
        "records": int(concealed.records.sum()),
        "failed_records": recorded.failed,
        "scorer_converged": True,
        "error": first.get("error", ""),
        **_answer_columns(reported),
        "chance": first.get("chance"),
        "arms": arms,
        "marks": marks,
        "seconds": round(process_time() - begun, 3),
        "explainer_seconds": round(seconds, 3),
    }


def choose_flights(flights: Sequence[PlannedFlight], rng: np.random.Generator, hindsight: int) -> dict[str, int]:
    """Which of the flights, the planned one first, each arm flies."""
    kinds_of = [f.kind for f in flights]
    sweeps = [k for k, kind in enumerate(kinds_of) if kind == SWEEP]
    order = sorted(range(len(flights)), key=lambda k: flights[k].words)  # not by what is known of them
    usual = [k for k in order if kinds_of[k] in (AIRLINER, WEATHER)]
    return {
        PLANNED: 0,
        RANDOM: order[int(rng.integers(len(order)))],
        ANOTHER: usual[int(rng.integers(len(usual)))],
        SWEPT: sorted(sweeps, key=lambda k: flights[k].words)[int(rng.integers(len(sweeps)))],
        HINDSIGHT: hindsight,
    }


def is_resolved(answer: ExplainAnswer, truth: CauseNames) -> bool:
    """Whether the truth stands alone, or comes first and is as good as certain."""
    if answer.status != IDENTIFIED or answer.aliases[0] != truth:
        return False
    return len(answer.aliases) == 1 or answer.probabilities[0] >= RESOLVED


def flight_from_json(reported: Mapping[str, Any]) -> PlannedFlight:
    """A planned flight from JSON."""
    return PlannedFlight(**{**reported, "corners": [Corner(**c) for c in reported["corners"]]})


def planned_columns(engine: Engine, concealed: ConcealedTruth, flight: PlannedFlight) -> dict[str, np.ndarray]:
    """Time, inputs and hours of the flight, which is flown when the recorded ones are over."""
    time, last = flight.time(RECORDS), concealed.flights[-1]
    hours = {c: last[c][-1] + time / 3600.0 for c in hour_columns()}
    return {"time_s": time, **flight.inputs(engine, RECORDS), **hours}


def _fly(engine: Engine, concealed: ConcealedTruth, flight: PlannedFlight, path: Path) -> int:
    """Write what the concealed truth reads; how many records it has."""
    flown = replace(
        concealed, flights=[planned_columns(engine, concealed, flight)], training=1, noise_seed=concealed.noise_seed + 1
    )
    (read,) = record_trial(engine, flown).noisy
    write_recording(path, read.columns)
    return len(read)


def _answer_columns(answer: ExplainAnswer) -> dict[str, Any]:
    return {
        "status": answer.status,
        "named": [" + ".join(sorted(a)) for a in answer.aliases],
        "probabilities": [short(p) for p in answer.probabilities],
    }


MARKERS = {kinds.LAW: mark_formula_trial, kinds.SEVERAL: mark_several_trial}
"""Marking of trials that are not marked by names alone."""


def run_trial(plan: TrialPlan, trial: int, explainer: QuestionProcess) -> dict[str, Any]:
    """Draw, record, ask, and mark the answer."""
    begun = process_time()
    path_of_model = draw_engine_file(plan.engines, plan.seed, trial)
    engine = load_engine(path_of_model)
    concealed = draw_truth(engine, plan.seed, trial, plan.truths, plan.kinds)
    if concealed.kind == kinds.PLANNED:
        asking = partial(_question, plan)
        return run_planned(path_of_model, plan.seed, trial, concealed.truth, explainer, asking)
    recorded = record_trial(engine, concealed)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        path, files = write_trial_files(Path(folder), engine, recorded, concealed.training)
        question = _question(plan, concealed, path, files)
        reported = [explainer.ask(question)]

        def located() -> Mapping[str, Any]:
            reported.append(explainer.ask(question | {"task": LOCATE}))
            return reported[-1]

        # what a trial finds must not depend on what was done before it
        fresh, answer = load_engine(path_of_model), ExplainAnswer.from_json(reported[0])
        if kinds.special_choice(concealed.kind) in MARKERS:
            scored = MARKERS[kinds.special_choice(concealed.kind)](fresh, concealed, recorded, answer)
        else:
            scored = mark_trial(fresh, concealed, recorded, answer, located)
        stands = not kinds.special_choice(concealed.kind)
        if stands and kinds.base_kind(concealed.kind) == kinds.NULL and concealed.truth == kinds.MAP_ERROR:
            reported.append(explainer.ask(question | {"model_error": 0.0}))
            if "error" not in reported[-1]:
                scored["marks"]["false_name_without_floor"] = reported[-1]["status"] in (
                    IDENTIFIED,
                    FORMULA,
                    HIDDEN_STATE,
                )
    if concealed.realistic is not None:
        scored |= {"engine": engine.name, "shape": concealed.realistic.shape, "airline": concealed.realistic.airline}
    if kinds.special_choice(concealed.kind):
        scored |= {"engine": engine.name}
    explaining = sum(t.get("seconds", 0.0) for t in reported)
    return scored | {"seconds": round(process_time() - begun, 3), "explainer_seconds": round(explaining, 3)}


def _question(plan: TrialPlan, concealed: ConcealedTruth, engine: Path, files: Sequence[Path]) -> dict[str, Any]:
    """The question: everything that the diagnosing process knows."""
    reported = concealed.realistic is None  # of realistic truths nothing is known but what the engine file says
    unknown = kinds.noise_variant(concealed.kind) == kinds.UNKNOWN_NOISE
    return {
        "task": EXPLAIN,
        "engine": str(engine),
        "recordings": [str(f) for f in files],
        "model_error": kinds.MODEL_ERROR[concealed.truth],
        "without": list(concealed.withheld_terms),
        "noise": ("estimate" if unknown else "specified") if reported else None,
        "rho": concealed.noise.rho if reported else 0.0,
        "input_noise": dict(concealed.noise.inputs or {}),
        "input_noise_share": dict(concealed.noise.input_shares or {}),
        "false_alarm": plan.false_alarm,
        "drivers": list(hour_columns()),
        "seed": plan.seed,
    }


def run_group(plan: TrialPlan, trials: Sequence[int]) -> list[dict[str, Any]]:
    """Trials with the diagnosing process of this worker."""
    return [run_trial(plan, trial, diagnoser()) for trial in trials]
