"""Methods that name what has changed, each by a test or posterior of `isolation`.

Parameter estimation: re-estimate all parameters, name those that a Wald test finds changed (end of section 5).

The paper's incremental algorithm (section 5.1.2): its statistic at nominal, or re-linearised.

Parameters whose change no other can imitate: min-max tests with Holm's multiple comparison.

The set of changes with the largest posterior probability: the tool's own isolation.

The best set of the right size by the sensitivity test: isolation when the number of faults is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.detection.verdict import threshold
from enginediag_cli.isolation.methods import (
    IsolationOptions,
    best_of_size,
    grown,
    inimitable,
    most_probable,
    single_minmax,
)
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.methods.evidence import LEVEL_FIELD, LINEARISE_FIELD, ByScore
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


@dataclass(frozen=True)
class Sensitivity(ByScore):
    """In a study it is told how many parameters changed; elsewhere it names one."""

    HELP: ClassVar[str] = "the set of changes of the true size with the largest sensitivity statistic"

    @property
    def name(self) -> str:
        return "sensitivity"

    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        return best_of_size(score, IsolationOptions(faults=number))
