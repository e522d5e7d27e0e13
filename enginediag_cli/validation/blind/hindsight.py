"""The flight that would have told most, had the truth been known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.explain.answer import Coefficient, Explanation
from enginediag_cli.mismatch.explain.foreseen import Foreseen
from enginediag_cli.mismatch.explain.plan import Course, fitted_rivals, of_flights, outlook
from enginediag_cli.mismatch.fit.identified import NO_HYPOTHESIS, Hypothesis, identify_with, nuisance, stacked
from enginediag_cli.mismatch.fit.options import EFFECT, Option
from enginediag_cli.planning.flights import RECORDS, PlannedFlight
from enginediag_cli.validation.blind.causes import Cause, hypothesis, key
from enginediag_cli.validation.blind.flights import hour_columns
from enginediag_cli.validation.blind.opened import evidence_of
from enginediag_cli.validation.blind.recorded import Recorded, readings
from enginediag_cli.validation.blind.score import Said
from enginediag_cli.validation.blind.sealed import Sealed


def best_in_hindsight(
    engine: Engine, sealed: Sealed, recorded: Recorded, told: Said, flights: Sequence[PlannedFlight]
) -> int:
    """Which of the flights sets what the truth reads, without noise, farthest from every rival that was `told`, each
    fitted to the first flights without noise; the first where no rival can be fitted."""
    evidence = evidence_of(engine, sealed, recorded, clean=True)
    course = Course(evidence, flights)
    rivals = [
        _explanation(engine, [Cause.from_json(c) for c in x["causes"]], evidence.records, x["coefficients"])
        for x, name in zip(told.raw["explanations"], told.aliases, strict=True)
        if name != key(sealed.causes)
    ]
    base = identify_with(evidence, NO_HYPOTHESIS, nuisance(evidence))
    fitted = fitted_rivals(course, base, rivals)
    if not fitted:
        return 0
    flown = [
        {c: stacked(course.evidence, c)[rows] for c in ("time_s", *engine.inputs, *hour_columns())}
        for _, rows in course.planned
    ]
    true = readings(engine, replace(sealed, flights=flown), exact_model=True)
    problem = fitted[0].found.problem
    true = true[:, [list(engine.sensors).index(c) for c in problem.sensors]] / problem.sigma
    chances = []
    for rows, foreseen, whitening in of_flights(fitted, course):
        at = slice(rows.start - course.recorded, rows.stop - course.recorded)
        ok = np.isfinite(true[at]).all(axis=1)
        exact = Foreseen(np.where(ok[:, None], true[at], 0.0), np.zeros((*true[at].shape, 0)), ok)
        found = outlook(np.ones(1 + len(fitted)), [exact, *foreseen], whitening)
        chances.append(-1.0 if found is None else float(found.given(RECORDS)[0]))
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
