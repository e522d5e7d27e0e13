"""What every family of residuals promises: train once, then judge any number of windows together.

A family turns windows of records into detection tests and, where it can, names what changed: parameters
(structured parity equations, observers, estimation, local approach) or only sensors (PCA).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.residuals.monitor import Monitor


@dataclass(frozen=True)
class Windows:
    """W windows of n consecutive records: inputs column -> (W, n), readings y (W, n, m), NaN where missing.

    Windows of unequal length are filled up with records that have no reading (and may have no input).
    """

    inputs: Mapping[str, np.ndarray]
    y: np.ndarray

    def __post_init__(self) -> None:
        if self.y.ndim != 3:
            raise ValueError(f"`y` must have shape (windows, records, sensors), not {self.y.shape}")
        for column, values in self.inputs.items():
            if np.shape(values) != self.y.shape[:2]:
                raise ValueError(f"input {column} must have shape {self.y.shape[:2]}, not {np.shape(values)}")

    @property
    def count(self) -> int:
        """W."""
        return int(self.y.shape[0])

    @property
    def length(self) -> int:
        """n."""
        return int(self.y.shape[1])

    def flat_inputs(self) -> dict[str, np.ndarray]:
        """Inputs column -> (W n,), window after window."""
        return {column: np.asarray(values, float).ravel() for column, values in self.inputs.items()}


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
class FamilyResult:
    """Verdicts of one family on W windows.

    tests: the family alarms when any of them does (they share the false-alarm probability); names (q,): what
    `evidence` (W, q) speaks of, `kind` "parameters", "sensors" or "none"; `meaning`: what the evidence is;
    isolated (W, q) bool, nothing where there is no alarm, None when the family has no isolation; converged
    (W,): False where an iteration stopped unfinished, and such a window has no verdict.
    """

    family: str
    tests: tuple[DetectionTest, ...]
    kind: str
    names: tuple[str, ...]
    meaning: str
    evidence: np.ndarray
    isolated: np.ndarray | None
    converged: np.ndarray

    @property
    def alarm(self) -> np.ndarray:
        """(W,) bool."""
        return np.asarray(np.any([test.alarm for test in self.tests], axis=0) & self.judged)

    @property
    def judged(self) -> np.ndarray:
        """(W,) bool: windows with a verdict."""
        return np.asarray(np.any([test.judged for test in self.tests], axis=0) & self.converged)

    def isolated_names(self, window: int) -> tuple[str, ...] | None:
        """What is isolated in one window; None when the family has no isolation."""
        if self.isolated is None:
            return None
        return tuple(name for name, hit in zip(self.names, self.isolated[window], strict=True) if hit)


class FittedFamily(ABC):
    """A family that knows its engine and, if it learns, the healthy data."""

    @abstractmethod
    def diagnose(self, windows: Windows, false_alarm: float = 0.01) -> FamilyResult:
        """Judge all windows at this false-alarm probability per window."""


class ResidualFamily(ABC):
    """A family with its choices made. `learns`: it needs healthy windows to train."""

    name: ClassVar[str]
    learns: ClassVar[bool] = False

    @abstractmethod
    def train(self, monitor: Monitor, healthy: Windows | None = None) -> FittedFamily:
        """Tie the family to an engine; `healthy` only matters when the family learns."""


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
