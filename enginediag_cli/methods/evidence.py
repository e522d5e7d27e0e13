"""Windows with their scores, computed once for all methods that ask for them.

What the methods that read scores have in common: the GLR test of the score, eq. (11), and names by isolation.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from time import process_time
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.detection.verdict import NOISE_UNKNOWN, glr_test, unknown_noise
from enginediag_cli.isolation.methods import single_sensitivities
from enginediag_cli.methods.base import PARAMETERS, DetectionTest, FittedMethod, Method, Verdicts, Windows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import LINEARISE
from enginediag_cli.residuals.relinearise import relinearise
from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import block_statistics

SMALL_STEP = 0.02
"""Step of a parameter, in its prior standard deviations, over which the model is as good as linear: for the 2 % of
health parameters the second order is below 1e-6, the noise of a mean of thousands of records above 1e-5."""


@dataclass(frozen=True, eq=False)
class Evidence(Windows):
    """Windows of a monitor, and the scores of its monitored parameters.

    faults (W,): number of changes in each, which only methods that are told it may read; None where nobody knows.
    cost: CPU seconds spent on what methods share; used: what the method at work has asked for.
    """

    monitor: Monitor
    faults: np.ndarray | None = None
    cost: dict[str, float] = field(default_factory=dict)
    used: set[str] = field(default_factory=set)
    _shared: _Shared = field(default_factory=lambda: _Shared())

    def scores(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        """Score of each window at its own "estimate" or at "nominal", and which converged (W,)."""
        self.used.update({"predictions", linearise})
        shared = self._shared
        if shared.last is None:
            begun = process_time()
            shared.last = self._predicted(np.tile(self.monitor.theta0, (len(self._window), 1)))
            shared.nominal = shared.last.copy()
            self.cost["predictions"] = process_time() - begun
        if linearise not in shared.scores:
            begun = process_time()
            shared.scores[linearise] = self._linearised(linearise)
            self.cost[linearise] = process_time() - begun
        return shared.scores[linearise]

    @property
    def _window(self) -> np.ndarray:
        return np.repeat(np.arange(self.count), self.length)

    def _linearised(self, linearise: str) -> tuple[list[Score], np.ndarray]:
        monitor, nominal = self.monitor, self._shared.nominal
        assert nominal is not None
        W, n, m = self.y.shape
        y = self.y.reshape(-1, m)
        if linearise == "nominal":
            e, J, ok, converged = y - nominal.y, nominal.J, nominal.ok, np.ones(W, bool)
        else:
            found = relinearise(
                self._predict,
                y,
                monitor.hold,
                monitor.noise,
                window=self._window,
                nominal=(nominal.y, nominal.J, nominal.ok),
            )
            e, J, ok, converged = found.e, found.J, found.ok, found.converged
        lags = np.ones(W * n)
        lags[::n] = np.inf  # windows are unrelated
        blocks = block_statistics(
            np.where(ok[:, None], e, np.nan), J, monitor.noise, np.arange(W) * n, monitor.frame, lags=lags
        )
        C = monitor.uncertainty
        scores = [fisher_score(b.statistics, monitored=monitor.monitored, uncertainty=C) for b in blocks]
        return scores, converged

    def _predict(self, theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Model and sensitivities to what is monitored, evaluated anew where θ has moved by more than SMALL_STEP since
        the last time."""
        last = self._shared.last
        assert last is not None
        step = theta - last.theta[rows]
        far = np.any(np.abs(step) > SMALL_STEP * self.monitor.prior_sigma, axis=1)
        if far.any():
            at = rows[far]
            start = None if last.x is None else last.x[:, at]
            last.put(at, self._predicted(theta[far], at, start, nuisance=False))
        beyond = np.where(far[:, None], 0.0, step)
        y = last.y[rows] + np.einsum("kjp,kp->kj", last.J[rows], beyond)
        return y, last.J[rows, :, : len(self.monitor.monitored)], last.ok[rows]

    def _predicted(
        self,
        theta: np.ndarray,
        rows: np.ndarray | slice = slice(None),
        start: np.ndarray | None = None,
        nuisance: bool = True,
    ) -> _Prediction:
        """One call of the engine for records `rows` at theta (n, p), from the unknowns `start` (nx, n)."""
        inputs = {c: v[rows] for c, v in self.flat_inputs().items()}
        y, J, ok, found = self.monitor.predict(inputs, theta, nuisance=nuisance, start=start)
        x = getattr(found, "x", None)
        return _Prediction(theta, y, J, ok, None if x is None else np.asarray(x))


def evidence_of(monitor: Monitor, windows: Windows) -> Evidence:
    """The windows as evidence for this monitor: themselves, if they are that already."""
    if isinstance(windows, Evidence) and windows.monitor is monitor:
        return windows
    return Evidence(windows.inputs, windows.y, monitor)


@dataclass
class _Shared:
    """What was computed so far."""

    nominal: _Prediction | None = None
    last: _Prediction | None = None
    scores: dict[str, tuple[list[Score], np.ndarray]] = field(default_factory=dict)


@dataclass
class _Prediction:
    """theta (n, p), y (n, m), J (n, m, p), ok (n,), unknowns x (nx, n) of n records, None from a model that shows
    none."""

    theta: np.ndarray
    y: np.ndarray
    J: np.ndarray
    ok: np.ndarray
    x: np.ndarray | None

    def copy(self) -> _Prediction:
        x = None if self.x is None else self.x.copy()
        return _Prediction(self.theta.copy(), self.y.copy(), self.J.copy(), self.ok.copy(), x)

    def put(self, rows: np.ndarray, new: _Prediction) -> None:
        """Replace the records `rows`, with the sensitivities that the new prediction has."""
        self.theta[rows], self.y[rows], self.ok[rows] = new.theta, new.y, new.ok
        self.J[rows, :, : new.J.shape[2]] = new.J
        if self.x is not None and new.x is not None:
            self.x[:, rows] = new.x


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
