"""Parity equations, eqs. (3) and (4): r = H(Y, U) = Y − Φ(U, θ0), the prediction error, as it is.

Under "nothing changed" the whitened r is N(0, 1 + G C Gᵀ), C the uncertainty of θ0. Two χ² tests:

    mean      z̄ᵀ (1 + Ḡ C Ḡᵀ)⁻¹ z̄ ~ χ²(m)     z̄_j = Σ_k z_kj/√n_j,  Ḡ_j = Σ_k G_kj/√n_j
    records   zᵀ (1 + G C Gᵀ)⁻¹ z ~ χ²(n m)

The mean sees small lasting changes, all records see any misfit. Which parameter changed is not asked: the
prediction error alone does not say (paper, section 4.1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.families.sums import WindowSums, nominal_residuals, window_sums
from enginediag_cli.methods.families.whitening import white_residuals
from enginediag_cli.methods.verdicts import NOTHING, Verdicts, chi_square_test
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor

REDUCTIONS = ("mean", "records")


def reduced_sums(monitor: Monitor, windows: Windows, reduction: str) -> WindowSums:
    """Sums of the monitored parameters, over the window's mean residual per sensor or over all records."""
    if reduction not in REDUCTIONS:
        raise ValueError(f"`reduction` must be one of {', '.join(REDUCTIONS)}, not {reduction!r}")
    e, J = nominal_residuals(monitor, windows)
    if reduction == "records":
        sums = window_sums(e, J, monitor)
    else:
        z, G, present = white_residuals(e, J, monitor.noise)
        count = present.sum(axis=1)
        weight = 1 / np.sqrt(np.maximum(count, 1))
        mean, sensitivity = z.sum(axis=1) * weight, G.sum(axis=1) * weight[..., None]
        turned = np.swapaxes(sensitivity, 1, 2)
        sums = WindowSums(
            np.sum(mean**2, axis=1),
            (turned @ mean[:, :, None])[:, :, 0],
            turned @ sensitivity,
            (count > 0).sum(axis=1).astype(float),
        )
    return sums.with_uncertainty(monitor.uncertainty, len(monitor.monitored))


@dataclass(frozen=True)
class PredictionError(Method):
    """The prediction error as residual; `reduction`: test its mean over the window, or all records."""

    HELP: ClassVar[str] = "the prediction error at nominal, as parity equations: its mean, or all records"
    reduction: str = "mean"

    @property
    def name(self) -> str:
        return "parity" if self.reduction == "mean" else f"parity_{self.reduction}"

    @property
    def tests(self) -> tuple[str, ...]:
        return (self.reduction,)

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> _Fitted:
        return _Fitted(monitor, self)


@dataclass(frozen=True)
class _Fitted(FittedMethod):
    monitor: Monitor
    method: PredictionError

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> Verdicts:
        sums = reduced_sums(self.monitor, windows, self.method.reduction)
        test = chi_square_test(self.method.reduction, sums.zz, sums.dof, false_alarm)
        return Verdicts(
            self.method.name,
            (test,),
            NOTHING,
            (),
            "",
            np.zeros((windows.count, 0)),
            None,
            np.ones(windows.count, bool),
        )
