"""How large a coefficient may be that no record tells of: a limit that nothing met.

The derivative by a limit that nothing has met is zero, and so is its information: the normal approximation answers with
the prior. The records do tell something: from some size on they would have met it. The fit is therefore predicted
with the coefficient at sizes that double each time, and what that changes, c, freed of all else that is fitted, costs

    χ²(s) − χ²(absent) = c⊥ᵀc⊥ − 2 c⊥ᵀe

The interval ends where that is BEYOND above its least.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.projection import Projection, Rows, Whitening

if TYPE_CHECKING:
    from enginediag_cli.mismatch.fit.identified import IdentifiedHypothesis

WITHIN = 9
"""Sizes that are tried where it begins to be noticed."""
BEYOND = 3.84
"""χ² that a size on the border of a 95 % interval costs."""
SIZES, SMALLEST = 14, 1e-3
"""Sizes that are tried, the smallest in prior standard deviations: the largest is then eight of them."""
UNTOLD = 0.5
"""Of its prior standard deviation, from which on a standard error says that records tell nothing. Judgement."""


class _Given(Columns):
    """What sizes (k,) of one coefficient change of the readings of a fit, (N, m, k)."""

    def __init__(self, found: IdentifiedHypothesis, name: str, sizes: np.ndarray):
        super().__init__(found, (), ())
        self.at = {_at(k): k for k in range(len(sizes))}
        inputs, sensors = found.problem.inputs, found.problem.sensors
        here = found.model.predict(inputs, found.theta, sensors=sensors).y
        moved = [found.model.predict(inputs, found.theta | {name: float(s)}, sensors=sensors).y - here for s in sizes]
        self._changes = np.where(found.fit.failed[:, None, None], 0.0, np.nan_to_num(np.stack(moved, axis=2)))

    def whitened(self, projection: Projection) -> Iterator[tuple[Rows, np.ndarray, np.ndarray | None]]:
        whitening = Whitening(projection.frame)
        for rows in projection.stream():
            yield rows, *whitening.parts(self._changes[rows.span], rows.span)


def _at(k: int) -> str:
    return f"size {k}"


def largest(projection: Projection, name: str) -> float:
    """The size of a coefficient that is fitted as absent at which it would begin to be noticed; its upper bound where
    none is."""
    p = projection.found.model.parameters[name]
    sizes = p.prior_sigma * SMALLEST * 2.0 ** np.arange(SIZES)
    sizes = np.concatenate([[0.0], sizes[sizes < p.upper]])
    for _ in range(2):
        costs = _costs(projection, name, sizes)
        noticed = np.flatnonzero(costs - min(costs.min(), 0.0) > BEYOND)
        noticed = noticed[noticed > costs.argmin()]
        if not noticed.size:
            return float(p.upper)
        # it begins between two of them, and rises more steeply the larger it is
        sizes = np.linspace(sizes[noticed[0] - 1], sizes[noticed[0]], WITHIN)
    return float(sizes[-1])


def _costs(projection: Projection, name: str, sizes: np.ndarray) -> np.ndarray:
    """Rise of χ² with each size (k,)."""
    found = projection.found
    given = _Given(found, name, sizes)
    sums = Sums(projection, given, grid(list(given.at), np.ones((len(found.number), 1)), [[0]]))
    each = [np.array([[k, 0]]) for k in range(len(sizes))]
    return np.array([float(sums.gram(one)[0, 0] - 2.0 * sums.pulls(one)[0]) for one in each])
