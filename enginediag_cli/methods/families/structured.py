"""Filtered parity equations: residuals made blind to chosen parameters by orthogonal projection.

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
from enginediag_cli.methods.base import FittedMethod, Method
from enginediag_cli.methods.families.parity import REDUCTIONS, reduced_sums
from enginediag_cli.methods.families.sums import WindowSums
from enginediag_cli.methods.verdicts import PARAMETERS, Verdicts, chi_square_test
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.excitation import RANK_TOLERANCE
from enginediag_cli.residuals.monitor import Monitor


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

    def train(self, monitor: Monitor, healthy: Windows | None = None) -> _Fitted:
        return _Fitted(monitor, self.reduction, self.largest)


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
class _Fitted(FittedMethod):
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
