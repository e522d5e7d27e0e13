"""The paper's incremental algorithm (section 5.1.2): its statistic at nominal, or re-linearised."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from enginediag_cli.config.fields import Field
from enginediag_cli.isolation.methods import IsolationOptions, grown
from enginediag_cli.methods.by_score import LEVEL_FIELD, LINEARISE_FIELD, ByScore
from enginediag_cli.residuals.score import Score


@dataclass(frozen=True)
class Incremental(ByScore):
    """`level` of its rejection tests; that of the detection test where None."""

    HELP: ClassVar[str] = "the paper's incremental diagnosis"
    OPTIONS: ClassVar[tuple[Field, ...]] = (LINEARISE_FIELD, LEVEL_FIELD)
    level: float | None = None

    @property
    def name(self) -> str:
        return "incremental"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        return grown(score, IsolationOptions(false_alarm=self.level or false_alarm))
