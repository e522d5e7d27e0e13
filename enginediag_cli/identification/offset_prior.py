"""A nuisance of identification: an error of an instrument that differs from one recording to the next."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp


@dataclass(frozen=True)
class OffsetPrior:
    """An error that is constant in one recording: `bias` in the column's unit, `scale` a fraction.

    sensor: column of a measured output, or of an input of the model; prior_sigma: its standard deviation between
    recordings, the likeliest where it was estimated; recordings: from how many, 0 where it is stated; spread: standard
    deviation of ln prior_sigma by what these recordings leave open.
    """

    sensor: str
    kind: str
    prior_sigma: float
    recordings: int = 0
    spread: float = 0.0

    @property
    def next_sigma(self) -> float:
        """Standard deviation of the offset of a further recording, its size integrated out: with ln s ~ N(ln s₀, v²)

        E[s²] = s₀² exp(2 v²)
        """
        return self.prior_sigma * exp(self.spread**2)
