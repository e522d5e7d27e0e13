"""Which single options are worth a refit, by their scores at the fit without them."""

from __future__ import annotations

from collections.abc import Sequence

from enginediag_cli.drivers import RATE, TIME
from enginediag_cli.mismatch.fit.options import OptionScore

SHORTLIST = 6
"""Single options that are refitted, best by score first. Judgement: a refit costs a second or more, and the score at a
fit without the option knows the order only roughly."""
FURTHER = 3
"""Effects of what changes that are refitted beside them, best by plain score first."""
SHARE_OF_BEST, BEHIND_BEST = 0.3, 30.0
"""An option whose score T, the drop of χ² by projection, is below this share of the best one's less so much is not
worth a refit: the score at a fit without the option errs, but not by that. Judgement."""


def shortlisted(scores: Sequence[OptionScore], plain: Sequence[OptionScore] = ()) -> list[OptionScore]:
    """The best few, T > SHARE_OF_BEST T_max − BEHIND_BEST; of the onsets of one parameter, and of
    the trials of one effect, only the best. `plain`: scores before they were weighed by how they repeat;
    of effects of what changes, whose linear score spreads where they are large, the best by these are refitted, too."""
    top = max((s.score.statistic for s in scores if s.surprise > 0), default=0.0)
    chosen: list[OptionScore] = []
    for s in scores:
        same = any(
            s.option.driver == c.option.driver == TIME
            and s.option.component == c.option.component
            and s.option.hypothesis.discrepancies[0].target == c.option.hypothesis.discrepancies[0].target
            for c in chosen
        ) or any(c.option.label == s.option.label for c in chosen)
        if s.surprise > 0 and s.score.statistic > SHARE_OF_BEST * top - BEHIND_BEST and not same:
            chosen.append(s)
        if len(chosen) == SHORTLIST:
            break
    moving = sorted((s for s in plain if s.option.driver == RATE and s.surprise > 0), key=lambda s: -s.score.statistic)
    for s in moving:
        if s.score.statistic < SHARE_OF_BEST * moving[0].score.statistic:
            break
        if not any(c.option.label == s.option.label for c in chosen) and len(chosen) < SHORTLIST + FURTHER:
            chosen.append(s)
    return chosen
