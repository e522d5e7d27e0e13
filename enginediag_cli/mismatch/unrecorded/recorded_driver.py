"""Is the driver of a hidden effect recorded after all?

An amplitude of its own in every record follows any curve, so a recorded driver of unexpected shape (a threshold, a
sharp bend) looks like an unrecorded one. It is not one where a recorded driver gives the amplitude back: as a
polynomial of fourth degree for a continuous amplitude, as a threshold for two states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np

from enginediag_cli.drivers import polynomials
from enginediag_cli.engine.term import DriverValues
from enginediag_cli.mismatch.fit.believable import switching
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.parameters import Parameter

DEGREE = 4
"""Of the amplitude along a recorded driver: shapes that an effect may have; more would follow anything."""
SHARE = 0.6
"""Of the amplitude's variance, weighted by its precision, beyond what as many random curves would take."""

ORDERED = 0.95
"""Probability that the driver is on the same side for a record of either state (area under the ROC curve)."""


class Hidden(Protocol):
    """What the decision needs of a finding of an unrecorded driver; records of the fit, (N,) each."""

    @property
    def significant(self) -> bool: ...
    @property
    def lr(self) -> float: ...
    @property
    def gain(self) -> float: ...
    @property
    def is_switch(self) -> bool: ...
    @property
    def location(self) -> Location: ...
    @property
    def rivals(self) -> tuple[Location, ...]: ...
    @property
    def states(self) -> np.ndarray | None: ...
    @property
    def amplitude(self) -> np.ndarray: ...
    @property
    def standard_error(self) -> np.ndarray: ...
    @property
    def number(self) -> np.ndarray: ...


class HiddenScan(Protocol):
    """What a look for drivers that no column shows has found at a trial, before and after refits."""

    @property
    def gate(self) -> float: ...
    @property
    def largest(self) -> float: ...
    def refitted(self) -> Sequence[Hidden]: ...
    def may_be_commanded(self) -> bool: ...


def commanded(first: Hidden, parameters: Mapping[str, Parameter]) -> bool:
    """Whether the finding is of something that somebody switches on and off."""
    return first.is_switch and first.states is not None and switching(first.location, parameters)


def follows_a_driver(found: Hidden, drivers: Sequence[DriverValues]) -> bool:
    """Whether some recorded driver, of all records of the evidence, gives the amplitude or the states back."""
    for d in drivers:
        values = d.values[found.number]
        if found.is_switch and found.states is not None:
            if _ordering(found.states > 0.5, values) > ORDERED:
                return True
        elif _share(found.amplitude, found.standard_error, values) > SHARE:
            return True
    return False


def _ordering(on: np.ndarray, values: np.ndarray) -> float:
    """Area under the ROC curve of the values for the two states, the larger way round."""
    good = np.isfinite(values)
    a, b = values[good & on], values[good & ~on]
    if not a.size or not b.size:
        return 0.0
    from scipy.stats import mannwhitneyu

    area = float(mannwhitneyu(a, b).statistic) / (a.size * b.size)
    return max(area, 1.0 - area)


def _share(amplitude: np.ndarray, error: np.ndarray, values: np.ndarray) -> float:
    """Adjusted R² of the amplitude along a polynomial of the values."""
    good = np.isfinite(values) & np.isfinite(amplitude) & (error > 0)
    curves = polynomials(np.where(good, values, np.nan), DEGREE)[good]
    n, k = curves.shape
    if n < 3 * (DEGREE + 1) or not k:
        return 0.0
    w = 1.0 / error[good]
    A, y = np.column_stack([np.ones(n), curves]) * w[:, None], amplitude[good] * w
    left = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    flat = y - w * (w @ y) / (w @ w)
    return float(1.0 - (left @ left / (n - k - 1)) / max(flat @ flat / (n - 1), 1e-300))
