"""A nuisance of identification: a sensor error that differs from one recording to the next."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class OffsetPrior:
    """A sensor error that is constant in one recording: `bias` in the column's unit, `scale` a fraction."""

    sensor: str
    kind: str
    prior_sigma: float
