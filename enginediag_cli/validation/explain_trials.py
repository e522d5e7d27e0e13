"""One blind trial from its seed to its marks.

What is concealed in a trial of planning: an effect that the first flights show, but cannot tell from others.

The first flights are recorded in cruise alone, as many an airline records them. Drawn again until there is such a
rival, from random numbers of its own.

The flight that would have told most, had the truth been known.

A trial of planning: explain, plan, fly the plan on the concealed truth, explain again.

Beside the planned flight others are flown of the same candidates: one at random, an airliner flight, a power sweep, and
the best in hindsight, which sets the real truth farthest from its nearest rival. All have as many records.

Trials over processes: each worker keeps an explainer of its own.

The journal of blind trials: every trial with its sealed answer and its marks, by number.
"""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli import __version__
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
from enginediag_cli.parallel import QuestionProcess, run_tasks
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.planning.flights import AIRLINER, RECORDS, SWEEP, WEATHER, Corner, PlannedFlight
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, output
from enginediag_cli.validation import kinds
from enginediag_cli.validation.causes import VISIBLE, Cause, Key, hypothesis, key
from enginediag_cli.validation.concealed_effects import (
    Recorded,
    Sealed,
    draw,
    engine_of,
    readings,
    record,
    stream,
    write_open,
)
from enginediag_cli.validation.formula_marks import opened_law
from enginediag_cli.validation.marks import Said, evidence_of, opened
from enginediag_cli.validation.separability import separability
from enginediag_cli.validation.several_marks import opened_several
from enginediag_cli.validation.trial_flights import hour_columns
from enginediag_cli.validation.trials import EXPLAIN, LOCATE, PLAN, Form, Journal, diagnoser

RECORDED = (0.3, 0.75)
"""Share of a flight, from and to, that is recorded before the plan: its cruise."""
MOST_DRAWS = 80
"""Draws of a trial: one in eight is ambiguous with exact maps, one in thirty with wrong ones."""
FURTHER_DRAWS = 1_000_000
"""Draw k of trial t is draw t + k FURTHER_DRAWS of the seed: no trial of its own."""


def draw_ambiguous(path: str, seed: int, trial: int, truth: str) -> Sealed:
    """A visible single effect with at least one rival that is expected within the alias set of an answer from the first
    flights; the last draw where none of MOST_DRAWS is one."""
    for k in range(MOST_DRAWS):
        engine = load_engine(path)
        drawn = draw(engine, seed, trial + k * FURTHER_DRAWS, (truth,), (kinds.SINGLE,))
        sealed = replace(
            drawn,
            trial=trial,
            kind=kinds.PLANNED,
            flights=[
                {c: v[int(RECORDED[0] * len(v)) : int(RECORDED[1] * len(v))] for c, v in f.items()}
                for f in drawn.flights[: drawn.training]
            ],
        )
        if _is_ambiguous(engine, sealed):
            break
    return sealed


def _is_ambiguous(engine: Engine, sealed: Sealed) -> bool:
    clean = evidence_of(engine, sealed, record(engine, sealed), clean=True)
    far = separability(clean, sealed.causes, dict(sealed.health), sealed.without, sealed.values)
    return bool(far.ok and far.total >= VISIBLE and far.nearest < ALIAS)


def best_in_hindsight(
    engine: Engine, sealed: Sealed, recorded: Recorded, told: Said, flights: Sequence[PlannedFlight]
) -> int:
    """Which of the flights sets what the truth reads, without noise, farthest from every rival that was `told`, each
    fitted to the first flights without noise; the first where no rival can be fitted."""
    evidence = evidence_of(engine, sealed, recorded, clean=True)
    course = PlannedEvidence(evidence, flights)
    rivals = [
        _explanation(engine, [Cause.from_json(c) for c in x["causes"]], evidence.records, x["coefficients"])
        for x, name in zip(told.raw["explanations"], told.aliases, strict=True)
        if name != key(sealed.causes)
    ]
    base = identify_with(evidence, NULL_HYPOTHESIS, nuisance(evidence))
    fitted = fitted_alternatives(course, base, rivals)
    if not fitted:
        return 0
    flown = [
        {c: stack_column(course.evidence, c)[rows] for c in ("time_s", *engine.inputs, *hour_columns())}
        for _, rows in course.planned
    ]
    true = readings(engine, replace(sealed, flights=flown), exact_model=True)
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
    found: Hypothesis = hypothesis(engine, causes, records, values)
    option = Option(EFFECT, found.label, "", CONSTANT, found)
    told = tuple(Coefficient(n, "", v, 0.0, v, v) for n, v in values.items())
    return Explanation((option,), told, 0.0, 0.0, 1.0, 0.0, 0.0)


PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT = "planned", "random", "airliner", "sweep", "hindsight"
ARMS = (PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT)
"""What is flown next."""
PLAN_STREAM = 5
"""Of random numbers, beside those of `sealed`: which flights are flown for comparison."""
RESOLVED = 0.95
"""Probability from which a truth that comes first counts as told from its rivals."""


Asking = Callable[[Sealed, Path, Sequence[Path]], dict[str, Any]]
"""What the explainer is told of a trial: from the engine file and the recordings."""


def run_planned(
    path: str, seed: int, trial: int, truth: str, explainer: QuestionProcess, asking: Asking
) -> dict[str, Any]:
    """Draw, ask for an answer and a plan, fly every arm, ask again, and mark."""
    begun = process_time()
    sealed = draw_ambiguous(path, seed, trial, truth)
    engine = load_engine(path)
    recorded = record(engine, sealed)
    t, arms = key(sealed.causes), dict[str, Any]()
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        model, files = write_open(Path(folder), engine, recorded, sealed.training)
        first = explainer.ask(asking(sealed, model, files) | {"task": PLAN})
        told, seconds = Said.of(first), float(first.get("seconds", 0.0))
        flights = [flight_of(f) for f in first.get("flights", ())]
        ambiguous = told.status == IDENTIFIED and len(told.aliases) > 1 and t in told.aliases and bool(flights)
        if ambiguous:
            best = best_in_hindsight(load_engine(path), sealed, recorded, told, flights)
            chosen = chosen_flights(flights, stream(seed, trial, PLAN_STREAM), best)
            answers: dict[int, tuple[Said, int]] = {}
            for arm, k in chosen.items():
                if k not in answers:
                    file = Path(folder) / f"next_{k}.csv"
                    flown = _fly(engine, sealed, flights[k], file)
                    answer = explainer.ask(asking(sealed, model, [*files, file]))
                    seconds += float(answer.get("seconds", 0.0))
                    answers[k] = Said.of(answer), flown
                after, flown = answers[k]
                arms[arm] = _told(after) | {
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
        "causes": [c.as_json() for c in sealed.causes],
        "values": {n: _short(v) for n, v in sealed.values.items()},
        "records": int(sealed.records.sum()),
        "failed_records": recorded.failed,
        "scorer_converged": True,
        "error": first.get("error", ""),
        **_told(told),
        "chance": first.get("chance"),
        "arms": arms,
        "marks": marks,
        "seconds": round(process_time() - begun, 3),
        "explainer_seconds": round(seconds, 3),
    }


def chosen_flights(flights: Sequence[PlannedFlight], rng: np.random.Generator, hindsight: int) -> dict[str, int]:
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


def is_resolved(said: Said, truth: Key) -> bool:
    """Whether the truth stands alone, or comes first and is as good as certain."""
    if said.status != IDENTIFIED or said.aliases[0] != truth:
        return False
    return len(said.aliases) == 1 or said.probabilities[0] >= RESOLVED


def flight_of(told: Mapping[str, Any]) -> PlannedFlight:
    """A planned flight from JSON."""
    return PlannedFlight(**{**told, "corners": [Corner(**c) for c in told["corners"]]})


def columns_of(engine: Engine, sealed: Sealed, flight: PlannedFlight) -> dict[str, np.ndarray]:
    """Time, inputs and hours of the flight, which is flown when the recorded ones are over."""
    time, last = flight.time(RECORDS), sealed.flights[-1]
    hours = {c: last[c][-1] + time / 3600.0 for c in hour_columns()}
    return {"time_s": time, **flight.inputs(engine, RECORDS), **hours}


def _fly(engine: Engine, sealed: Sealed, flight: PlannedFlight, path: Path) -> int:
    """Write what the concealed truth reads; how many records it has."""
    flown = replace(sealed, flights=[columns_of(engine, sealed, flight)], training=1, noise_seed=sealed.noise_seed + 1)
    (read,) = record(engine, flown).noisy
    with output(path) as file:
        CsvWriter(file).write(Recording(dict(read.columns)))
    return len(read)


def _told(said: Said) -> dict[str, Any]:
    return {
        "status": said.status,
        "named": [" + ".join(sorted(a)) for a in said.aliases],
        "probabilities": [_short(p) for p in said.probabilities],
    }


def _short(x: float) -> float | None:
    return float(f"{x:.6g}") if np.isfinite(x) else None


OPENED = {kinds.LAW: opened_law, kinds.SEVERAL: opened_several}
"""How trials are marked that are not marked by names alone."""


@dataclass(frozen=True)
class Plan:
    """What is asked for: trials of these truths and kinds on one engine, or each on one of `engines`; the explainer's
    nominal false-alarm rate."""

    engine: str
    seed: int
    truths: tuple[str, ...]
    kinds: tuple[str, ...]
    false_alarm: float = 0.05
    engines: tuple[str, ...] = ()


def run_trial(plan: Plan, trial: int, explainer: QuestionProcess) -> dict[str, Any]:
    """Draw, record, ask, open the answer and mark it."""
    begun = process_time()
    path_of_model = engine_of(plan.engines or (plan.engine,), plan.seed, trial)
    engine = load_engine(path_of_model)
    sealed = draw(engine, plan.seed, trial, plan.truths, plan.kinds)
    if sealed.kind == kinds.PLANNED:
        asking = partial(_question, plan)
        return run_planned(path_of_model, plan.seed, trial, sealed.truth, explainer, asking)
    recorded = record(engine, sealed)
    with tempfile.TemporaryDirectory(prefix="enginediag_") as folder:
        path, files = write_open(Path(folder), engine, recorded, sealed.training)
        question = _question(plan, sealed, path, files)
        told = [explainer.ask(question)]

        def located() -> Mapping[str, Any]:
            told.append(explainer.ask(question | {"task": LOCATE}))
            return told[-1]

        # what a trial finds must not depend on what was done before it
        fresh, said = load_engine(path_of_model), Said.of(told[0])
        if kinds.choice(sealed.kind) in OPENED:
            scored = OPENED[kinds.choice(sealed.kind)](fresh, sealed, recorded, said)
        else:
            scored = opened(fresh, sealed, recorded, said, located)
        stands = not kinds.choice(sealed.kind)
        if stands and kinds.base(sealed.kind) == kinds.NULL and sealed.truth == kinds.MAP_ERROR:
            told.append(explainer.ask(question | {"model_error": 0.0}))
            if "error" not in told[-1]:
                scored["marks"]["false_name_without_floor"] = told[-1]["status"] in (IDENTIFIED, FORMULA, HIDDEN_STATE)
    if sealed.realistic is not None:
        scored |= {"engine": engine.name, "shape": sealed.realistic.shape, "airline": sealed.realistic.airline}
    if kinds.choice(sealed.kind):
        scored |= {"engine": engine.name}
    explaining = sum(t.get("seconds", 0.0) for t in told)
    return scored | {"seconds": round(process_time() - begun, 3), "explainer_seconds": round(explaining, 3)}


def _question(plan: Plan, sealed: Sealed, engine: Path, files: Sequence[Path]) -> dict[str, Any]:
    """All that the explainer is told."""
    told = sealed.realistic is None  # of realistic truths nothing is known but what the engine file says
    unknown = kinds.variant(sealed.kind) == kinds.UNKNOWN_NOISE
    return {
        "task": EXPLAIN,
        "engine": str(engine),
        "recordings": [str(f) for f in files],
        "model_error": kinds.MODEL_ERROR[sealed.truth],
        "without": list(sealed.without),
        "noise": ("estimate" if unknown else "specified") if told else None,
        "rho": sealed.noise.rho if told else 0.0,
        "input_noise": dict(sealed.noise.inputs or {}),
        "input_noise_share": dict(sealed.noise.input_shares or {}),
        "false_alarm": plan.false_alarm,
        "drivers": list(hour_columns()),
        "seed": plan.seed,
    }


def run_trials(plan: Plan, todo: Iterable[int], jobs: int) -> Generator[tuple[int, dict[str, Any]], None, None]:
    """Number and record of each trial as it is finished, in any order."""
    return run_tasks(partial(_run, plan), todo, jobs)


def _run(plan: Plan, trial: int) -> dict[str, Any]:
    return run_trial(plan, trial, diagnoser())


Record = Mapping[str, Any]


def plan_key(plan: Plan) -> str:
    """Hash of all that a trial depends on but its number."""
    said = f"{__version__} {plan.seed} {plan.truths} {plan.kinds} {plan.false_alarm}"
    digest = hashlib.sha256(said.encode())
    for engine in dict.fromkeys((plan.engine, *plan.engines)):
        digest.update(b"\0" + Path(engine).read_bytes())
    return digest.hexdigest()


def trials_journal(path: Path, key: str) -> Journal[int, Record]:
    """The journal at `path` of the plan with this key."""
    return Journal(path, key, _FORM)


def _line(number: int, record: Record) -> Record:
    return record


def _entry(line: Mapping[str, Any]) -> tuple[int, Record]:
    if not isinstance(line["trial"], int) or "marks" not in line:
        raise ValueError("not a trial")
    return line["trial"], line


_FORM = Form(
    "plan",
    "a file of trials",
    "trials of another seed, choice or engine, or of this one before it was changed",
    "--trials-output",
    _line,
    _entry,
)
