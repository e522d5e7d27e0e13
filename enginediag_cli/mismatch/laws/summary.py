"""What is known of a law after a search: places and variables with their probabilities, the band of its curve."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.alike import places_alike
from enginediag_cli.mismatch.laws.band import EDGES, Weighed, band_of, curve_of
from enginediag_cli.mismatch.laws.finding import FittedLaw, LawFinding
from enginediag_cli.mismatch.laws.fitted import Fitted
from enginediag_cli.mismatch.laws.posterior import places_of, shares, variables_of_laws
from enginediag_cli.mismatch.laws.scan import seen_at
from enginediag_cli.mismatch.laws.search import LawSearch

UNLIKELY = 5.0
"""ln evidence by which a form is behind the best that has no say in the curve any more."""


def summary(search: LawSearch, best: Sequence[Fitted], base: HypothesisFit, noise_known: bool) -> LawFinding:
    """Of a search; `best`: laws that are told, likeliest first, and `base` the fit without them; `noise_known`: not
    from the recordings alone."""
    known = seen_at(best[0].trial.found, search.scan.known)
    if best[0].at_one_place:
        place = {p.name: p for p in locations(search.base.found)}
        weighed = [(place[where[0]], where[1], total) for where, total in search.totals().items()]
    else:
        # those that were fitted in any case are among the single ones
        apart = {f.trial.label: f for f in (*search.double, *search.single) if not f.at_one_place}
        weighed = [(f.laws[0].candidate.location, f.where[1], f.standing) for f in apart.values()]
    p = map(float, shares([e for _, _, e in weighed]))
    laws = [(place, groups, q) for (place, groups, _), q in zip(weighed, p, strict=True)]
    excess = max(base.objective - base.projection.dof, 0.0)
    told = [
        FittedLaw(p.option, p.candidate.location, p.candidate.formula, f.standing, float(share))
        for f, share in zip(best, shares([f.standing for f in best]), strict=True)
        for p in f.laws
    ]
    named = [k.variable.name for f in best for p in f.laws for k in p.candidate.formula.of]
    drop = base.objective - best[0].trial.objective
    own = best[0].at_the_first
    curve, _ = curve_of(own, best[0].trial, known)
    places = places_of(laws)
    first_is_likeliest = best[0].at_one_place and best[0].where[0] == places[0][0].name
    others = [p for p, _ in places[1:]] if first_is_likeliest else []
    alike = places_alike(search.base, places[0][0], curve, others) if others else ()
    unit = own[0].term.COEFFICIENTS[0].unit
    return LawFinding(
        tuple(told),
        tuple(places),
        tuple(variables_of_laws(laws, known, named)),
        excess,
        min(drop / max(excess, drop), 1.0) if noise_known else None,
        (float(np.quantile(curve, EDGES[0])), float(np.quantile(curve, EDGES[1]))),
        unit,
        band_of(_at_one_place(search, best), known, unit),
        alike,
        best[0].forms,
    )


def _at_one_place(search: LawSearch, best: Sequence[Fitted]) -> list[Weighed]:
    """Laws at the first one's place along the same variables, with their probabilities, as a band is of; none where
    several places are moved, or by what a variable was before."""
    if not best[0].at_one_place or best[0].remembers:
        return []
    # what is told may have been fitted to more records since
    here = next((f for f in search.single if f.trial.label == best[0].trial.label), best[0])
    same = [f for f in search.single if f.where == here.where and f.evidence > here.evidence - UNLIKELY]
    p = shares([f.evidence for f in same])
    return [(f.effects, f.trial, float(q)) for f, q in zip(same, p, strict=True)]
