"""One line of the score sheet: which marks of which trials it tells of, and how."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from enginediag_cli.validation.blind import kinds
from enginediag_cli.validation.rates import mean, median, rate

Record = Mapping[str, Any]

RATE, MEAN, MEDIAN, RIGHT_LESS_STATED = "rate", "mean", "median", "right less stated"
"""What a line says of its marks."""


class Score:
    """One line of the sheet: the mark that it counts, the kinds of trials of its headline, and its target for
    each truth ("" for none; what it means is in words, as the targets are). Sizes are means, not rates; `how`: one of
    those above, where it is neither."""

    def __init__(
        self,
        mark: str,
        headline: tuple[str, ...],
        same_model: str = "",
        map_error: str = "",
        realistic: str = "",
        size: bool = False,
        how: str = "",
    ):
        self.mark, self.headline, self.how = mark, headline, how or (MEAN if size else RATE)
        self.target = {kinds.SAME_MODEL: same_model, kinds.MAP_ERROR: map_error, kinds.REALISTIC: realistic}

    @property
    def size(self) -> bool:
        """Whether it is no rate."""
        return self.how != RATE


def rate_of(score: Score, records: Sequence[Record]) -> dict[str, Any]:
    """A score of these trials, of those that have its mark."""
    found = [r["marks"][score.mark] for r in records if score.mark in r["marks"]]
    if not found or score.how == RATE:
        return rate(found)
    if score.how == RIGHT_LESS_STATED:
        return right_less_stated([(p, bool(right)) for p, right in found], 0.0, np.inf)
    return (median if score.how == MEDIAN else mean)([float(np.mean(x)) for x in found])


def right_less_stated(said: Sequence[tuple[float, bool]], low: float, high: float) -> dict[str, Any]:
    """Rate of right names less the mean of what was stated, of those stated from `low` to `high`."""
    own = [(p, right) for p, right in said if low <= p < high]
    found = rate(right for _, right in own)
    if not own:
        return found
    mean_stated = float(np.mean([p for p, _ in own]))
    return found | {name: found[name] - mean_stated for name in ("rate", "low", "high")}
