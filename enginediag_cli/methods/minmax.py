"""Parameters whose change no other can imitate: min-max tests with Holm's multiple comparison."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from enginediag_cli.config.fields import Field
from enginediag_cli.isolation.methods import IsolationOptions, inimitable
from enginediag_cli.methods.by_score import LEVEL_FIELD, LINEARISE_FIELD, ByScore
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class MinMax(ByScore):
    """`level` of the comparison; that of the detection test where None."""

    HELP: ClassVar[str] = "min-max tests of single parameters, multiple comparison by Holm"
    OPTIONS: ClassVar[tuple[Field, ...]] = (LINEARISE_FIELD, LEVEL_FIELD)
    level: float | None = None

    @property
    def name(self) -> str:
        return "minmax"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        return inimitable(score, IsolationOptions(false_alarm=self.level or false_alarm))
