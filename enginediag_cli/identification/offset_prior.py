"""A nuisance of identification: an error of an instrument that differs from one recording to the next."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

PRIOR_DEGREES = 2
"""Degrees of freedom that what is usual is worth: those of a size that is known within a factor of two or so."""


@dataclass(frozen=True)
class OffsetPrior:
    """An error that is constant in one recording: `bias` in the column's unit, `scale` a fraction.

    sensor: column of a measured output, or of an input of the model; recordings: from how many its size was estimated,
    0 where it is stated.
    """

    sensor: str
    kind: str
    prior_sigma: float
    recordings: int = 0

    @property
    def next_sigma(self) -> float:
        """Standard deviation of the offset of a further recording, whose law is Student's while the size is uncertain:
        of R recordings R − 1 degrees of freedom, and PRIOR_DEGREES of what is known before."""
        if not self.recordings:
            return self.prior_sigma
        degrees = self.recordings - 1 + PRIOR_DEGREES
        return float(self.prior_sigma * sqrt(degrees / (degrees - 2)))
