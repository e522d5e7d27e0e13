"""The set of changes with the largest posterior probability: the tool's own isolation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from enginediag_cli.config.fields import Field
from enginediag_cli.isolation.methods import IsolationOptions, most_probable
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.methods.by_score import LINEARISE_FIELD, ByScore
from enginediag_cli.residuals.score import Score

_DEFAULT = SetPrior()


@dataclass(frozen=True)
class Posterior(ByScore):
    """Choices of the prior, see `SetPrior`; `largest` number of changes considered."""

    HELP: ClassVar[str] = "posterior probability of every set of changes"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        LINEARISE_FIELD,
        Field(
            "inclusion",
            "number",
            "prior probability that a parameter changed",
            _DEFAULT.inclusion,
            minimum=1e-6,
            maximum=0.999,
        ),
        Field(
            "worn",
            "number",
            "prior probability of an engine on which any number of changes is equally probable",
            _DEFAULT.worn,
            minimum=0.0,
            maximum=1.0,
        ),
        Field(
            "sensor",
            "number",
            "prior probability that a sensor is wrong, where sensors are monitored",
            _DEFAULT.sensor,
            minimum=1e-6,
            maximum=0.999,
        ),
        Field(
            "slabs",
            "numbers",
            "sizes of a change, each as probable, in prior standard deviations of the parameter",
            _DEFAULT.slabs,
            minimum=1e-6,
        ),
        Field("largest", "integer", "largest number of changes considered", None, minimum=1),
    )
    inclusion: float = _DEFAULT.inclusion
    worn: float = _DEFAULT.worn
    sensor: float = _DEFAULT.sensor
    slabs: tuple[float, ...] = _DEFAULT.slabs
    largest: int | None = None

    @property
    def name(self) -> str:
        return "posterior"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        prior = SetPrior(self.inclusion, self.worn, self.slabs, self.sensor)
        return most_probable(score, IsolationOptions(prior=prior, largest=self.largest))
