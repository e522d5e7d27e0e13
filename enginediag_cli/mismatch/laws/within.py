"""Whether physics allows what a law says: no air is more than saturated, no duct gains pressure.

What a law moves goes from `low` to `high` about its mean over the records, with standard errors σ of both. From where
the parameter stands, known to λ, it may move `down` and `up`, and in all by their distance:

    z = max((high − up)/√(σ_high² + λ²), (down − low)/√(σ_low² + λ²), (high − low − (up − down))/(σ_high + σ_low))
    ln w = ln 2Φ(−z) where z > 0, else 0

is added to the law's ln evidence: a law that stays within pays nothing. Where an effect that the engine does not carry
is the place, its level is nothing that a law tells, λ = ∞, and the last alone counts.
Source: I. Klugkist, H. Hoijtink, Comput. Stat. Data Anal. 51 (2007) 6367–6379 (evidence under inequalities).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from enginediag_cli.mismatch.fit.freeform import Location, parameter_at
from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis


@dataclass(frozen=True)
class Room:
    """How far a place's parameter may move from where it stands: `down` (≤ 0) and `up` (≥ 0); `doubt`: λ; in its
    unit."""

    down: float
    up: float
    doubt: float

    @staticmethod
    def at(found: IdentifiedHypothesis, place: Location, mean: float = 0.0) -> Room:
        """Of a fit, that carries a law of this mean there."""
        p = parameter_at(place, found.evidence.engine)
        stands = float(np.clip(found.theta.get(p.name, p.nominal) + mean, p.lower, p.upper))
        known = p.name in found.problem.names
        doubt = np.inf if place.through is not None else 0.0 if known else place.scale
        return Room(p.lower - stands, p.upper - stands, doubt)

    @property
    def all(self) -> float:
        """From end to end."""
        return self.up - self.down

    def of_curves(self, sizes: np.ndarray | float, ends: np.ndarray, statistic: np.ndarray | float) -> np.ndarray:
        """ln w (…) of curves of these sizes (…). `ends` (2, …): of such curves of size 1; `statistic` (…): squares of
        the sizes over their standard errors."""
        at = np.sort(sizes * ends, axis=0)
        return self._within(at, np.abs(at) / np.sqrt(np.maximum(statistic, 1e-300)))

    def allows(self, f: np.ndarray) -> bool:
        """Whether a curve (N,) stays within as it stands."""
        low, high = ends_of(f)
        return bool(high <= self.up and self.down <= low) if np.isfinite(self.doubt) else bool(high - low <= self.all)

    def of_curve(self, f: np.ndarray, error: np.ndarray) -> float:
        """ln w of a curve (N,), with standard errors (N,)."""
        at = [int(np.argmin(f)), int(np.argmax(f))]
        return float(self._within(ends_of(f), error[at]))

    def _within(self, ends: np.ndarray, error: np.ndarray) -> np.ndarray:
        """ln w (…) of what moves a parameter from `ends[0]` to `ends[1]` (2, …) about its mean, with their errors."""
        (low, high), (low_error, high_error) = ends, error
        with np.errstate(divide="ignore", invalid="ignore"):
            z = [
                (high - self.up) / np.hypot(high_error, self.doubt),
                (self.down - low) / np.hypot(low_error, self.doubt),
                (high - low - self.all) / (high_error + low_error),
            ]
        beyond = np.maximum(np.fmax.reduce(z), 0.0)
        return np.asarray(log_ndtr(-beyond) + np.log(2.0))


def ends_of(curves: np.ndarray) -> np.ndarray:
    """The least and the greatest of curves (N, …), about their means: (2, …)."""
    return np.asarray(np.stack([curves.min(axis=0), curves.max(axis=0)]) - curves.mean(axis=0))
