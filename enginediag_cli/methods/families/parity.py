"""Parity equations, eqs. (3) and (4): r = H(Y, U) = Y − Φ(U, θ0), the prediction error, as it is.

Under "nothing changed" the whitened r is N(0, 1 + G C Gᵀ), C the uncertainty of θ0. Two χ² tests:

    mean      z̄ᵀ (1 + Ḡ C Ḡᵀ)⁻¹ z̄ ~ χ²(m)     z̄_j = Σ_k z_kj/√n_j,  Ḡ_j = Σ_k G_kj/√n_j
    records   zᵀ (1 + G C Gᵀ)⁻¹ z ~ χ²(n m)

The mean sees small lasting changes, all records see any misfit. Which parameter changed is not asked: the
prediction error alone does not say (paper, section 4.1).

Filtered parity equations: residuals made blind to chosen parameters by orthogonal projection.

    r_S = (1 − G_S G_S⁺) z          |r_S|² = z·z − s_Sᵀ F_SS⁺ s_S ~ χ²(N − |S|) whatever S did, if the rest is nominal

The fault signature of S is then: r_S silent while the residuals blind to fewer parameters still ring. Isolation
goes through sets of growing size and stops at the first size that has a silent residual, naming the most silent
set. Gertler, J. and Singer, D. (1990) Automatica 26, 381–388 (structured residuals); Chow, E. Y. and Willsky,
A. S. (1984) IEEE Trans. Automatic Control 29, 603–614 (orthogonal projection).

On window means N is the number of sensors, so that sets larger than N − 1 leave nothing to hear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.base import NOTHING, PARAMETERS, FittedMethod, Method, Verdicts, Windows, chi_square_test
from enginediag_cli.methods.families.local import WindowSums, nominal_residuals, white_residuals, window_sums
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.statistics import RANK_TOLERANCE

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


@dataclass(frozen=True)
class StructuredParity(Method):
    """Structured residuals; `largest`: how many parameters a set may hold; `reduction` as in `PredictionError`."""

    HELP: ClassVar[str] = "filtered parity equations: residuals made blind to some parameters name them"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        Field("reduction", "choice", "test the mean of each sensor, or all records", "mean", choices=REDUCTIONS),
        Field("largest", "integer", "largest number of parameters that it names", 4, minimum=1),
    )
    reduction: str = "mean"
    largest: int = 4

    @property
    def name(self) -> str:
        return "parity_filtered"

    @property
    def tests(self) -> tuple[str, ...]:
        return (self.reduction,)

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> _StructuredFitted:
        return _StructuredFitted(monitor, self.reduction, self.largest)


def decoupled(sums: WindowSums, chosen: Sequence[int], scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """|r_S|² (W,) of the residual blind to the parameters `chosen`, and its degrees of freedom (W,)."""
    i = list(chosen)
    d = scale[i]
    eigenvalues, U = np.linalg.eigh(d[:, None] * sums.F[:, i][:, :, i] * d)
    largest = np.max(np.einsum("wii->wi", sums.F) * scale**2, axis=1, initial=0.0)
    kept = eigenvalues > RANK_TOLERANCE * largest[:, None]
    v = np.einsum("wpi,wp->wi", U, d * sums.s[:, i])
    explained = np.sum(np.where(kept, v**2 / np.where(kept, eigenvalues, 1.0), 0.0), axis=1)
    return np.maximum(sums.zz - explained, 0.0), sums.dof - kept.sum(axis=1)


@dataclass(frozen=True)
class _StructuredFitted(FittedMethod):
    monitor: Monitor
    reduction: str
    largest: int

    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> Verdicts:
        sums = reduced_sums(self.monitor, windows, self.reduction)
        p = len(self.monitor.monitored)
        scale = self.monitor.prior_sigma[:p]
        test = chi_square_test(self.reduction, sums.zz, sums.dof, false_alarm)
        evidence = np.full((windows.count, p), np.nan)
        isolated = np.zeros((windows.count, p), bool)
        open_windows = test.alarm
        for size in range(1, min(self.largest, p) + 1):
            rows = np.arange(windows.count) if size == 1 else np.flatnonzero(open_windows)
            sets = list(combinations(range(p), size))
            silence = _silence(_rows(sums, rows), sets, scale)
            if size == 1:
                evidence = silence
            best = np.argmax(silence, axis=1)
            found = (silence[np.arange(len(rows)), best] > false_alarm) & open_windows[rows]
            for w in np.flatnonzero(found):
                isolated[rows[w], list(sets[best[w]])] = True
            open_windows[rows[found]] = False
            if not open_windows.any():
                break
        return Verdicts(
            "parity_filtered",
            (test,),
            PARAMETERS,
            self.monitor.monitored,
            "p value of the residual that is blind to this parameter: large where it alone explains all",
            evidence,
            isolated,
            np.ones(windows.count, bool),
        )


def _rows(sums: WindowSums, rows: np.ndarray) -> WindowSums:
    return WindowSums(sums.zz[rows], sums.s[rows], sums.F[rows], sums.dof[rows])


def _silence(sums: WindowSums, sets: Sequence[tuple[int, ...]], scale: np.ndarray) -> np.ndarray:
    """p value (W, sets) of each decoupled residual; 0 where nothing is left to hear."""
    from scipy.stats import chi2

    silence = np.empty((len(sums.zz), len(sets)))
    for k, chosen in enumerate(sets):
        statistic, dof = decoupled(sums, chosen, scale)
        silence[:, k] = np.where(dof > 0, chi2.sf(statistic, np.maximum(dof, 1.0)), 0.0)
    return silence
