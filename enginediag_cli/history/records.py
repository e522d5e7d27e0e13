"""The history of one engine: per flight a score and an information matrix, and what they speak of.

    s_t ~ N(F_t (θ_t, ν), F_t),      θ_t (p,) monitored parameters, ν (r,) ~ N(0, I) uncertain about nominal,
                                     the same in all flights

in units of prior standard deviations. Nothing is marginalised yet: what is uncertain about nominal counts once for all
flights, and an instrument's offset once for each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.parameters import Parameter

LEAST_INFORMATION = 0.5
"""Information of a unit normal over all flights below which it is left out: what it adds to the variance of any
estimate is a half of what noise has at most, and of one that a change would need, a hundredth. Results of histories
with and without those of less have the same three digits, in half the time."""


@dataclass(frozen=True)
class KnownShift:
    """Parameters at `positions` (c,) that may have moved by the standard deviations `sizes` (c,), in prior ones, along
    a course (T,), for a reason that is known and no change: the unit normals from number `first` on, from 0, among
    those that all flights share. A course of ones is the engine's own level."""

    first: int
    positions: np.ndarray
    sizes: np.ndarray
    course: np.ndarray

    @property
    def constant(self) -> bool:
        """Whether it is in all flights alike."""
        return bool(np.all(self.course == 1.0))


@dataclass(frozen=True)
class History:
    """T flights in order of time.

    score (T, m), information (T, m, m): of the p monitored `parameters` first, then of r unit normals that all flights
    share. unit (p,): prior standard deviations, in the parameters' units. labels (T,): what the flights are called.
    maintenance: positions of flights before which somebody worked on the engine, in rising order. shifts: which
    of the unit normals move parameters for a reason that is known.
    """

    parameters: tuple[Parameter, ...]
    unit: np.ndarray
    score: np.ndarray
    information: np.ndarray
    labels: tuple[str, ...] = ()
    maintenance: tuple[int, ...] = ()
    shifts: tuple[KnownShift, ...] = ()

    def __post_init__(self) -> None:
        T, m = self.score.shape
        if self.information.shape != (T, m, m):
            raise ValueError(f"`information` must have shape {(T, m, m)}, not {self.information.shape}")
        if len(self.unit) != len(self.parameters) or len(self.unit) > m:
            raise ValueError("every monitored parameter needs a unit and a score")

    def __len__(self) -> int:
        return len(self.score)

    @property
    def width(self) -> int:
        """How many parameters are monitored."""
        return len(self.parameters)

    @property
    def sensors(self) -> np.ndarray:
        """Positions of the biases of sensors: an epoch's readings."""
        return np.array([i for i, p in enumerate(self.parameters) if p.belongs_to_sensor and p.quantity == "bias"], int)

    def instruments(self) -> dict[str, list[int]]:
        """Positions of the forms of error of each instrument, its usual one first."""
        found: dict[str, list[int]] = {}
        for i, parameter in enumerate(self.parameters):
            if parameter.belongs_to_instrument:
                found.setdefault(parameter.component, []).append(i)
        return found
