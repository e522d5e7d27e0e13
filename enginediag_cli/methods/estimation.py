"""Parameter estimation: re-estimate all parameters, name those that a Wald test finds changed (end of section 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.detection.glr import threshold
from enginediag_cli.isolation.minmax import single_minmax
from enginediag_cli.methods.by_score import LEVEL_FIELD, LINEARISE_FIELD, ByScore
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class Estimation(ByScore):
    """The Wald statistic of one of all parameters, Δθ̂_i² / (I⁻¹)_ii, is its min-max statistic.

    `level` of a single test; that of the detection test where None.
    """

    HELP: ClassVar[str] = "re-estimation of all parameters, a Wald test of each"
    OPTIONS: ClassVar[tuple[Field, ...]] = (LINEARISE_FIELD, LEVEL_FIELD)
    level: float | None = None

    @property
    def name(self) -> str:
        return "estimation"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        limit = threshold(1, self.level or false_alarm)
        statistic, testable = single_minmax(score)
        return tuple(score.parameters[i] for i in np.flatnonzero(testable & (statistic > limit))), float("nan")
