"""`explain`: its tables, rows of coefficients, of curves and of amplitudes, and its document."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from enginediag_cli.mismatch.explain.answer import HIDDEN_STATE, IDENTIFIED, UNEXPLAINED
from enginediag_cli.report.tables import Table, column, part
from enginediag_cli.report.tables.answers import FLIPS, flip_cells, flip_words
from enginediag_cli.report.tables.explanation_text import (
    control_document,
    control_rows,
    headline,
    rejection_words,
    sentences,
)
from enginediag_cli.report.tables.formulas import advice_document, follows_document, law_document

if TYPE_CHECKING:
    from enginediag_cli.mismatch.explain.answer import Explanation
    from enginediag_cli.mismatch.explain.curves import Curve
    from enginediag_cli.mismatch.explain.story import ExplanationResult
    from enginediag_cli.mismatch.fit.freeform import Cell
    from enginediag_cli.mismatch.unrecorded.hidden import HiddenFinding


_PLACE = (
    column("location", "text", "where it acts"),
    column("component", "text", "component of the place"),
    column("driver", "text", "what it varies with"),
)

EXPLAIN: Table[Mapping[str, Any]] = Table(
    "explain",
    1,
    "one row per coefficient of every explanation; of unlisted physics one per place that was fitted",
    (
        column("status", "text", "what the answer is"),
        column("rank", "integer?", "rank of the explanation, from 1"),
        column("kind", "text?", "effect, fault, law, switch, control, free form …"),
        column("name", "text?", "name of the explanation, effect@place"),
        column("component", "text?", "component where it acts"),
        column("driver", "text?", "what it varies with"),
        column("probability", "number?", "probability of the explanation"),
        column("coefficient", "text?", "the coefficient of this row"),
        column("value", "number?", "its value", "of the coefficient"),
        column("standard_error", "number?", "its standard error", "of the coefficient"),
        column("low", "number?", "lower end of its 95 % interval", "of the coefficient"),
        column("high", "number?", "upper end of its 95 % interval", "of the coefficient"),
        column("unit", "text?", "unit of the coefficient"),
        column("gain", "number?", "fall of χ², twice the log likelihood"),
        column("flights_gained", "number?", "share of flights that gain"),
        column("statement", "text?", "the same in words"),
    ),
    terminal=(
        "rank",
        "name",
        "probability",
        "coefficient",
        "value",
        "low",
        "high",
        "unit",
        "status",
        "driver",
        "kind",
        "gain",
        "statement",
    ),
    document=(
        column("schema", "text", "name and version of this schema"),
        column("status", "text", "what the answer is"),
        column("reason", "text?", "why there is none"),
        column("kind", "text?", "kind of the leading explanation"),
        column("sentences", "texts", "the answer in words"),
        *FLIPS,
        part("control", "a control that the model lacks", empty=True),
        part(
            "explanations",
            "those that are indistinguishable, likeliest first",
            (
                column("name", "text", "effect@place, joined by +"),
                column("in_words", "text", "the same in words"),
                column("kinds", "texts", "of each member"),
                column("components", "texts", "of each member"),
                column("drivers", "texts", "of each member"),
                column("probability", "number?", "probability of the explanation"),
                column("gain", "number?", "fall of χ², twice the log likelihood"),
                column("chi2", "number?", "χ² with it"),
                column("flights_gained", "number?", "share of flights that gain"),
                part("coefficients", "with intervals", many=True),
                part("rates", "coefficients that are times, as rates", many=True),
            ),
            many=True,
        ),
        part("rest", "places at which something is left", _PLACE, many=True),
        part("rejected", "explanations that were rejected, and why"),
        part("places", "leading places of the map", _PLACE, many=True),
        part("curves", "free-form curves", _PLACE, many=True),
        part("law", "an empirical correction (formula) that is not in the library", empty=True),
        part("hidden", "what acts without a recorded driver", many=True),
        part(
            "follows",
            "what the first of these follows after all, as a switch with hysteresis, best first",
            (
                column("variable", "text", "name of the variable"),
                column("way", "text", "above, below, falling or rising: when it is on"),
                column("lower", "number", "lower threshold", "of the variable, or its design value"),
                column("upper", "number", "upper threshold", "of the variable, or its design value"),
                column("turns", "integer", "changes of state that they give back"),
                column("changes", "integer", "of so many"),
                column("wrong", "integer", "records that they have wrong"),
                column("records", "integer", "of so many"),
                column("gain", "number", "by how much shorter this is to write down", "nat"),
            ),
            many=True,
        ),
        column("map_accuracy", "number", "stated accuracy of the maps"),
        part("advice", "what to record next", empty=True),
        column("chi2", "number?", "χ² without any explanation"),
        column("readings", "integer?", "readings that it is of"),
        column("provenance", "texts", "what made it, as the head of a CSV"),
    ),
)

CURVES: Table[Mapping[str, Any]] = Table(
    "explain/curves",
    1,
    "explain --curves: points of the fitted free-form curves",
    (
        column("location", "text", "where it acts"),
        column("driver", "text", "what it varies with"),
        column("driver_unit", "text", "unit of the driver"),
        column("driver_value", "number", "value of the driver", "driver_unit"),
        column("change", "number", "change there", "unit"),
        column("standard_error", "number", "its standard error", "unit"),
        column("unit", "text", "unit of the change"),
    ),
)

AMPLITUDES: Table[Mapping[str, Any]] = Table(
    "explain/amplitudes",
    1,
    "explain --amplitudes: an effect without a recorded driver, record by record",
    (
        column("engine", "text", "engine of the record"),
        column("flight", "text", "flight of the record"),
        column("record", "integer", "number of the record in its flight, from 1"),
        column("time_s", "number?", "time of the record", "s"),
        column("location", "text", "where it acts"),
        column("amplitude", "number", "its amplitude", "unit"),
        column("standard_error", "number", "its standard error", "unit"),
        column("unit", "text", "unit of the amplitude"),
        column("probability_on", "number?", "probability that the switch is on"),
        column("changed_from_s", "number?", "earliest time at which it changed to this", "s"),
        column("changed_to_s", "number?", "latest time at which it changed to this", "s"),
    ),
)
CELLS = 10
"""Places in the file; the first few are of interest."""


def rows(story: ExplanationResult) -> Iterator[dict[str, Any]]:
    """One row per coefficient of every explanation; of unlisted physics one per fitted place; else one row."""
    a = story.answer
    empty = dict.fromkeys(EXPLAIN.names) | {"status": a.status}
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
        "rejected": {label: rejection_words(r) for label, r in a.rejected.items()},
        "places": [_place(c) for c in a.cells[:CELLS]],
        "curves": [_curve(c) for c in story.curves],
        "law": None if a.law is None else law_document(a.law),
        "follows": [follows_document(x) for x in story.follows],
        "hidden": [_hidden_document(f, e) for f, e in zip(story.hidden, story.hidden_effects, strict=True)],
        "unseen": list(a.unseen),
        "unseen_kinds": [
            {"name": u.label, "driver": u.driver.word, "switching_from": _finite(u.switching), "unit": u.unit}
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


def _hidden_document(f: HiddenFinding, effects: Sequence[Any]) -> dict[str, Any]:
    """An effect without a recorded driver: its row, when it switched, and where its state is uncertain."""
    switches = [
        {
            "flight": s.flight,
            "record": s.record + 1,
            "after_s": _finite(s.before_s),
            "until_s": _finite(s.time_s),
            "earliest_s": _finite(s.earliest_s),
            "latest_s": _finite(s.latest_s),
            "on": s.on,
            "probability": s.probability,
        }
        for s in f.switches
    ]
    doubtful = [
        {"flight": d.flight, "records": d.records, "first_s": _finite(d.first_s), "last_s": _finite(d.last_s)}
        for d in f.doubtful
    ]
    return _hidden_row(f) | {"effects": [e.label for e in effects], "switches": switches, "doubtful": doubtful}


def _finite(value: float) -> float | None:
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
            "changed_from_s": None if change is None else _finite(change.between[0]),
            "changed_to_s": None if change is None else _finite(change.between[1]),
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
        "statement": f"alternatives: {', '.join(r.name for r in f.rivals)}" if f.rivals else "",
        "log_likelihood_ratio": f.lr,
        "threshold": f.threshold,
    }
