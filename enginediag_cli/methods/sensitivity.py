"""The best set of the right size by the sensitivity test: isolation when the number of faults is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from enginediag_cli.isolation.methods import IsolationOptions, best_of_size
from enginediag_cli.methods.by_score import ByScore
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class Sensitivity(ByScore):
    """In a study it is told how many parameters changed; elsewhere it names one."""

    HELP: ClassVar[str] = "the set of changes of the true size with the largest sensitivity statistic"

    @property
    def name(self) -> str:
        return "sensitivity"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        return best_of_size(score, IsolationOptions(faults=number))
