"""Points of a batch that have not converged, and the step that each takes next.

Far from the solution a step is Newton's, -J⁻¹ R with the Jacobian J there. Near it J of before is corrected by what the
last steps s, s' have shown of it (Broyden's update):

    t = -J⁻¹ R,      t' = t + s' (s·t) / s·s,      step = t' / (1 - s'·t' / s'·s'),

or, of few points, J itself is updated, until a step gains less than it should (C. T. Kelley, Iterative Methods for
Linear and Nonlinear Equations, 1995, ch. 7). A step is shortened so that no unknown moves by more than `LARGEST_STEP`
of itself, and halved again where the residual grew.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from enginediag_cli.engine import elimination
from enginediag_cli.engine.dual import Array
from enginediag_cli.engine.effort import GAINS, TOLERANCE, Effort

LARGEST_STEP = 0.4
"""Largest change of an unknown in one step, as a share of itself: beyond it the linear model says little about maps.
Judgement."""
SMALL = 0.05  # unknowns are of order one; smaller ones may move by this much of LARGEST_STEP
MAX_HALVINGS = 6
"""A step a sixty-fourth as long that still gains nothing is taken, since it may lead out of a fold. Judgement."""
PROGRESS, PATIENCE = 0.9, 10
"""A point whose residual has not fallen to this share of its lowest in so many passes is given up: of those that
converge at all, nearly a thousandth waits longer, and has other starts."""
LARGEST_SHARE = 0.5
"""Largest s'·t'/s'·s' that is believed: near 1 the step would have no end."""
TINY = 1e-300
"""In place of a square that is zero, of a step that was not taken."""


@dataclass
class OpenPoints:
    """Points that have not converged: where the last accepted step began, the step and the one before; LU (nx, nx, n)
    and order (nx, n) of the Jacobian, or the Jacobian of few points in place of LU; whether the next pass is to give a
    fresh one, and what residual is expected of it."""

    index: Array
    x: Array
    base: Array
    step: Array
    earlier: Array
    base_norm: Array
    halvings: Array
    LU: Array
    order: Array
    fresh: Array
    expected: Array
    lowest: Array
    waited: Array

    @staticmethod
    def at(x: Array) -> OpenPoints:
        nx, n = x.shape
        return OpenPoints(
            index=np.arange(n),
            x=x.copy(),
            base=x.copy(),
            step=np.zeros_like(x),
            earlier=np.zeros_like(x),
            base_norm=np.full(n, np.inf),
            halvings=np.zeros(n, dtype=int),
            LU=np.zeros((nx, nx, n)),
            order=np.zeros((nx, n), dtype=int),
            fresh=np.ones(n, dtype=bool),
            expected=np.full(n, np.inf),
            lowest=np.full(n, np.inf),
            waited=np.zeros(n, dtype=int),
        )

    def step_on(self, R: Array, norm: Array, effort: Effort) -> Array:
        """The next step of every point from its balances R (nx, n) and the largest of them, norm (n,); which points
        stay open (n,)."""
        # a step that made things worse is halved, a few times in a row
        rejected = (norm > self.base_norm) & (self.halvings < MAX_HALVINGS)
        stalled = (norm <= TOLERANCE) & (norm > GAINS * self.base_norm)
        going = ~rejected & ~stalled & np.isfinite(norm)
        disappointed = going & ~self.fresh & (norm > effort.gains * self.base_norm)
        accepted = going & ~disappointed
        if accepted.any():
            # what is computed of all, for what is taken of some
            whole = 2 * np.count_nonzero(accepted) >= len(accepted)
            self._accept(slice(None) if whole else np.flatnonzero(accepted), accepted, R, norm, effort)
        self.step[:, rejected] *= 0.5
        self.halvings[rejected] += 1
        # asked again where it is, with the Jacobian
        self.base[:, disappointed], self.step[:, disappointed] = self.x[:, disappointed], 0.0
        self.base_norm[disappointed] = np.inf
        self.fresh |= rejected | disappointed
        return np.asarray((going | rejected) & ~stalled & np.isfinite(self.step).all(axis=0))

    def hopeful(self, norm: Array) -> Array:
        """Points (n,) whose residual has fallen lately."""
        fallen = norm < PROGRESS * self.lowest
        self.waited = np.where(fallen, 0, self.waited + 1)
        self.lowest = np.where(fallen, norm, self.lowest)
        return self.waited <= PATIENCE

    @np.errstate(all="ignore")  # what cannot be solved leaves the batch
    def _accept(self, some: Array | slice, accepted: Array, R: Array, norm: Array, effort: Effort) -> None:
        """Steps of the accepted points, which are among `some`."""
        fresh, before, x = self.fresh[some], self.base_norm[some], self.x[:, some]
        if effort.by_differences:
            step = self._updated(some, accepted, R[:, some])
        else:
            step = -elimination.substituted(self.LU[:, :, some], self.order[:, some], R[:, some])
            if not fresh.all():
                self._correct(step, some, fresh)
        largest = np.max(np.abs(step) / np.maximum(np.abs(x), SMALL), axis=0)
        step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, TINY))
        norm = norm[some]
        # with its own Jacobian the next residual is about the square of this, with the last one's it shrinks as before
        expected = norm * np.where(fresh | ~np.isfinite(before), norm, norm / before)
        again = (norm >= effort.near) | (largest > LARGEST_STEP)
        taken = some
        if not accepted[some].all():
            those = np.flatnonzero(accepted[some])
            taken, x, step = np.flatnonzero(accepted), x[:, those], step[:, those]
            norm, expected, again, fresh = norm[those], expected[those], again[those], fresh[those]
        if not effort.by_differences:
            self.earlier[:, taken] = np.where(fresh, 0.0, self.step[:, taken])
        self.base[:, taken], self.step[:, taken] = x, step
        self.base_norm[taken], self.halvings[taken] = norm, 0
        self.expected[taken], self.fresh[taken] = expected, again

    def _correct(self, step: Array, some: Array | slice, fresh: Array) -> None:
        """Corrects steps by those since their Jacobian was computed."""
        first, last = self.earlier[:, some], self.step[:, some]
        step += last * np.where(fresh, 0.0, (first * step).sum(axis=0) / np.maximum((first * first).sum(axis=0), TINY))
        share = np.where(fresh, 0.0, (last * step).sum(axis=0) / (last * last).sum(axis=0))
        step /= np.where(share < LARGEST_SHARE, 1.0 - share, 1.0)

    def _updated(self, some: Array | slice, accepted: Array, R: Array) -> Array:
        """Steps -J⁻¹ R of points whose Jacobians are at hand themselves, J + R sᵀ / s·s after a step s that left R."""
        J, last = self.LU[:, :, some], self.step[:, some]
        square = np.where(self.fresh[some] | ~accepted[some], 0.0, (last * last).sum(axis=0))
        if square.any():
            J = J + R[:, None] * (last * np.where(square > 0.0, 1.0 / np.maximum(square, TINY), 0.0))
            self.LU[:, :, some] = J
        return -elimination.directly(J, R)

    def kept(self, keep: Array) -> OpenPoints:
        if keep.all():
            return self
        return OpenPoints(*(getattr(self, f.name)[..., keep] for f in fields(self)))
