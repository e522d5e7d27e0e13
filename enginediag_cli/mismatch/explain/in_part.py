"""What of a mismatch stands, where nothing that is listed explains all of it.

Sets grow once more, now with unlisted physics, free curves at any place along any driver, among what may be a member
(`free_members`): in the one currency these compete with what is listed, and what they take is what nobody listed. A
listed member stands, and is named *in part*, where

- every set that is nearly as likely holds it: neither another listed one nor a free curve does in its place;
- it is needed beside what is unlisted, over the gate of detection, by how it repeats where noise is known from the
  recordings alone;
- its coefficients are what they are without the free curves: these do not carry it;
- it explains a fair share itself: a free curve is of second degree, and what it leaves of a large unlisted effect is no
  evidence of a small listed one. With a model-error floor most flights must be predicted better from the others.

The rest is told with its places, and as the share of the excess χ² that stays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.drivers import TIME
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.few import Few
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets
from enginediag_cli.mismatch.explain.judging import MOST_FLIGHTS, Fits
from enginediag_cli.mismatch.explain.members import identity
from enginediag_cli.mismatch.explain.stepwise import Stepwise
from enginediag_cli.mismatch.fit.freeform import Cell
from enginediag_cli.mismatch.fit.needed import is_needed
from enginediag_cli.mismatch.fit.options import FREE, Option
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.probability import NORMAL_95

NEARLY_AS_LIKELY = 4.6
"""ln of the odds, a hundred to one, within which sets must agree on a member. Judgement."""
FAIR_SHARE = 0.1
"""Of the excess χ², that what is named in part must explain at least. Judgement."""
MOVED = 0.25
"""Share of itself that a coefficient may move by, beside its error, between fits with and without free curves."""


@dataclass(frozen=True)
class Part:
    """What stands: an explanation of the named members alone, with coefficients as beside the unlisted rest;
    `unexplained`: share of the excess χ² that stays; `cells`: where, most surprising first."""

    explanation: Explanation
    unexplained: float
    cells: tuple[Cell, ...]


def in_part(search: Stepwise, few: Few | None = None) -> Part | None:
    """What stands of the best sets that were found; None where nothing does. `few`: where these are sets of few of many
    records, which are judged on all."""
    sets, fits = search.sets, search.sets.fits
    ranked = search.with_unlisted()
    best = ranked[0]
    within = [t for t in ranked if sets.evidence(t) > sets.evidence(best) - NEARLY_AS_LIKELY]
    standing = [o for o in listed(best) if _stands(o, best, within, sets)]
    alone = sets.fitted(tuple(standing))
    while standing and alone is not None:
        steady = [o for o in standing if _steady(o, best, alone)]
        if len(steady) == len(standing):
            break
        standing = steady
        alone = sets.fitted(tuple(standing))
    if not standing or alone is None or alone.at_bound:
        return None
    odds = {t.label: np.exp(sets.evidence(t) - sets.evidence(best)) for t in ranked}
    holding = [t for t in ranked if {identity(o) for o in standing} <= {identity(o) for o in t.options}]
    probability = sum(odds[t.label] for t in holding) / sum(odds.values())
    if few is not None and not few.are_all:
        fits, best, alone = few.whole, few.on_all(best, sets.unlisted), few.on_all(alone)
        if not (best.converged and alone.converged) or alone.at_bound:
            return None
        if not all(is_needed(best, o, _gate(o, fits)) and _steady(o, best, alone) for o in alone.options):
            return None
    excess = fits.base.objective - best.objective
    stays = alone.objective - best.objective
    if excess <= 0.0 or excess - stays < FAIR_SHARE * excess:
        return None
    flights = fits.flights(alone)
    if flights < MOST_FLIGHTS:
        return None
    left = remainder(alone, fits.library, fits.along_drivers)
    told = fits.explanation(alone, float(probability), left.surprise, flights)
    beside = {c.name: c for c in fits.explanation(best, 0.0, 0.0, 0.0).coefficients}
    told = replace(told, coefficients=tuple(beside.get(c.name, c) for c in told.coefficients))
    share = float(np.clip(stays / excess, 0.0, 1.0))
    # the likeliest set of few records holds less than all of them would show: against noise, then
    beyond = share if fits is sets.fits else left_by(alone.objective, fits.base) or 0.0
    return Part(told, max(share, beyond), left.cells)


def left_by(objective: float, base: HypothesisFit) -> float | None:
    """Share of the excess χ² of the base that stays with an `objective`. χ² of n readings is known to √(2n): what is
    within that of n is nothing; None where the base has no more."""
    chance = NORMAL_95 * float(np.sqrt(2.0 * base.projection.dof))
    excess, stays = base.objective - base.projection.dof, objective - base.projection.dof
    if stays <= chance:
        return 0.0 if base.objective > objective else None
    return float(min(stays / excess, 1.0))


def listed(trial: HypothesisFit) -> list[Option]:
    return [o for o in trial.options if o.kind != FREE]


def _stands(option: Option, best: HypothesisFit, within: Sequence[HypothesisFit], sets: FittedSets) -> bool:
    """Whether every likely set holds it, and the best one needs it."""
    if not all(identity(option) in map(identity, t.options) for t in within):
        return False
    fits, without = sets.fits, sets.fitted(tuple(o for o in best.options if o is not option))
    if without is None or set(option.hypothesis.names) & set(best.at_bound):
        return False
    gate = _gate(option, fits)
    told = [s.surprise for s in fits.left(without).scores if identity(s.option) == identity(option)]
    return is_needed(best, option, gate) and max(told, default=0.0) > gate


def _gate(option: Option, fits: Fits) -> float:
    return fits.detect.effects if option.driver != TIME else fits.detect.faults


def _steady(option: Option, best: HypothesisFit, alone: HypothesisFit) -> bool:
    """Whether its coefficients are the same in both fits, within their errors or a share of themselves."""
    for name in option.hypothesis.sizes:
        (v, s), (w, r) = best.coefficients[name], alone.coefficients[name]
        if abs(v - w) > max(float(np.hypot(s, r)), MOVED * abs(v)):
            return False
    return True
