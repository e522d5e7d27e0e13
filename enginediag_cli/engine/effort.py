"""How far an iteration goes, and when it needs a fresh Jacobian."""

from __future__ import annotations

from dataclasses import dataclass

TOLERANCE = 1e-10  # on every balance, all of order one
AIM = 1e-3
"""Share of TOLERANCE that the iteration aims at, so that differences of solutions 1e-5 apart are good to
a ten-millionth. A point that cannot come nearer, for rounding, and meets TOLERANCE is solved all the same."""
MAX_ITERATIONS = 60
"""Passes at most: a good start needs a few; what has not converged by then does not. Judgement."""
NEAR, NEAR_BY_DIFFERENCES = 5e-3, 6e-6
"""Largest residual from which a full step with the Jacobian there is expected to gain so much that the next passes need
none: measured on batches of 300 to 10,000 points whose parameters are 0 to 12 % off, and of 1 to 40 points whose power
setting is. A Jacobian from differences costs little more than a pass without, and does not gain by being late."""
GAINS, GAINS_BY_DIFFERENCES = 0.3, 0.1
"""A step that leaves more than this share of the residual says that the Jacobian is no longer good: so much is gained
by three passes without it that cost as much as one with it; from differences it costs less than two."""


@dataclass(frozen=True)
class Effort:
    """How far an iteration goes: passes at most, largest residual left (None: by AIM); `by_differences`: with Jacobians
    from forward differences in one widened batch, which for a few points costs one plain pass."""

    max_iterations: int = MAX_ITERATIONS
    tolerance: float | None = None
    by_differences: bool = False

    @property
    def aim(self) -> float:
        """The largest residual at which a point is left alone."""
        return AIM * TOLERANCE if self.tolerance is None else self.tolerance

    @property
    def gains(self) -> float:
        """The largest share of the residual that a step may leave without a fresh Jacobian."""
        return GAINS_BY_DIFFERENCES if self.by_differences else GAINS

    @property
    def near(self) -> float:
        """The residual from which a Jacobian serves for the next steps too."""
        return NEAR_BY_DIFFERENCES if self.by_differences else NEAR
