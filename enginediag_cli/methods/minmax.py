"""Parameters whose change no other can imitate: min-max tests with Holm's multiple comparison."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Section
from enginediag_cli.isolation.holm import holm_minmax
from enginediag_cli.methods.answers import LEVEL_FIELD, LINEARISE_FIELD, Answers, by_score
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.score import Score

SECTION = Section(
    "minmax", "min-max tests of single parameters, multiple comparison by Holm", (LINEARISE_FIELD, LEVEL_FIELD)
)


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    level = options["level"] or evidence.false_alarm

    def isolate(window: int, score: Score) -> tuple[tuple[str, ...], float]:
        return holm_minmax(score, level)[0], float("nan")

    return by_score(evidence, options["linearise"], isolate)
