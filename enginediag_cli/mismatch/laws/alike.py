"""Which places these recordings cannot tell from that of a law: the same curve there says nearly the same.

With c the column of the law f at its place and C those of f and of a constant at another, of any size, both freed of
all that is identified,

    λ_sep = cᵀc − cᵀC (CᵀC)⁺ Cᵀc

is the misfit that the other place would leave. Below ALIKE no test tells the two apart, whatever its evidence says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.fit.trial import HypothesisFit

ALIKE = 11.0
"""λ_sep from which two accounts are told apart: 3.3 standard errors along the one direction in which they differ, as
blind trials count it (`ALIAS` of `validation/separability.py`)."""
SMALLEST = 1e-10
"""Eigenvalue of CᵀC, over the largest, below which a direction is what identification has taken."""


def places_alike(
    base: HypothesisFit, place: Location, f: np.ndarray, others: Sequence[Location]
) -> tuple[Location, ...]:
    """Those of `others` that cannot be told from `place`, where a law is f (N,) over the records of the base, which is
    fitted without it."""
    others = [p for p in others if p.name != place.name]
    every = [place, *others]
    columns = Columns(base.found, [p.parameter for p in every], [p.through for p in every if p.through is not None])
    names = list(dict.fromkeys(p.parameter for p in every))
    at = {p.name: names.index(p.parameter) for p in every}
    curves = np.column_stack([f, np.ones(len(f))])
    together = [(at[place.name], at[p.name]) for p in others if at[p.name] != at[place.name]]
    sums = Sums(base.projection, columns, grid(names, curves, [[0, 1]], together))
    found = []
    for p in others:
        G = sums.gram(np.array([(at[place.name], 0), (at[p.name], 0), (at[p.name], 1)]))
        left = G[0, 0] - G[0, 1:] @ np.linalg.pinv(G[1:, 1:], rcond=SMALLEST, hermitian=True) @ G[1:, 0]
        if left < ALIKE:
            found.append(p)
    return tuple(found)
