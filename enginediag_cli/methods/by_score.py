"""What the methods that read scores have in common: the GLR test of the score, eq. (11), and names by isolation."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.detection.glr import glr_test
from enginediag_cli.detection.verdict import NOISE_UNKNOWN, unknown_noise
from enginediag_cli.isolation.sensitivity import single_sensitivities
from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.evidence import evidence_of
from enginediag_cli.methods.verdicts import PARAMETERS, DetectionTest, Verdicts
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import LINEARISE
from enginediag_cli.residuals.score import Score

LINEARISE_FIELD = Field(
    "linearise",
    "choice",
    "where the model is linearised: at the estimate of each window, or at nominal",
    "estimate",
    choices=LINEARISE,
)
LEVEL_FIELD = Field(
    "level", "number", "level of its tests; false_alarm of the study where absent", None, minimum=1e-6, maximum=0.5
)


@dataclass(frozen=True)
class ByScore(Method):
    """A method that isolates each window from its score; detection is the GLR test of the same score.

    linearise: at the "estimate" of each window or at "nominal".
    """

    OPTIONS: ClassVar[tuple[Field, ...]] = (LINEARISE_FIELD,)
    linearise: str = "estimate"

    @property
    def tests(self) -> tuple[str, ...]:
        return ("GLR",)

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> FittedMethod:
        return _Fitted(monitor, self)

    @abstractmethod
    def named(self, score: Score, false_alarm: float, number: int | None) -> tuple[tuple[str, ...], float]:
        """Which parameters changed, and the probability that it is exactly these, NaN for a method that states none.

        number: how many changed, for methods that are told; None where nobody knows.
        """


@dataclass(frozen=True)
class _Fitted(FittedMethod):
    monitor: Monitor
    method: ByScore

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> Verdicts:
        evidence, names = evidence_of(self.monitor, windows), self.monitor.monitored
        scores, converged = evidence.scores(self.method.linearise)
        test = score_test(scores, false_alarm)
        likeliest, probability = np.zeros((len(scores), len(names)), bool), np.full(len(scores), np.nan)
        doubtful = {w: NOISE_UNKNOWN for w, score in enumerate(scores) if unknown_noise(score)}
        judged = converged & test.judged
        for w in np.flatnonzero(judged):
            number = None if evidence.faults is None else int(evidence.faults[w])
            found, probability[w] = self.method.named(scores[w], false_alarm, number)
            likeliest[w] = [name in found for name in names]
        alarm = judged & test.alarm
        alarm[list(doubtful)] = False
        return Verdicts(
            self.method.name,
            (test,),
            PARAMETERS,
            names,
            "sensitivity statistic, chi-square with 1 degree of freedom if it alone may change",
            np.array([single_sensitivities(s) for s in scores]).reshape(len(scores), len(names)),
            likeliest & alarm[:, None],
            converged,
            likeliest=likeliest,
            probability=probability,
            doubtful=doubtful,
        )


def score_test(scores: list[Score], false_alarm: float) -> DetectionTest:
    """The GLR test of each score, NaN where nothing is excited."""
    tests = [glr_test(score, false_alarm) for score in scores]
    usable = np.array([test.alarm is not None for test in tests], bool)

    def values(name: str) -> np.ndarray:
        return np.where(usable, np.array([getattr(test, name) for test in tests], float), np.nan)

    return DetectionTest(
        "GLR",
        values("statistic"),
        values("dof"),
        values("threshold"),
        values("p_value"),
        false_alarm,
        "chi-square, or F where the noise was estimated",
    )
