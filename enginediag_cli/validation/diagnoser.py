"""The diagnosing process of trials: it knows nothing but the questions and the files that it is given.

    python -m enginediag_cli.validation.diagnoser [PARENT]

It ends with its standard input, and at once with the process PARENT, when a number is given. One JSON object a line on
standard input is a question, one JSON object a line on standard output its answer. Tasks:

explain, locate, plan
    What is missing in the model, where, and which flight to fly next. The question holds paths of an engine file and of
    recordings, the accuracy of the maps, the terms that the library lacks, and what is known of the noise.
isolate
    What has changed, found as the commands do when no option is given: `identify ENGINE HEALTHY... -o NOMINAL`, then
    `isolate -n NOMINAL JUDGED`. The question holds paths of the engine file and of the recordings. The answer names
    places: a parameter of the engine, or `reading` and the column of an instrument.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from time import process_time
from typing import Any

from enginediag_cli.api.trends import trend
from enginediag_cli.engine.engine import Engine
from enginediag_cli.history.posterior import ChangeEvent
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal_file import write_nominal
from enginediag_cli.identification.problem import drop_repeats
from enginediag_cli.intake.loader import RecordingLoader, load_flights
from enginediag_cli.intake.selection import RecordingSource, open_baseline, required_columns
from enginediag_cli.isolation.diagnosis import DiagnosisOptions
from enginediag_cli.isolation.windows import IsolatedWindow, WindowIsolation
from enginediag_cli.mismatch.explain.answer import IDENTIFIED, Answer, Explanation
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.plan import advise_flights_for_explanations
from enginediag_cli.mismatch.explain.reach import near_alternatives
from enginediag_cli.mismatch.explain.unrecorded_search import hidden_search, refit_noise_without_switches
from enginediag_cli.mismatch.fit.evidence import Dataset, Noise
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.load import MismatchQuery, RecordedCase, load_case
from enginediag_cli.mismatch.fit.options import SENSOR_FAULT
from enginediag_cli.mismatch.locate.locate import locate
from enginediag_cli.mismatch.unrecorded.finding import HiddenFinding
from enginediag_cli.parallel import answer_questions
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.recordings.source import file_sha256
from enginediag_cli.residuals.files import WindowReader
from enginediag_cli.residuals.long_windows import RecentRecords
from enginediag_cli.residuals.monitor import build_monitor
from enginediag_cli.units import split_column
from enginediag_cli.validation.formula_marks import formula_entries, formula_json
from enginediag_cli.validation.kinds import HISTORY
from enginediag_cli.validation.trial_flights import causes_from_options, instrument_place
from enginediag_cli.validation.trials import ISOLATE, LOCATE, PLAN


def planned_as_json(search: Search, result: Answer) -> dict[str, Any]:
    """`flights`, best first, and the `chance` that the first of them resolves the alternatives."""
    advice = (
        advise_flights_for_explanations(search.base.found, near_alternatives(result, search.fitted))
        if result.status == IDENTIFIED
        else None
    )
    flights = [] if advice is None else [s for s in advice.suggestions if s.flight is not None]
    return {
        "flights": [asdict(s.flight) for s in flights if s.flight is not None],
        "chance": flights[0].chance if flights else None,
    }


SPECIFIED = "specified"
"""What a question says of noise that is as the engine file states it."""
CELLS = 10
"""Places that are kept in the answer; marks look at the first few."""


def explain(question: Mapping[str, Any]) -> dict[str, Any]:
    """What the library without some terms says of the recordings, or where the map puts what is missing."""
    begun = process_time()
    asked = MismatchQuery(
        model_error=question["model_error"],
        false_alarm=question["false_alarm"],
        drivers=tuple(question["drivers"]),
        noise=question["noise"],
        seed=question["seed"],
    )
    case = RecordedCase(question["engine"], RecordingSource(tuple(question["recordings"])), asked=asked)
    searched = question["task"] != LOCATE
    evidence = _set_known_noise(load_case(case, identified=searched).evidence, question)
    if not searched:
        located = locate(evidence)
        found: dict[str, Any] = {
            "cells": [_cell(p.cell) for p in located.places[:CELLS]],
            "drivers": [lead.driver for lead in located.leads if lead.told],
        }
    else:
        if question["noise"] is None:
            evidence = refit_noise_without_switches(evidence)
        effects = list(candidate_effects(evidence.engine, question["without"]))
        search = Search(evidence, effects, hidden_search(evidence))
        result = search.run()
        found = _answer_json(result)
        if question["task"] == PLAN:
            found |= planned_as_json(search, result)
    return found | {"seconds": process_time() - begun}


def _set_known_noise(evidence: Dataset, question: Mapping[str, Any]) -> Dataset:
    """The evidence with what is known of the noise: lag-1 correlation of all sensors, noise of the inputs. Where not
    even its size is said, all is as by default."""
    if question["noise"] is None:
        return evidence
    sigma = evidence.noise.sigma
    if question["noise"] == SPECIFIED and evidence.owed is not None:
        # of an engine that is identified first noise is what that fit left, and holds what is looked for
        sigma = evidence.owed.least.sigma
    rho = dict.fromkeys(sigma, question["rho"]) if question["rho"] else {}
    noise = Noise(sigma, rho, question["input_noise"], question["input_noise_share"])
    return replace(evidence, noise=noise)


def _answer_json(a: Answer) -> dict[str, Any]:
    return {
        "status": a.status,
        "reason": a.reason,
        "explanations": [_explanation(x) for x in a.explanations],
        "hidden": [_finding(h) for h in a.hidden],
        "gates": [float(g) for g in a.gates],
        "surprise": float(a.surprise),
        "objective": float(a.objective),
        "readings": int(a.readings),
        "rejected": {label: r.reason.value for label, r in a.rejected.items()},
        **formula_json(a),
    }


def _explanation(x: Explanation) -> dict[str, Any]:
    return {
        "causes": [c.to_json() for c in causes_from_options(x.options)],
        "kinds": [o.kind for o in x.options],
        "sensors": [d.target for o in x.options if o.kind == SENSOR_FAULT for d in o.hypothesis.discrepancies],
        "probability": float(x.probability),
        "gain": float(x.gain),
        "flights": float(x.flights),
        "left": float(x.left),
        "coefficients": {c.name: [float(c.value), float(c.low), float(c.high)] for c in x.coefficients},
        "laws": formula_entries(x),
    }


def _cell(c: Cell) -> dict[str, Any]:
    return {
        "location": c.location.name,
        "component": c.location.component,
        "driver": c.driver.name,
        "surprise": float(c.surprise),
    }


def _finding(f: object) -> dict[str, Any]:
    assert isinstance(f, HiddenFinding)
    return {
        "location": f.location.name,
        "component": f.location.component,
        "rivals": [r.name for r in f.rivals],
        "lr": float(f.lr),
        "is_switch": bool(f.is_switch),
        "sign": int(f.sign),
        "coefficient": float(f.coefficient),
        "number": f.number.tolist(),
        "amplitude": [float(x) for x in f.amplitude],
        "states": None if f.states is None else [float(x) for x in f.states],
    }


NOMINAL = "nominal.yaml"
FALSE_ALARM = 0.01
"""What `isolate` tests by when nobody chooses."""


@dataclass(frozen=True)
class IdentifiedEngine:
    """What `identify` made of healthy recordings: the nominal file, None where it did not converge."""

    engine: Engine
    nominal: Path | None
    reason: str
    seconds: float


@lru_cache(maxsize=1)
def identify_once(engine_path: Path, healthy: tuple[str, ...]) -> IdentifiedEngine:
    """The engine identified on these files; kept while questions are about the same ones."""
    begun = process_time()
    engine = load_engine(engine_path)
    intake = RecordingLoader(RecordingSource(healthy), required_columns(engine))
    training, _ = drop_repeats([f.recording for f in load_flights(intake)], (*engine.inputs, *engine.sensors))
    found = identify(engine, training)
    path = None
    if found.converged:
        path = engine_path.parent / NOMINAL
        # whether it is smooth, which `identify` finds out as well, is asked by `detect` alone
        write_nominal(found.nominal(engine_path.name, file_sha256(engine_path), {}), str(path))
    return IdentifiedEngine(engine, path, found.reason, process_time() - begun)


def isolate(question: Mapping[str, Any]) -> dict[str, Any]:
    """What is said of the recording that is to be judged."""
    begun = process_time()
    found = identify_once(Path(question["engine"]), tuple(question["healthy"]))
    reported: dict[str, Any] = {"identified": found.nominal is not None, "reason": found.reason}
    if found.nominal is not None:
        reported["windows"] = [_window(w, found.engine) for w in _windows(found.nominal, question["judged"])]
    return reported | {"identify_seconds": found.seconds, "seconds": process_time() - begun}


def _windows(nominal: Path, judged: str) -> Sequence[IsolatedWindow]:
    monitor = build_monitor(open_baseline(nominal), sensors=True, drifts=True)
    files = WindowReader(
        RecordingLoader(RecordingSource((judged,)), required_columns(monitor.engine, monitor.sensors)), monitor
    )
    kept = RecentRecords(monitor, short_windows=False)
    return list(WindowIsolation(files, DiagnosisOptions(), FALSE_ALARM, kept_records=kept).windows())


def _window(found: IsolatedWindow, engine: Engine) -> dict[str, Any]:
    """The answer for one window: verdict, sets of places with their probabilities (the answer first, with the
    instruments that are stuck or scatter), sizes; `changed`: of each place of the answer the probability that it
    changed, whatever else did."""
    reported: dict[str, Any] = {"verdict": found.verdict.including_instruments, "why": found.verdict.reason}
    reported["named"] = found.named
    if found.diagnosis is None:
        return reported
    result, place = found.diagnosis.result, _places(found.meaning, engine)
    sets = [(result.isolated, result.probability), *((r.parameters, r.probability) for r in result.alternatives)]
    reported["stands"] = found.diagnosis.adequacy.is_listed
    reported["fit"] = _finite(found.diagnosis.adequacy.fit)
    reported["sets"] = [[place[n] for n in names] for names, _ in sets]
    reported["sets"][0] += [instrument_place(fault.column) for fault in found.instruments]
    reported["probabilities"] = [_finite(p) for _, p in sets]
    reported["changed"] = [_finite(result.inclusion[n]) for n in result.isolated]
    reported["changed"] += [_finite(fault.probability) for fault in found.instruments]
    one_of = getattr(result, "ambiguity", None)  # the ambiguity group of which the answer is a member, if it is one
    if one_of is not None:
        reported["class"] = [[place[n] for n in (*one_of.shared, *member)] for member in one_of.members]
        reported["class_probability"] = _finite(one_of.probability)
    reported["left_out"] = result.alternatives_omitted
    reported["complete"] = result.complete
    reported["sizes"] = [
        [place[s.parameter], found.meaning[s.parameter].quantity, float(s.change), _finite(s.lower), _finite(s.upper)]
        for s in result.sizes
    ]
    return reported


def _places(known: Mapping[str, Parameter], engine: Engine) -> dict[str, str]:
    """Place of each parameter: its name, or of an instrument's error its column."""
    column = {f"sensor.{s.quantity}": c for c, s in engine.sensors.items()}
    column |= {f"input.{split_column(c)[0]}": c for c in (*engine.inputs, *engine.optional_inputs)}
    return {n: instrument_place(column[p.component]) if p.component in column else n for n, p in known.items()}


def _finite(x: float) -> float | None:
    return float(x) if abs(float(x)) < float("inf") else None


def follow_history(question: Mapping[str, Any]) -> dict[str, Any]:
    """What `trend` finds in the flights that are to be judged; no events where identification failed."""
    begun = process_time()
    found = identify_once(Path(question["engine"]), tuple(question["healthy"]))
    reported: dict[str, Any] = {"identified": found.nominal is not None, "error": found.reason, "events": []}
    if found.nominal is not None:
        begun = process_time()
        result = trend(found.nominal, [question["judged"]], events=question["maintenance"], work_scope="")
        result.rows  # noqa: B018 - computes
        reported |= {"error": "", "verdict": "no verdict"}
        for history in result.histories.values():
            reported["verdict"] = history.verdict
            reported["events"] = [_change_event(event) for event in history.events]
            reported["probability"] = history.posterior.probability
            reported["unlisted"] = history.posterior.unlisted
            reported["fit"] = history.posterior.check.ratio
    return reported | {"seconds": process_time() - begun}


def _change_event(event: ChangeEvent) -> dict[str, Any]:
    return {
        "probability": event.probability,
        "suspects": dict(event.suspects),
        "group": list(event.group),
        "shapes": dict(event.shapes),
        "growing": event.growing,
        "onset": event.onset,
        "onset_set": list(event.onset_set),
        "end": event.end,
        "changes": [
            {
                "name": x.name,
                "probability": x.probability,
                "now": [x.now, x.now_low, x.now_high],
                "largest": [x.largest, x.largest_low, x.largest_high],
            }
            for x in event.changes
        ],
    }


def answer(question: Mapping[str, Any]) -> dict[str, Any]:
    """The answer to a question, by its task."""
    if question["task"] == HISTORY:
        return follow_history(question)
    return isolate(question) if question["task"] == ISOLATE else explain(question)


if __name__ == "__main__":
    answer_questions(answer)
