"""Parameter estimation: re-estimate every monitored parameter, then ask whether it still equals nominal.

    Δθ̂ = F̂⁺ s̃        joint    Δθ̂ᵀ F̂ Δθ̂ ~ χ²(rank F̂)        single   t_i = Δθ̂_i² / (F̂⁺)_ii ~ χ²(1)      (Wald tests)

at the point of a Gauss–Newton estimate, held only loosely (`width` prior standard deviations) and within the
bounds of the parameters, with the uncertainty of nominal counted as noise. Isolation names the parameters that
Holm's step-down procedure rejects. This is the "blind" re-estimation of all parameters to which the paper
compares (end of section 5): with as many parameters as here, single estimates are poor where the joint one is good.
Wald, A. (1943) Trans. Amer. Math. Soc. 54, 426–482; Holm, S. (1979) Scand. J. Statistics 6, 65–70.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.residuals.monitor import Monitor

from .base import FamilyResult, FittedFamily, ResidualFamily, Windows, chi_square_test
from .reestimate import linearised
from .sums import holm, wald_statistics, window_sums


@dataclass(frozen=True)
class EstimationResult(FamilyResult):
    """Adds the estimated changes (W, p) and their standard errors (W, p), infinite where undetermined."""

    change: np.ndarray
    standard_error: np.ndarray


@dataclass(frozen=True)
class ParameterEstimation(ResidualFamily):
    """Re-estimation held by a prior of `width` prior standard deviations; `linearise` as in the pipeline."""

    name: ClassVar[str] = "estimation"
    width: float = 10.0
    linearise: str = "estimate"

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
    return np.asarray(np.linalg.inv(covariance + 1e-10 * np.eye(len(scale))) / scale / scale[:, None])


@dataclass(frozen=True)
class _Fitted(FittedFamily):
    monitor: Monitor
    width: float
    linearise: str

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> EstimationResult:
        from scipy.stats import chi2

        monitor, p = self.monitor, len(self.monitor.monitored)
        found = linearised(monitor, windows, self.linearise, loose_precision(monitor, self.width))
        sums = window_sums(found.e, found.J, monitor).with_uncertainty(monitor.uncertainty, p)
        wald = wald_statistics(sums.s, sums.F, monitor.prior_sigma[:p])
        test = chi_square_test("joint Wald", wald.joint, wald.rank, false_alarm)
        rejected = holm(chi2.sf(wald.wald, 1), false_alarm)
        return EstimationResult(
            "estimation",
            (test,),
            "parameters",
            monitor.monitored,
            "Wald statistic, chi-square with 1 degree of freedom",
            wald.wald,
            rejected & (test.alarm & found.converged)[:, None],
            found.converged,
            wald.estimate,
            np.sqrt(wald.variance),
        )
