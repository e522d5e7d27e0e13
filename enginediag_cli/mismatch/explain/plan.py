"""Which recording would tell explanations apart that these flights cannot.

Every rival is fitted to the flights, with everything that identification may absorb, and foresees what each of the
candidates would read (`planning.separation`): flights that the envelope allows, manoeuvres where a rival remembers,
records like those there are, these with an effect switched off and on by turns, or with a reading that the model can
give and nobody has recorded. Errors of the maps are free over all candidates as over the flights: where nobody has
flown they are as uncertain as the stated accuracy of the maps says.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.term import Effect
from enginediag_cli.isolation.planned_flights import (
    SAME,
    SENSOR,
    SWITCH,
    Adaptation,
    Outlook,
    PlannedFlight,
    Separation,
    Suggestion,
    best_first,
    flights,
    is_inside_flown,
    manoeuvres,
)
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.foreseen import PredictedReadings, Rival
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.extended import NUMBER
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis, input_values, nuisance, stack_column
from enginediag_cli.physics.law import Law
from enginediag_cli.progress import stage
from enginediag_cli.units import split_column

MOST_RIVALS = 6
"""Explanations that are told apart, likeliest first: beyond them a flight for one more tells little. Judgement."""
POINTS = 24
"""Records of a planned flight by which it is judged: its course has a few corners."""
SAMPLE = 60
"""Recorded points that stand for “records like these”."""
COMPUTED = 0.8
"""Share of a flight that every rival must have a prediction for."""
ALIKE = 1e-3
"""A further reading that is a constant times another one up to this share, such as behind a duct, tells nothing new."""


@dataclass(frozen=True)
class Advice:
    """What would tell `rivals`, by label with their probabilities, apart: suggestions, best first."""

    rivals: tuple[tuple[str, float], ...]
    suggestions: tuple[Suggestion, ...]

    @property
    def separates(self) -> bool:
        return any(np.isfinite(s.records) for s in self.suggestions)

    @property
    def best_flight(self) -> PlannedFlight | None:
        """The best of the suggestions that is a flight of its own, None where none helps at all."""
        return next((s.flight for s in self.suggestions if s.flight is not None and s.chance > 0.0), None)


def remembers(explanation: Explanation) -> bool:
    """Whether any of its effects does."""
    return any(MOMENT in e.term.INPUTS for o in explanation.options for e in o.hypothesis.effects)


@stage("looking for recordings that separate rivals")
def advise_flights_for_explanations(base: IdentifiedHypothesis, explanations: Sequence[Explanation]) -> Advice | None:
    """What would separate explanations fitted to the evidence of `base`; None where fewer than two of them are, or can
    be fitted again."""
    rivals = whatever_the_form(explanations)[:MOST_RIVALS]
    if len(rivals) < 2:
        return None
    engine, flown = base.evidence.engine, input_values(base.evidence)
    chosen = flights(engine, flown)
    if any(map(remembers, rivals)):
        chosen += manoeuvres(engine, flown)
    course = PlannedEvidence(base.evidence, chosen)
    fitted = fitted_alternatives(course, base, rivals)
    if len(fitted) < 2:
        return None
    weight = np.array([max(r.explanation.probability, 1e-300) for r in fitted])
    found = [*_of_flights(fitted, weight, course), *_of_records(fitted, weight, course)]
    told = tuple((r.label, float(p)) for r, p in zip(fitted, weight, strict=True))
    return Advice(told, tuple(best_first(found)))


def whatever_the_form(explanations: Sequence[Explanation]) -> list[Explanation]:
    """Of laws of the same variables at the same places the likeliest stands for all, with the probability of all: which
    form a law has changes little where one can fly, and nothing of what is to be done."""
    found: dict[object, Explanation] = {}
    for k, x in enumerate(explanations):
        effects = [e for o in x.options for e in o.hypothesis.effects]
        others = frozenset(o.label for o in x.options if not o.hypothesis.effects)
        key = (frozenset(map(_what, effects)), others) if any(isinstance(e.term, Law) for e in effects) else k
        first = found.setdefault(key, x)
        if first is not x:
            found[key] = replace(first, probability=first.probability + x.probability)
    return list(found.values())


def _what(effect: Effect) -> tuple[str, frozenset[str]]:
    """A law's place and variables; any other effect by its name."""
    law = effect.term
    return (law.acts.leaf, frozenset(law.variables)) if isinstance(law, Law) else (effect.label, frozenset())


def fitted_alternatives(
    course: PlannedEvidence, base: IdentifiedHypothesis, explanations: Sequence[Explanation]
) -> list[Rival]:
    """Explanations fitted to the flights of a course, from a fit to these; those that converged."""
    along = nuisance(course.evidence)
    return [r for r in (Rival(x, course.evidence, along, base) for x in explanations) if r.converged]


class PlannedEvidence:
    """The evidence with all planned flights behind it, as records without readings: the curves of what the maps may err
    by are then the same over both. `planned`: each flight with its places; `recorded`: records before them."""

    def __init__(self, evidence: Dataset, chosen: Sequence[PlannedFlight]):
        self.recorded = evidence.records
        self.flown = input_values(evidence)
        engine, past = evidence.engine, any(MOMENT in f.columns for f in evidence.flights)
        self.planned: list[tuple[PlannedFlight, slice]] = []
        parts, at = [], self.recorded
        for flight in chosen:
            # what remembers needs the whole course
            parts.append(columns_of(engine, evidence, flight, flight.records if past else POINTS))
            self.planned.append((flight, slice(at, at + len(parts[-1]["time_s"]))))
            at = self.planned[-1][1].stop
        self.evidence = evidence
        if parts:
            unread = {c: np.full(at - self.recorded, np.nan) for c in evidence.noise.sigma}
            columns = {c: np.concatenate([p[c] for p in parts]) for c in parts[0]}
            further = Flight("further records", evidence.engines[0], {**columns, **unread})
            self.evidence = replace(evidence, flights=(*evidence.flights, further))

    def inputs(self, rival: Rival, rows: slice | np.ndarray) -> dict[str, np.ndarray]:
        """What the rival's model is told at these places."""
        model = rival.found.model
        known = {c: np.nan for c in model.inputs} | dict(model.optional_inputs)
        return {
            c: stack_column(self.evidence, c, default)[rows]
            for c, default in known.items()
            if c not in rival.curves and c != NUMBER
        }


def columns_of(engine: Engine, evidence: Dataset, flight: PlannedFlight, records: int) -> dict[str, np.ndarray]:
    """Columns (records,) of a planned flight without its readings: time, inputs, and what else is recorded as it was at
    the end of the flights; hours go on."""
    time = flight.time(records)
    found = {"time_s": time, **flight.inputs(engine, records)}
    last = [f for f in evidence.flights if f.engine == evidence.engines[0]][-1]
    for c, values in last.columns.items():
        given = np.asarray(values)
        if c in found or c in evidence.noise.sigma or c == MOMENT or given.dtype.kind not in "fiub":
            continue
        end = float(given[np.isfinite(given)][-1]) if np.isfinite(given).any() else np.nan
        gone = time / 3600.0 if split_column(c)[1] == "h" else np.zeros(records)
        found[c] = flight.constants.get(c, end) + gone
    if any(MOMENT in f.columns for f in evidence.flights):
        found[MOMENT] = engine.tapes.add(found)
    return found


def expected_separation(
    weight: np.ndarray, foreseen: Sequence[PredictedReadings], whitening: np.ndarray
) -> Outlook | None:
    """What typical records promise of rivals with these weights; None where too few can be computed."""
    ok = np.all([f.ok for f in foreseen], axis=0)
    if ok.mean() < COMPUTED:
        return None
    W = whitening[ok]
    readings = [(W @ f.readings[ok][:, :, None])[:, :, 0] for f in foreseen]
    adapting = [Adaptation.from_columns(W @ f.columns[ok]) for f in foreseen]
    pairs: list[list[Separation | None]] = [
        [None if g == h else a.separation(readings[h] - readings[g]) for g, a in enumerate(adapting)]
        for h in range(len(foreseen))
    ]
    return Outlook(weight / weight.sum(), pairs)


def predictions_by_flight(
    rivals: Sequence[Rival], course: PlannedEvidence
) -> Iterator[tuple[slice, list[PredictedReadings], np.ndarray]]:
    """Of each planned flight its places, what each rival foresees of it, and the whitening of its records."""
    if not course.planned:
        return
    all_of_them = slice(course.recorded, course.evidence.records)
    inputs = [course.inputs(r, all_of_them) for r in rivals]
    foreseen = [r.foresee(i, all_of_them) for r, i in zip(rivals, inputs, strict=True)]
    whitening = rivals[0].whitening(inputs[0], all_of_them)
    for _, rows in course.planned:
        own = slice(rows.start - course.recorded, rows.stop - course.recorded)
        yield rows, [f.at(own) for f in foreseen], whitening[own]


def _of_flights(rivals: Sequence[Rival], weight: np.ndarray, course: PlannedEvidence) -> Iterator[Suggestion]:
    given = {c: stack_column(course.evidence, c) for c in course.evidence.engine.inputs}
    for (flight, _), (rows, foreseen, whitening) in zip(
        course.planned, predictions_by_flight(rivals, course), strict=True
    ):
        found = expected_separation(weight, foreseen, whitening)
        if found is not None:
            known = is_inside_flown(course.flown, {c: v[rows] for c, v in given.items()})
            yield Suggestion.from_outlook(found, flight.kind, flight.words, flight, known)


def _of_records(rivals: Sequence[Rival], weight: np.ndarray, course: PlannedEvidence) -> Iterator[Suggestion]:
    """More records like these, as they are, with an effect switched off in every other, and with a further sensor."""
    number = rivals[0].found.number
    rows = number[np.unique(np.linspace(0, len(number) - 1, SAMPLE).astype(int))]
    inputs = [course.inputs(r, rows) for r in rivals]
    whitening = rivals[0].whitening(inputs[0], rows)
    m, more = whitening.shape[1], _readable(rivals[0], inputs[0], rows)
    wide = [r.foresee(i, rows, more=more) for r, i in zip(rivals, inputs, strict=True)]
    as_they_are = [r.foresee(i, rows) for r, i in zip(rivals, inputs, strict=True)]
    found = expected_separation(weight, as_they_are, whitening)
    if found is not None:
        yield Suggestion.from_outlook(found, SAME)
    for label in _switchable(rivals):
        off = [r.foresee(i, rows, without=label) for r, i in zip(rivals, inputs, strict=True)]
        both = [_joined(a, b) for a, b in zip(as_they_are, off, strict=True)]
        found = expected_separation(weight, both, np.concatenate([whitening, whitening]))
        if found is not None:
            yield Suggestion.from_outlook(found, SWITCH, label)
    wider = np.zeros((len(rows), m + 1, m + 1))
    wider[:, :m, :m], wider[:, m, m] = whitening, 1.0
    for j, column in enumerate(more):
        found = expected_separation(weight, [f.read_by([*range(m), m + j]) for f in wide], wider)
        if found is not None:
            yield Suggestion.from_outlook(found, SENSOR, column)


def _switchable(rivals: Sequence[Rival]) -> list[str]:
    """Labels of effects of the rivals that somebody can switch off."""
    effects = (e for r in rivals for e in r.found.hypothesis.effects)
    return list(dict.fromkeys(e.label for e in effects if e.term.SWITCHES))


def _joined(a: PredictedReadings, b: PredictedReadings) -> PredictedReadings:
    return PredictedReadings(
        np.concatenate([a.readings, b.readings]),
        np.concatenate([a.columns, b.columns]),
        np.concatenate([a.ok, b.ok]),
    )


def _readable(rival: Rival, inputs: Mapping[str, np.ndarray], rows: np.ndarray) -> list[str]:
    """Each station's temperature and pressure and each speed that is not recorded and says what no other reading
    does."""
    problem, engine = rival.found.problem, rival.found.evidence.engine
    known = {*problem.sensors, *engine.inputs}
    columns = [c for c in engine.model_columns if c not in known and re.fullmatch(r"[TP]\d+_(K|Pa)|N\d+_rpm", c)]
    if not columns:
        return []
    given = {**inputs, **{c: v[rows] for c, v in rival.curves.items()}}
    p = rival.found.model.predict(given, rival.found.theta, sensors=(*problem.sensors, *columns))
    y = p.y[np.asarray(p.ok)]
    alike, result = [*y[:, : len(problem.sensors)].T], []
    for column, own in zip(columns, y[:, len(problem.sensors) :].T, strict=True):
        if not np.isfinite(own).all() or any(np.ptp(own / a) < ALIKE * abs(np.mean(own / a)) for a in alike):
            continue
        alike.append(own)
        result.append(column)
    return result
