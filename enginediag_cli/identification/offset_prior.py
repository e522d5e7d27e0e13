"""A nuisance of identification: an error of an instrument that differs from one recording to the next."""

from __future__ import annotations

from dataclasses import dataclass


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
