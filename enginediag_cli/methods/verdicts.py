"""What every method hands back: its tests, its alarms, and what it names, window by window."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

PARAMETERS, SENSORS, NOTHING = "parameters", "sensors", "none"
"""Kinds of name: parameters of the engine; columns of the recording; a method that only detects."""


@dataclass(frozen=True)
class DetectionTest:
    """One test on W windows: alarm where statistic > threshold, at probability `level` when nothing changed.

    statistic, dof, threshold, p_value (W,), NaN where there is nothing to test; `reference`: the distribution
    under "nothing changed", in words.
    """

    name: str
    statistic: np.ndarray
    dof: np.ndarray
    threshold: np.ndarray
    p_value: np.ndarray
    level: float
    reference: str

    @property
    def alarm(self) -> np.ndarray:
        """(W,) bool; False where there is nothing to test."""
        return np.asarray(self.statistic > self.threshold)

    @property
    def judged(self) -> np.ndarray:
        """(W,) bool."""
        return np.isfinite(self.statistic) & np.isfinite(self.threshold)


@dataclass(frozen=True)
class Verdicts:
    """Verdicts of one method on W windows.

    method: its name; tests: it alarms when any of them does (they share the false-alarm probability); names (q,):
    what `evidence` (W, q) speaks of, and `kind` of which kind they are; `meaning`: what the evidence is;
    isolated (W, q) bool, nothing where there is no alarm, None for a method that isolates nothing; converged
    (W,): False where an iteration stopped unfinished, and such a window has no verdict.

    likeliest (W, q) bool: what explains each window best whether it alarms or not, for a method that can say so;
    probability (W,) that exactly this is right, NaN where there is none; None for a method that states none.
    doubtful: why a window has no verdict although its tests could be made, by window.
    """

    method: str
    tests: tuple[DetectionTest, ...]
    kind: str
    names: tuple[str, ...]
    meaning: str
    evidence: np.ndarray
    isolated: np.ndarray | None
    converged: np.ndarray
    likeliest: np.ndarray | None = field(default=None, kw_only=True)
    probability: np.ndarray | None = field(default=None, kw_only=True)
    doubtful: dict[int, str] = field(default_factory=dict, kw_only=True)

    @property
    def alarm(self) -> np.ndarray:
        """(W,) bool."""
        return np.asarray(np.any([test.alarm for test in self.tests], axis=0) & self.judged)

    @property
    def judged(self) -> np.ndarray:
        """(W,) bool: windows with a verdict."""
        known = np.ones(len(self.converged), bool)
        known[list(self.doubtful)] = False
        return np.asarray(np.any([test.judged for test in self.tests], axis=0) & self.converged & known)

    def isolated_names(self, window: int) -> tuple[str, ...] | None:
        """What is isolated in one window; None for a method that isolates nothing."""
        if self.isolated is None:
            return None
        return tuple(name for name, hit in zip(self.names, self.isolated[window], strict=True) if hit)

    def why_not(self, window: int) -> str:
        """Why a window has no verdict; empty where it has one."""
        if self.judged[window]:
            return ""
        if not self.converged[window]:
            return "the re-estimate did not converge"
        return self.doubtful.get(window, f"too few readings for any test of {self.method}")


def chi_square_test(name: str, statistic: np.ndarray, dof: np.ndarray, false_alarm: float) -> DetectionTest:
    """Test of statistic (W,) that is χ² with dof (W,) degrees of freedom when nothing changed."""
    from scipy.stats import chi2

    if not 0 < false_alarm < 1:
        raise ValueError("`false_alarm` must lie between 0 and 1")
    statistic, dof = np.broadcast_arrays(np.asarray(statistic, float), np.asarray(dof, float))
    usable = dof > 0
    safe = np.where(usable, dof, 1.0)
    return DetectionTest(
        name,
        np.where(usable, statistic, np.nan),
        dof,
        np.where(usable, chi2.isf(false_alarm, safe), np.nan),
        np.where(usable, chi2.sf(statistic, safe), np.nan),
        false_alarm,
        "chi-square",
    )
