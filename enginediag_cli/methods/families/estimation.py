"""Parameter estimation: re-estimate every monitored parameter, then ask whether it still equals nominal.

    joint    z(θ0)·z(θ0) − z(θ̂)·z(θ̂) ~ χ²(rank F̂)                                    (likelihood ratio)
    single   t_i = Δθ̂_i² / (F̂⁺)_ii ~ χ²(1),   Δθ̂ = F̂⁺ s̃                            (Wald)

at the point of a Gauss–Newton estimate, held only loosely (`width` prior standard deviations) and within the
bounds of the parameters, with the uncertainty of nominal counted as noise. On a linear engine the joint test is
Wald's, Δθ̂ᵀ F̂ Δθ̂; on a curved one only the likelihood ratio keeps its χ² where θ̂ wanders far along combinations
that the window hardly determines. Isolation names the parameters that
Holm's step-down procedure rejects. This is the "blind" re-estimation of all parameters to which the paper
compares (end of section 5): with as many parameters as here, single estimates are poor where the joint one is good.
Wald, A. (1943) Trans. Amer. Math. Soc. 54, 426–482; Holm, S. (1979) Scand. J. Statistics 6, 65–70.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.by_score import LINEARISE_FIELD
from enginediag_cli.methods.families.reestimate import linearised
from enginediag_cli.methods.families.sums import holm, wald_statistics, window_sums
from enginediag_cli.methods.verdicts import PARAMETERS, Verdicts, chi_square_test
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor

CERTAIN = 1e-10
"""Variance, in prior variances, of what nominal says for certain: small, and still invertible."""


@dataclass(frozen=True)
class EstimationResult(Verdicts):
    """Adds the estimated changes (W, p) and their standard errors (W, p), infinite where undetermined."""

    change: np.ndarray
    standard_error: np.ndarray


@dataclass(frozen=True)
class ParameterEstimation(Method):
    """Re-estimation held by a prior of `width` prior standard deviations; `linearise` as in the pipeline."""

    HELP: ClassVar[str] = "loose re-estimation of all parameters, a likelihood-ratio test and Wald tests of each"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("width", "number", "how loosely changes are held, in prior standard deviations", 10.0, minimum=1e-3),
        LINEARISE_FIELD,
    )
    width: float = 10.0
    linearise: str = "estimate"

    @property
    def name(self) -> str:
        return "reestimation"

    @property
    def tests(self) -> tuple[str, ...]:
        return ("joint",)

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> _Fitted:
        if not self.width > 0:
            raise ValueError("`width` must be positive")
        return _Fitted(monitor, self.width, self.linearise)


def loose_precision(monitor: Monitor, width: float) -> np.ndarray:
    """Inverse prior covariance (p, p): changes of `width` prior standard deviations, plus uncertainty of nominal."""
    change = np.zeros(len(monitor.names))
    a = len(monitor.monitored)
    change[:a] = width * monitor.prior_sigma[:a]
    scale = monitor.prior_sigma
    covariance = (monitor.uncertainty + np.diag(change**2)) / scale / scale[:, None]
    return np.asarray(np.linalg.inv(covariance + CERTAIN * np.eye(len(scale))) / scale / scale[:, None])


@dataclass(frozen=True)
class _Fitted(FittedMethod):
    monitor: Monitor
    width: float
    linearise: str

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> EstimationResult:
        from scipy.stats import chi2

        monitor, p = self.monitor, len(self.monitor.monitored)
        found = linearised(monitor, windows, self.linearise, loose_precision(monitor, self.width))
        C = monitor.uncertainty
        sums = window_sums(found.e, found.J, monitor).with_uncertainty(C, p)
        wald = wald_statistics(sums.s, sums.F, monitor.prior_sigma[:p])
        moved = found.theta[:, :p] - monitor.theta0[:p]
        bent = (sums.F @ moved[:, :, None])[:, :, 0]
        # one more step of the loosely held estimate: the search weighs time-correlated noise only approximately
        left = (sums.s - bent)[:, :, None]
        loose = np.diag((self.width * monitor.prior_sigma[:p]) ** -2)
        gained = np.sum(left * np.linalg.solve(sums.F + loose, left), axis=(1, 2))
        at_estimate = sums.zz - np.sum(moved * (2 * sums.s - bent), axis=1) - gained
        at_nominal = window_sums(found.e0, found.J0, monitor).with_uncertainty(C, p).zz
        joint = wald.joint if self.linearise == "nominal" else np.maximum(at_nominal - at_estimate, 0.0)
        test = chi_square_test("joint", joint, wald.rank, false_alarm)
        rejected = holm(chi2.sf(wald.wald, 1), false_alarm)
        return EstimationResult(
            "reestimation",
            (test,),
            PARAMETERS,
            monitor.monitored,
            "Wald statistic, chi-square with 1 degree of freedom",
            wald.wald,
            rejected & (test.alarm & found.converged)[:, None],
            found.converged,
            wald.estimate,
            np.sqrt(wald.variance),
        )
