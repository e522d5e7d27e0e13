"""What the model lacks, from recordings: the fit without effects, the search, refits of the leaders, the answer."""

from __future__ import annotations

from dataclasses import replace
from time import process_time
from typing import NamedTuple

import numpy as np

from enginediag_cli.discrepancy.answer import DiscrepancyAnswer, answer_from_search
from enginediag_cli.discrepancy.candidates import MAP
from enginediag_cli.discrepancy.linearised import LinearProblem, fit_with_members, fit_without_effects, linearise
from enginediag_cli.discrepancy.search import LEAST_EVIDENCE, BeamSearch, SearchResult
from enginediag_cli.mismatch.fit.evidence import Dataset
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis

REFITS = 2
"""Fits of the likeliest set with the nonlinear model, each from the last."""
REFIT_WITHIN, MOST_REFITTED = 6.0, 4
"""ln evidence behind the likeliest, and number of sets, that are refined at its fit."""


def explain_discrepancy(dataset: Dataset) -> DiscrepancyAnswer:
    """Search recordings for what the model lacks.

    Parameters
    ----------
    dataset : Dataset
        Engine, flights, stated noise and priors.

    Returns
    -------
    DiscrepancyAnswer
        The likeliest set, the posterior over everything that was compared, and the trace.
    """
    return search_and_refit(dataset).answer


class Searched(NamedTuple):
    """The answer, and CPU seconds of fit and derivatives, of the search, and of the refits."""

    answer: DiscrepancyAnswer
    fit_s: float
    search_s: float
    refit_s: float


def search_and_refit(dataset: Dataset) -> Searched:
    """As `explain_discrepancy`, with what it cost."""
    times = [process_time()]
    found = fit_without_effects(dataset)
    problem = linearise(found)
    times.append(process_time())
    search = BeamSearch(problem)
    result = search.run()
    times.append(process_time())
    problem = refit_leaders(found, search, result)
    answer = answer_from_search(result, problem)
    times.append(process_time())
    return Searched(answer, *np.diff(times))


def refit_leaders(found: IdentifiedHypothesis, search: BeamSearch, result: SearchResult) -> LinearProblem:
    """The leaders refined where the likeliest of them is fitted with the nonlinear model: a large effect bends the fit
    without it, and derivatives change with it. Sets of the result are replaced; returns the last linear problem."""
    problem = search.problem
    for _ in range(REFITS):
        best = result.sufficient[0]
        if best.evidence - result.nothing.evidence < LEAST_EVIDENCE:
            break
        moved = [
            (problem.places[c.place], best.amplitude(k)[problem.pooled])
            for k, c in enumerate(best.members)
            if c.kind != MAP
        ]
        if not moved:
            break
        found = fit_with_members(found, moved)
        new = linearise(found)
        if not found.settled or len(new) != len(problem):
            break
        problem = replace(new, keep=new.keep & problem.keep)
        again = BeamSearch(problem)
        near = [s for s in result.sufficient if s.members and s.evidence > best.evidence - REFIT_WITHIN][:MOST_REFITTED]
        others = [s for s in result.sets if all(s is not x for x in near)]
        refined = again.refine_again(near, result.nothing)
        result.sets[:] = sorted([*refined, *others], key=lambda s: -s.evidence)
        result.trace += again.trace
    return problem
