"""The paper's incremental algorithm (section 5.1.2): its statistic at nominal, or re-linearised."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Section
from enginediag_cli.isolation.incremental import incremental_diagnosis
from enginediag_cli.methods.answers import LEVEL_FIELD, LINEARISE_FIELD, Answers, by_score
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.score import Score

SECTION = Section("incremental", "the paper's incremental diagnosis", (LINEARISE_FIELD, LEVEL_FIELD))


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    level = options["level"] or evidence.false_alarm

    def isolate(window: int, score: Score) -> tuple[tuple[str, ...], float]:
        return incremental_diagnosis(score, false_alarm=level).isolated, float("nan")

    return by_score(evidence, options["linearise"], isolate)
