"""A trial of planning: explain, plan, fly the plan on the concealed truth, explain again.

Beside the planned flight others are flown of the same candidates: one at random, an airliner flight, a power sweep, and
the best in hindsight, which sets the real truth farthest from its nearest rival. All have as many records.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.answer import NAMED
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.planning.flights import AIRLINER, RECORDS, SWEEP, WEATHER, Corner, PlannedFlight
from enginediag_cli.recordings.table import Recording
from enginediag_cli.recordings.write import CsvWriter, output
from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.blind.ambiguous import draw_ambiguous
from enginediag_cli.validation.blind.causes import Key, key
from enginediag_cli.validation.blind.correspondent import PLAN, Correspondent
from enginediag_cli.validation.blind.flights import hour_columns
from enginediag_cli.validation.blind.hindsight import best_in_hindsight
from enginediag_cli.validation.blind.recorded import record, write_open
from enginediag_cli.validation.blind.score import Said
from enginediag_cli.validation.blind.sealed import Sealed, stream

PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT = "planned", "random", "airliner", "sweep", "hindsight"
Record = dict[str, Any]

ARMS = (PLANNED, RANDOM, ANOTHER, SWEPT, HINDSIGHT)
"""What is flown next."""
PLAN_STREAM = 5
"""Of random numbers, beside those of `sealed`: which flights are flown for comparison."""
RESOLVED = 0.95
"""Probability from which a truth that comes first counts as told from its rivals."""


Asking = Callable[[Sealed, Path, Sequence[Path]], dict[str, Any]]
"""What the explainer is told of a trial: from the engine file and the recordings."""


def run_planned(path: str, seed: int, trial: int, truth: str, explainer: Correspondent, asking: Asking) -> Record:
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
        ambiguous = told.status == NAMED and len(told.aliases) > 1 and t in told.aliases and bool(flights)
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
                    "misled": after.status == NAMED and t not in after.aliases,
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
    if said.status != NAMED or said.aliases[0] != truth:
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
