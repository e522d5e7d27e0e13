"""The answer of `explain` as rows (one per coefficient), as one JSON object, and as CSV files of curves."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE, IDENTIFIED, UNEXPLAINED
from enginediag_cli.report.controls import control_document, control_rows
from enginediag_cli.report.explanations import headline, sentences, why_rejected
from enginediag_cli.report.isolation_rows import flip_cells, flip_words
from enginediag_cli.report.laws import advice_document, follows_document, law_document
from enginediag_cli.report.outputs.discrepancy import EXPLAIN

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.answer import Explanation
    from enginediag_cli.mismatch.explain.curves import Curve
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.fit.freeform import Cell
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding

COLUMNS = EXPLAIN.names
CELLS = 10
"""Places in the file; the first few are of interest."""


def rows(story: ExplanationResult) -> Iterator[dict[str, Any]]:
    """One row per coefficient of every explanation; of unlisted physics one per fitted place; else one row."""
    a = story.answer
    empty = dict.fromkeys(COLUMNS) | {"status": a.status}
    if story.control is not None:
        yield from ({**empty, "status": IDENTIFIED, **row} for row in control_rows(story.control))
    if a.explanations:
        for rank, x in enumerate(a.explanations, start=1):
            yield from ({**empty, "rank": rank, **row} for row in _explanation_rows(x))
    elif a.status == UNEXPLAINED and story.curves:
        for rank, c in enumerate(story.curves, start=1):
            yield {
                **empty,
                "rank": rank,
                "kind": "free form",
                "name": c.location.name,
                "component": c.location.component,
                "driver": c.driver.name,
                "gain": c.gain if c.converged else None,
                "statement": c.reason or "unlisted physics",
            }
    elif a.status == HIDDEN_STATE:
        for rank, f in enumerate(story.hidden, start=1):
            yield {**empty, "rank": rank, **_hidden_row(f)}
    else:
        yield {**empty, "statement": a.reason}


def document(story: ExplanationResult, provenance: tuple[str, ...]) -> dict[str, Any]:
    """Everything as one object."""
    a = story.answer
    return {
        "schema": EXPLAIN.id,
        "status": a.status,
        "reason": a.reason,
        "kind": a.kind,
        "sentences": list(sentences(story)),
        "control": None if story.control is None else control_document(story.control),
        "explanations": [_explanation(x) for x in a.explanations],
        "unexplained": a.unexplained,
        "in_part": a.in_part,
        "rest": [_place(c) for c in a.rest[:CELLS]],
        "rejected": {label: why_rejected(r) for label, r in a.rejected.items()},
        "places": [_place(c) for c in a.cells[:CELLS]],
        "curves": [_curve(c) for c in story.curves],
        "law": None if a.law is None else law_document(a.law),
        "follows": [follows_document(x) for x in story.follows],
        "hidden": [
            _hidden_row(f)
            | {
                "effects": [e.label for e in effects],
                "switches": [
                    {
                        "flight": s.flight,
                        "record": s.record + 1,
                        "after_s": _told(s.before_s),
                        "until_s": _told(s.time_s),
                        "earliest_s": _told(s.earliest_s),
                        "latest_s": _told(s.latest_s),
                        "on": s.on,
                        "probability": s.probability,
                    }
                    for s in f.switches
                ],
                "doubtful": [
                    {
                        "flight": d.flight,
                        "records": d.records,
                        "first_s": _told(d.first_s),
                        "last_s": _told(d.last_s),
                    }
                    for d in f.doubtful
                ],
            }
            for f, effects in zip(story.hidden, story.hidden_effects, strict=True)
        ],
        "unseen": list(a.unseen),
        "unseen_kinds": [
            {"name": u.label, "driver": u.driver.word, "switching_from": _told(u.switching), "unit": u.unit}
            for u in story.unseen
        ],
        "map_accuracy": story.evidence.settings.map_accuracy,
        "floor": [vars(c) for c in story.floor],
        "advice": advice_document(story.advice),
        **flip_cells(story.flips, flip_words(story)),
        "chi2": a.objective,
        "readings": a.readings,
        "searched": None if story.searched is None else vars(story.searched),
        "gated": None if story.gated is None else vars(story.gated),
        "surprise": a.surprise,
        "gates": list(a.gates),
        "provenance": list(provenance),
    }


def _told(value: float) -> float | None:
    """A time or size, None where there is none."""
    return value if math.isfinite(value) else None


def curve_rows(curves: tuple[Curve, ...]) -> Iterator[dict[str, Any]]:
    """Points of the fitted curves."""
    for c in curves:
        if c.converged:
            for value, d, error in zip(c.values, c.change, c.standard_error, strict=True):
                yield {
                    "location": c.location.name,
                    "driver": c.driver.name,
                    "driver_unit": c.driver.unit,
                    "driver_value": float(value),
                    "change": float(d),
                    "standard_error": float(error),
                    "unit": c.unit,
                }


def amplitude_rows(story: ExplanationResult) -> Iterator[dict[str, Any]]:
    """Amplitude of the first hidden effect, record by record, with its state where it is a switch, and when it
    changed to that."""
    if not story.hidden:
        return
    f = story.hidden[0]
    flights = story.evidence.flights
    sizes = np.array([len(next(iter(x.columns.values()))) for x in flights])
    first = np.concatenate([[0], np.cumsum(sizes)])
    of = np.searchsorted(first, f.number, side="right") - 1
    changes = {(s.flight, s.record): s for s in f.switches}
    for k, number in enumerate(f.number):
        flight, record = flights[of[k]], int(number - first[of[k]])
        time = flight.columns.get("time_s")
        change = changes.get((flight.label, record))
        yield {
            "engine": flight.engine,
            "flight": flight.label,
            "record": flight.place(record) + 1,
            "time_s": None if time is None else float(time[record]),
            "location": f.location.name,
            "amplitude": float(f.amplitude[k]),
            "standard_error": float(f.standard_error[k]),
            "unit": f.unit,
            "probability_on": None if f.states is None else float(f.states[k]),
            "changed_from_s": None if change is None else _told(change.between[0]),
            "changed_to_s": None if change is None else _told(change.between[1]),
        }


def _explanation_rows(x: Explanation) -> Iterator[dict[str, Any]]:
    by_name = {c.name: c for c in x.coefficients}
    for o in x.options:
        texts = [e.term.STATEMENT for e in o.hypothesis.effects]
        for name in o.hypothesis.names:
            c = by_name[name]
            yield {
                "kind": o.kind,
                "name": o.label,
                "component": o.component,
                "driver": o.driver.word,
                "probability": x.probability,
                "coefficient": c.name,
                "value": c.value,
                "standard_error": c.standard_error,
                "low": c.low,
                "high": c.high,
                "unit": c.unit,
                "gain": x.gain,
                "flights_gained": x.flights,
                "statement": texts[0] if texts else headline(x),
            }


def _explanation(x: Explanation) -> dict[str, Any]:
    return {
        "name": x.label,
        "in_words": headline(x),
        "kinds": [o.kind for o in x.options],
        "components": [o.component for o in x.options],
        "drivers": [o.driver.word for o in x.options],
        "probability": x.probability,
        "gain": x.gain,
        "chi2": x.objective,
        "flights_gained": x.flights,
        "left": x.left,
        "coefficients": [vars(c) for c in x.coefficients],
        "rates": list(_rates(x)),
    }


def _rates(x: Explanation) -> Iterator[dict[str, Any]]:
    """Coefficients that are times for a full scale, as the rates that they stand for."""
    by_name = {c.name: c for c in x.coefficients}
    for effect in (e for o in x.options for e in o.hypothesis.effects):
        for declared in effect.term.amplitudes():
            c = by_name[effect.parameter_name(declared.name)]
            rate = effect.site.rate(declared, c.value)
            if rate is not None:
                low, high = (effect.site.rate(declared, bound) for bound in (c.high, c.low))
                yield {
                    "coefficient": c.name,
                    "rate": rate[0],
                    "low": low[0] if low else None,
                    "high": high[0] if high else None,
                    "unit": rate[1],
                }


def _place(c: Cell) -> dict[str, Any]:
    return {
        "location": c.location.name,
        "component": c.location.component,
        "driver": c.driver.name,
        "surprise": c.surprise,
        "statistic": c.score.statistic,
        "dof": c.score.dof,
    }


def _curve(c: Curve) -> dict[str, Any]:
    return {
        "location": c.location.name,
        "component": c.location.component,
        "driver": c.driver.name,
        "driver_unit": c.driver.unit,
        "unit": c.unit,
        "gain": c.gain,
        "dof": c.dof,
        "converged": c.converged,
        "reason": c.reason,
        "values": c.values,
        "change": c.change,
        "standard_error": c.standard_error,
    }


def _hidden_row(f: HiddenFinding) -> dict[str, Any]:
    return {
        "kind": "switch" if f.is_switch else "unrecorded driver",
        "name": f.location.name,
        "component": f.location.component,
        "driver": "not recorded",
        "value": f.coefficient,
        "low": f.interval[0],
        "high": f.interval[1],
        "unit": f.unit,
        "gain": 2.0 * f.lr,
        "statement": f"rivals: {', '.join(r.name for r in f.rivals)}" if f.rivals else "",
        "log_likelihood_ratio": f.lr,
        "threshold": f.threshold,
    }
