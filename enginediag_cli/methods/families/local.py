"""The local approach behind the common interface: GLR detection, eq. (11), and any of the isolation methods."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.isolation.methods import METHODS, NAMING, IsolationOptions
from enginediag_cli.isolation.sensitivity import single_sensitivities
from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.by_score import LINEARISE_FIELD
from enginediag_cli.methods.families.reestimate import linearised
from enginediag_cli.methods.verdicts import PARAMETERS, Verdicts, chi_square_test
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.local import block_statistics
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.score import Score, fisher_score


@dataclass(frozen=True)
class LocalApproach(Method):
    """`method` of isolation by name; `linearise` at the "estimate" of each window or at "nominal", as the paper."""

    HELP: ClassVar[str] = "the local approach: GLR test of the window's score, isolation where it alarms"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("method", "choice", "how it isolates", "posterior", choices=tuple(METHODS)),
        LINEARISE_FIELD,
    )
    method: str = "posterior"
    linearise: str = "estimate"
    options: IsolationOptions = field(default_factory=IsolationOptions)

    @property
    def name(self) -> str:
        return "local"

    @property
    def tests(self) -> tuple[str, ...]:
        return ("GLR",)

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> _Fitted:
        if self.method not in METHODS:
            raise ValueError(f"`method` must be one of {', '.join(METHODS)}, not {self.method!r}")
        return _Fitted(monitor, self)


def window_scores(monitor: Monitor, windows: Windows, linearise: str) -> tuple[list[Score], np.ndarray]:
    """Score of the monitored parameters of each window, and whether its re-estimate converged (W,)."""
    found = linearised(monitor, windows, linearise, monitor.precision)
    W, n, m = windows.y.shape
    lags = np.ones(W * n)
    lags[::n] = np.inf  # windows are unrelated
    blocks = block_statistics(
        found.e.reshape(-1, m), found.J.reshape(W * n, m, -1), monitor.noise, np.arange(W) * n, monitor.frame, lags=lags
    )
    C = monitor.uncertainty
    return [fisher_score(b.statistics, monitored=monitor.monitored, uncertainty=C) for b in blocks], found.converged


@dataclass(frozen=True)
class _Fitted(FittedMethod):
    monitor: Monitor
    family: LocalApproach

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> Verdicts:
        family, names = self.family, self.monitor.monitored
        scores, converged = window_scores(self.monitor, windows, family.linearise)
        glr, rank = np.array([s.glr for s in scores]), np.array([s.rank for s in scores], float)
        test = chi_square_test("GLR", glr, rank, false_alarm)
        isolated = np.zeros((windows.count, len(names)), bool)
        for w in np.flatnonzero(test.alarm & converged):
            found, _ = NAMING[family.method](scores[w], family.options)
            isolated[w] = [name in found for name in names]
        evidence = np.array([single_sensitivities(s) for s in scores]).reshape(windows.count, len(names))
        return Verdicts(
            "local",
            (test,),
            PARAMETERS,
            names,
            "sensitivity statistic, chi-square with 1 degree of freedom if it alone may change",
            evidence,
            isolated,
            converged,
        )
