"""What the model-error floor costs: scores and detectable sizes of every effect with the floor and without it.

The price of not taking an error of the maps for missing physics is that effects that look like one are no longer
seen. With c⊥ the effect's column after projection on everything that is identified,

    T = (c⊥ᵀe)²/|c⊥|²      smallest size of λ = 25:  a = 5/|c⊥|

once with the floor's columns among what is identified, and once without.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import EFFECT, Option, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.progress import stage

VISIBLE = 25.0
"""Non-centrality at which an effect is found nearly always."""


@dataclass(frozen=True)
class FloorCost:
    """Of one effect: score T, and the size of its first coefficient that is visible (λ = VISIBLE), in `unit`; infinite
    where the nuisance absorbs it."""

    label: str
    unit: str
    score: float
    score_without: float
    visible: float
    visible_without: float


@stage("weighing the accuracy of the maps")
def tolerance_cost(base: HypothesisFit, library: Sequence[Option]) -> list[FloorCost]:
    """Of the library's effects at the fit that carries none, most expensive first; empty without a floor, or when the
    model cannot be fitted without it."""
    evidence = base.found.evidence
    if evidence.settings.map_accuracy <= 0.0:
        return []
    bare = replace(evidence, settings=replace(evidence.settings, map_accuracy=0.0))
    found = identify_with(bare, NULL_HYPOTHESIS, nuisance(bare), base.found)
    if not found.converged:
        return []
    effects = [o for o in library if o.kind == EFFECT]
    with_floor = {s.option.label: s for s in option_scores(base.found, base.projection, effects)}
    without = option_scores(found, Projection(found), effects)
    result = []
    for s in without:
        other = with_floor[s.option.label]
        unit = s.option.hypothesis.effects[0].term.amplitudes()[0].unit
        T = [0.0 if x.score.absorbed else x.score.statistic for x in (other, s)]
        size = [np.inf if x.score.absorbed else float(np.sqrt(VISIBLE) / x.score.length) for x in (other, s)]
        result.append(FloorCost(s.option.label, unit, T[0], T[1], size[0], size[1]))
    return sorted(result, key=lambda c: c.score - c.score_without)
