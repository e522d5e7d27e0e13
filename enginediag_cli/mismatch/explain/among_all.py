"""How likely what is named is among all sets that were fitted, and not only among those that explain all.

    p = Σ exp ln p(y, S) of those named / Σ of these and of all rivals

A rival is a set that holds none of those named whole. One that leaves a misfit is a rival, too: what it shares with the
truth may be all that is listed of it. So is one with a free curve. Unlisted physics at one place is the same whatever
its form: how likely forms and variables are is weighed where a law is sought.

A rival that is the first one without some of its members, and nearly as likely, is told before it: that these act is
not settled, though what is left without them is over the gates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets
from enginediag_cli.mismatch.explain.members import Held, held
from enginediag_cli.mismatch.fit.trial import HypothesisFit

SETTLED = 3.0
"""Odds against the same without them from which members of a set are told to act. Judgement."""


def among_all(sets: FittedSets, named: Sequence[Explanation]) -> list[Explanation]:
    """What is named, in its order, with probabilities among all sets; before it the same without members that are not
    settled."""
    if not named:
        return []
    own = [held(x.options) for x in named]
    evidence = [sets.evidence(sets.fits.fitted[x.label]) for x in named]
    rivals: dict[Held, HypothesisFit] = {}
    for trial in sets.likeliest():
        has = held(trial.options)
        if not any(mine <= has for mine in own):
            rivals.setdefault(has, trial)
    told, all_told = np.logaddexp.reduce(evidence), sum(x.probability for x in named)
    total = np.logaddexp.reduce([told, *map(sets.evidence, rivals.values())])
    share = float(np.exp(told - total))
    found = [replace(x, probability=share * x.probability / all_told) for x in named]
    # of the first with all its forms: one of them by itself may be told first and be far from the likeliest
    first = np.logaddexp.reduce([e for e, mine in zip(evidence, own, strict=True) if mine == own[0]])
    for has, trial in rivals.items():
        if has and has < own[0] and sets.evidence(trial) > first - np.log(SETTLED):
            return [_simpler(sets, trial, float(np.exp(sets.evidence(trial) - total))), *found]
    return found


def _simpler(sets: FittedSets, trial: HypothesisFit, probability: float) -> Explanation:
    fits = sets.fits
    return fits.explanation(trial, probability, fits.left(trial).surprise, fits.flights(trial))
