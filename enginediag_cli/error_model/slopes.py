"""Wrong sensitivities: a generic map tells wrongly what a change does, in proportion to the change.

A map whose slope is wrong by Δ gives, when a fault moves its machine by Δξ on it, a wrong efficiency or flow

    δq = Δ · (ξ_c(θ̂) − ξ_c(θ0)),     Δ ~ N(0, s²),  s = 0.2 (efficiency), 0.5 (flow) for generic maps,

for each coordinate ξ of machine c, ln corrected speed and ln flow or pressure ratio. It acts where the health
parameter of that map quantity does, so that it is an uncertainty of a change of that parameter: none where nothing has
changed. A map whose slope is wrong at one operating point is wrong elsewhere, too, though not by as much: half of the
variance is common to all points of a window (`COMMON`), the other half each point's own. s is stated, not estimated:
healthy records of one operating point know nothing of it, and the likelihood of several prefers values that fail on
other fleets.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from enginediag_cli.error_model.curves import QUANTITIES, columns_of, machines_of
from enginediag_cli.error_model.modelled import ErrorModel

SLOPES = {"efficiency": 0.2, "flow_capacity": 0.5}
"""Standard deviation of ∂ln q/∂ξ of a generic map. 0.15 to 0.3 with 0.5 to 1 do as well on fleets with generic maps,
0.2 with 0.3 does not."""
GENERIC = 0.01
"""Stated accuracy of maps that are generic; slopes of better ones are better in proportion."""

TURNS = 30
"""Of the variance that depends on the change that depends on it: each one halves what is missing."""
SETTLED = 0.01
"""Share of the largest variance to which it is then known: a standard deviation to half a per cent."""


COMMON = 0.5
"""Share of the variance of a wrong slope that all operating points of a window have in common. Judgement: points may
lie side by side or at the ends of the map. With all of it in common, what single conditions show differently is told
as a second change; with none, the error averages out that a generic map has everywhere. Of 240 simulated engines of
fleets at six conditions on other maps 24 were named wrongly with all of it, none with half and 1 with none."""


@dataclass(frozen=True)
class MapSlopes:
    """`position` (k,): of the uncertain map quantities among the monitored parameters; `moved` (k, 2, a): how far a
    unit of each of the a monitored parameters moves the machine on its map; `sigma` (k,): of ∂ln q/∂ξ."""

    position: np.ndarray
    moved: np.ndarray
    sigma: np.ndarray

    def of(self, kept: Sequence[int]) -> MapSlopes | None:
        """The same for those of the monitored parameters that are kept; None where none of them is a map's."""
        place = {i: k for k, i in enumerate(kept)}
        rows = [r for r, i in enumerate(self.position) if int(i) in place]
        if not rows:
            return None
        position = np.array([place[int(self.position[r])] for r in rows])
        return MapSlopes(position, self.moved[rows][:, :, list(kept)], self.sigma[rows])

    def variance(self, change: np.ndarray) -> np.ndarray:
        """Variance (a,) that a change (a,) of the monitored parameters adds to each of them."""
        added = np.zeros(len(change))
        distance = np.sum((self.moved @ change) ** 2, axis=1)
        added[self.position] = self.sigma**2 * distance
        return added

    def likely_variance(self, pull: np.ndarray, information: np.ndarray, spread: np.ndarray) -> np.ndarray:
        """Variance (a,) that the change adds which statistics speak of: score (a,) and information (a, a), `spread`
        (a,) of a plausible change, 0 of what is taken not to have changed.

        The likeliest change depends on the variance in turn, since readings mean less where slopes are wrong:

            c = σ²(v) of     δ = S (1 + I (C + S))⁻¹ b,     C = diag(c),  S = diag(spread²)

        A change estimated with right slopes is too large by what they explain, and its variance by the square of that.
        """
        own = np.flatnonzero(spread > 0)
        scale = spread[own]
        b, square = scale * pull[own], scale[:, None] * information[np.ix_(own, own)] * scale
        change, variance = np.zeros(len(spread)), np.zeros(len(spread))
        for turn in range(TURNS):
            inner = np.eye(len(own)) + square * (variance[own] / scale**2 + 1.0)
            change[own] = scale * np.linalg.solve(inner, b)
            found = self.variance(change)
            if np.max(np.abs(found - variance), initial=0.0) <= SETTLED * np.max(found, initial=0.0):
                return found
            # a larger variance makes the change smaller: halfway there and back do not swing about the answer
            variance = (found + variance) / 2 if turn else found
        return np.maximum(found, variance)  # where it has not settled, the wider of the last two


def map_slopes(
    engine: Any, found: ErrorModel, monitored: Sequence[str], inputs: dict[str, np.ndarray], theta: dict[str, float]
) -> MapSlopes | None:
    """Slopes at operating points `inputs` (n,) and parameters `theta`; None where no monitored parameter is a map's."""
    share = min(found.stated / GENERIC, 1.0)
    machines = machines_of(engine)
    wanted = columns_of(machines)
    known = [
        (m, q, monitored.index(m.parameter(q)))
        for m in machines
        for q in QUANTITIES
        if m.parameter(q) in monitored and m.parameter(q) in found.sizes
    ]
    if not known or share == 0.0:
        return None
    p = engine.predict(inputs, theta, sensors=wanted, wrt=tuple(monitored))
    ok = p.ok & np.isfinite(p.jacobian).all(axis=(1, 2))
    if not ok.any():
        return None
    relative = p.jacobian[ok] / p.y[ok][:, :, None]  # ∂ln column/∂θ
    log = dict(zip(wanted, np.mean(relative, axis=0), strict=True))
    moved = np.array([m.differentials(log) for m, _, _ in known])
    return MapSlopes(np.array([i for _, _, i in known]), moved, share * np.array([SLOPES[q] for _, q, _ in known]))
