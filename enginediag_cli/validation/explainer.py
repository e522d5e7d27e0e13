"""The explainer of blind trials: a process of its own that knows nothing but what it is asked.

    python -m enginediag_cli.validation.explainer [PARENT]

It ends with its standard input, and at once with the process PARENT, when a number is given.
One JSON object a line on standard input: whether to explain or to locate, paths of an engine file and of recordings,
the accuracy of the maps, the terms that its library lacks, and what is known of the noise. One JSON object a line on
standard output: the answer.

The explainer's plan, as it is handed over: every flight that it would consider, best first.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from time import process_time
from typing import Any

from enginediag_cli.intake.selection import Source
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
from enginediag_cli.physics.registry import candidates
from enginediag_cli.validation.causes import causes_of
from enginediag_cli.validation.formula_marks import entries, law_told
from enginediag_cli.validation.trials import LOCATE, PLAN, answer_questions


def planned_as_json(search: Search, said: Answer) -> dict[str, Any]:
    """`flights`, best first, and the `chance` that the first of them tells."""
    advice = (
        advise_flights_for_explanations(search.base.found, near_alternatives(said, search.fitted))
        if said.status == IDENTIFIED
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


def answer(question: Mapping[str, Any]) -> dict[str, Any]:
    """What the library without some terms says of the recordings, or where the map puts what is missing."""
    begun = process_time()
    asked = MismatchQuery(
        model_error=question["model_error"],
        false_alarm=question["false_alarm"],
        drivers=tuple(question["drivers"]),
        noise=question["noise"],
        seed=question["seed"],
    )
    case = RecordedCase(question["engine"], Source(tuple(question["recordings"])), asked=asked)
    searched = question["task"] != LOCATE
    evidence = _with_known_noise(load_case(case, identified=searched).evidence, question)
    if not searched:
        located = locate(evidence)
        found: dict[str, Any] = {
            "cells": [_cell(p.cell) for p in located.places[:CELLS]],
            "drivers": [lead.driver for lead in located.leads if lead.told],
        }
    else:
        if question["noise"] is None:
            evidence = refit_noise_without_switches(evidence)
        effects = list(candidates(evidence.engine, question["without"]))
        search = Search(evidence, effects, hidden_search(evidence))
        said = search.run()
        found = _as_json(said)
        if question["task"] == PLAN:
            found |= planned_as_json(search, said)
    return found | {"seconds": process_time() - begun}


def _with_known_noise(evidence: Dataset, question: Mapping[str, Any]) -> Dataset:
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


def _as_json(a: Answer) -> dict[str, Any]:
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
        **law_told(a),
    }


def _explanation(x: Explanation) -> dict[str, Any]:
    return {
        "causes": [c.as_json() for c in causes_of(x.options)],
        "kinds": [o.kind for o in x.options],
        "sensors": [d.target for o in x.options if o.kind == SENSOR_FAULT for d in o.hypothesis.discrepancies],
        "probability": float(x.probability),
        "gain": float(x.gain),
        "flights": float(x.flights),
        "left": float(x.left),
        "coefficients": {c.name: [float(c.value), float(c.low), float(c.high)] for c in x.coefficients},
        "laws": entries(x),
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


if __name__ == "__main__":
    answer_questions(answer)
