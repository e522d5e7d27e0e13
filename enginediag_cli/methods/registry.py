"""Every method by its name, with its default choices; a new one is one line of METHODS.

The methods that isolate each window from its score are rows of SCORE_METHODS: they share the detection test, the GLR
test of the score, eq. (11), and differ by the test or posterior of `isolation` that names the changes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np

from enginediag_cli.config.fields import Field, Section
from enginediag_cli.detection.verdict import NOISE_UNKNOWN, glr_test, is_noise_unknown, threshold
from enginediag_cli.isolation.methods import NAMING, IsolationOptions, Named, single_minmax, single_sensitivities
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.methods.base import PARAMETERS, DetectionTest, Method, RecordWindows, Verdicts
from enginediag_cli.methods.estimation import LINEARISE_FIELD, ParameterEstimation, scored_windows
from enginediag_cli.methods.filters import ExtendedKalman, UnscentedKalman
from enginediag_cli.methods.residual_tests import PredictionError, PrincipalComponents, StructuredParity
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score

PRIOR = SetPrior()
LEVEL_FIELD = Field(
    "level", "number", "level of its tests; false_alarm of the study where absent", None, minimum=1e-6, maximum=0.5
)
PRIOR_FIELDS = (
    Field(
        "inclusion",
        "number",
        "prior probability that a parameter changed",
        PRIOR.inclusion,
        minimum=1e-6,
        maximum=0.999,
    ),
    Field(
        "worn",
        "number",
        "prior probability of an engine on which any number of changes is equally probable",
        PRIOR.p_uniform_wear,
        minimum=0.0,
        maximum=1.0,
    ),
    Field(
        "sensor",
        "number",
        "prior probability that a sensor is wrong, where sensors are monitored",
        PRIOR.sensor,
        minimum=1e-6,
        maximum=0.999,
    ),
    Field(
        "slabs",
        "numbers",
        "sizes of a change, each as probable, in prior standard deviations of the parameter",
        PRIOR.slabs,
        minimum=1e-6,
    ),
    Field("largest", "integer", "largest number of changes considered", None, minimum=1),
)


def wald_changes(score: Score, options: IsolationOptions) -> Named:
    """Parameters whose Wald statistic Δθ̂_i² / (I⁻¹)_ii in the re-estimate of all is significant: the statistic of the
    min-max test."""
    statistic, testable = single_minmax(score)
    significant = testable & (statistic > threshold(1, options.false_alarm))
    return tuple(score.parameters[i] for i in np.flatnonzero(significant)), nan


@dataclass(frozen=True)
class ScoreMethodRow:
    """help and choices of a method; `isolate` names the changed parameters of a score, None for one that is chosen by
    `method`; counts: it is given the number of changes where a study knows it."""

    help: str
    choices: tuple[Field, ...]
    isolate: Callable[[Score, IsolationOptions], Named] | None
    counts: bool = False


SCORE_METHODS = {
    "posterior": ScoreMethodRow("posterior probability of every set of changes", PRIOR_FIELDS, NAMING["posterior"]),
    "incremental": ScoreMethodRow("the paper's incremental diagnosis", (LEVEL_FIELD,), NAMING["incremental"]),
    "sensitivity": ScoreMethodRow(
        "the set of changes of the true size with the largest sensitivity statistic", (), NAMING["sensitivity"], True
    ),
    "minmax": ScoreMethodRow(
        "min-max tests of single parameters, multiple comparison by Holm", (LEVEL_FIELD,), NAMING["minmax"]
    ),
    "estimation": ScoreMethodRow("re-estimation of all parameters, a Wald test of each", (LEVEL_FIELD,), wald_changes),
    "local": ScoreMethodRow(
        "the local approach: GLR test of the window's score, isolation where it alarms",
        (Field("method", "choice", "how it isolates", "posterior", choices=tuple(NAMING)),),
        None,
    ),
}


@dataclass(frozen=True)
class ScoreMethod(Method):
    """A row of SCORE_METHODS with its choices.

    linearise: at the "estimate" of each window or at "nominal"; method: of isolation, for "local"; level: of its tests,
    that of the detection test where None; the others: prior of the posterior, see `SetPrior`, and its largest set.
    """

    row: str
    linearise: str = "estimate"
    method: str = "posterior"
    level: float | None = None
    inclusion: float = PRIOR.inclusion
    worn: float = PRIOR.p_uniform_wear
    sensor: float = PRIOR.sensor
    slabs: tuple[float, ...] = PRIOR.slabs
    largest: int | None = None

    @property
    def name(self) -> str:
        return self.row

    @property
    def help(self) -> str:
        return SCORE_METHODS[self.row].help

    @property
    def options(self) -> tuple[Field, ...]:
        return (LINEARISE_FIELD, *SCORE_METHODS[self.row].choices)

    @property
    def tests(self) -> tuple[str, ...]:
        return ("GLR",)

    def diagnose(self, monitor: Monitor, windows: RecordWindows, false_alarm: float) -> Verdicts:
        evidence, names, row = scored_windows(monitor, windows), monitor.monitored, SCORE_METHODS[self.row]
        scores, converged = evidence.scores(self.linearise)
        test = score_test(scores, false_alarm)
        likeliest, probability = np.zeros((len(scores), len(names)), bool), np.full(len(scores), np.nan)
        doubtful = {w: NOISE_UNKNOWN for w, score in enumerate(scores) if is_noise_unknown(score)}
        judged = converged & test.judged
        isolate = row.isolate or NAMING[self.method]
        prior = SetPrior(self.inclusion, self.worn, self.slabs, self.sensor)
        for w in np.flatnonzero(judged):
            number = None if evidence.faults is None or not row.counts else int(evidence.faults[w])
            options = IsolationOptions(number, self.level or false_alarm, prior, largest=self.largest)
            found, probability[w] = isolate(scores[w], options)
            likeliest[w] = [name in found for name in names]
        alarm = judged & test.alarm
        alarm[list(doubtful)] = False
        return Verdicts(
            self.name,
            (test,),
            PARAMETERS,
            names,
            "sensitivity statistic, chi-square with 1 degree of freedom if it alone may change",
            np.array([single_sensitivities(s) for s in scores]).reshape(len(scores), len(names)),
            likeliest & alarm[:, None],
            converged,
            likeliest=likeliest,
            probability=probability,
            withheld=doubtful,
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


METHODS: dict[str, Method] = {
    **{name: ScoreMethod(name) for name in SCORE_METHODS if name != "local"},
    "parity": PredictionError(),
    "parity_records": PredictionError(reduction="records"),
    "parity_filtered": StructuredParity(),
    "extended_kalman": ExtendedKalman(),
    "unscented_kalman": UnscentedKalman(),
    "pca_raw": PrincipalComponents(data="raw"),
    "pca_corrected": PrincipalComponents(data="corrected"),
    "reestimation": ParameterEstimation(),
    "local": ScoreMethod("local"),
}

FAMILIES = {
    name: name
    for name in (
        "parity",
        "parity_records",
        "parity_filtered",
        "extended_kalman",
        "unscented_kalman",
        "pca_raw",
        "pca_corrected",
    )
} | {"estimation": "reestimation", "local": "local"}
"""Under which name `type: family` of a study file asks for each: families had names of their own when they were
another kind of method, and study files keep their meaning."""

SECTIONS: dict[str, Section] = {name: method.section() for name, method in METHODS.items()} | {
    "family": Section(
        "family",
        "a family of residuals, with its own detection and isolation",
        (Field("family", "choice", "which", choices=tuple(FAMILIES)),),
    )
}
"""What a study file may ask for, by its `type`."""


def chosen_method(values: Mapping[str, Any]) -> Method:
    """The method that the values of one of SECTIONS ask for."""
    if values["type"] == "family":
        return METHODS[FAMILIES[values["family"]]]
    return METHODS[values["type"]].configure(values)
