"""Parameter estimation: re-estimate all parameters, name those that a Wald test finds changed (end of section 5)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Section
from enginediag_cli.detection.glr import threshold
from enginediag_cli.isolation.minmax import single_minmax
from enginediag_cli.methods.answers import LEVEL_FIELD, LINEARISE_FIELD, Answers, by_score
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.score import Score

SECTION = Section("estimation", "re-estimation of all parameters, a Wald test of each", (LINEARISE_FIELD, LEVEL_FIELD))


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    """The Wald statistic of one of all parameters, Δθ̂_i² / (I⁻¹)_ii, is its min-max statistic."""
    limit = threshold(1, options["level"] or evidence.false_alarm)

    def isolate(window: int, score: Score) -> tuple[tuple[str, ...], float]:
        statistic, testable = single_minmax(score)
        return tuple(score.parameters[i] for i in np.flatnonzero(testable & (statistic > limit))), float("nan")

    return by_score(evidence, options["linearise"], isolate)
