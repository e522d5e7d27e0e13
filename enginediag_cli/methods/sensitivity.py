"""The best set of the right size by the sensitivity test: isolation when the number of faults is known."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from enginediag_cli.config.fields import Section
from enginediag_cli.isolation.subsets import best_subsets
from enginediag_cli.methods.answers import LINEARISE_FIELD, Answers, by_score
from enginediag_cli.methods.evidence import Evidence
from enginediag_cli.residuals.score import Score

SECTION = Section(
    "sensitivity", "the set of changes of the true size with the largest sensitivity statistic", (LINEARISE_FIELD,)
)


def answer(evidence: Evidence, options: Mapping[str, Any]) -> Answers:
    def isolate(window: int, score: Score) -> tuple[tuple[str, ...], float]:
        size = int(evidence.faults[window])
        sets = best_subsets(score, size).sets if size else ()
        return tuple(score.parameters[i] for i in sets[-1]) if sets else (), float("nan")

    return by_score(evidence, options["linearise"], isolate)
