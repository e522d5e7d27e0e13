"""Which of several sets of options are worth a fit to all records, where recordings are long."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.identification.gauss_newton import Fit
from enginediag_cli.mismatch.fit.identified import (
    NULL_HYPOTHESIS,
    FitBudget,
    IdentifiedHypothesis,
    Nuisance,
    fit_of_few,
    objective_of,
)
from enginediag_cli.mismatch.fit.options import Option, combine_options

MUCH_LESS_LIKELY, PLAINLY_SHARE = 30.0, 0.1
"""On few of many records, evenly chosen, a set behind the best by so much of χ², and this share of what the best gains,
is not fitted to all: five times ALIAS, and more than the choice of the records can turn round. Judgement."""

Set = tuple[Option, ...]


def reach_of(best: float, alone: float) -> FitBudget:
    """Beyond which objective a set is plainly worse than the best one, which has lowered it from `alone`, and beyond
    which it is not told beside that."""
    behind = best + MUCH_LESS_LIKELY
    return FitBudget(behind + PLAINLY_SHARE * max(alone - best, 0.0), behind)


def worth_fitting(
    sets: Sequence[Set], base: IdentifiedHypothesis, along: Nuisance
) -> tuple[list[tuple[Set, Fit | None]], list[tuple[Set, float]]]:
    """The sets with their fits to few of the records, from where a fit to all goes on (None where there are few anyway
    or that fit did not settle); and sets that are plainly worse already there, with the χ² that they are behind by."""
    alone = fit_of_few(base.evidence, NULL_HYPOTHESIS, along, base) if len(sets) > 1 else None
    if alone is None:
        return [(options, None) for options in sets], []
    found = [(options, fit_of_few(base.evidence, combine_options(*options), along, base)) for options in sets]
    best = min((objective_of(f) for _, f in found if f is not None), default=objective_of(alone))
    reach = reach_of(best, objective_of(alone)).hopeless - best
    behind = [objective_of(f) - best if f is not None else 0.0 for _, f in found]
    near = [pair for pair, worse in zip(found, behind, strict=True) if worse <= reach]
    return near, [(options, worse) for (options, _), worse in zip(found, behind, strict=True) if worse > reach]
