"""Which places the readings cannot tell from that of a concealed law.

A rival is the law's own curve over the records, of any size and with a constant beside it, at another place:

    λ_sep(place) = χ² of the flights without noise with c₁ f + c₀ at the place, all that is identified fitted anew

All places are judged by projection at the fit without a law; the nearest few are fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.families import Sums, grid
from enginediag_cli.mismatch.fit.freeform import Location, locations
from enginediag_cli.mismatch.fit.identified import Hypothesis, Identified, Nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.validation.blind.lowest import lowest
from enginediag_cli.validation.blind.separability import ALIAS, NEAR

REFITTED = 4
"""Places, nearest by projection first, that are fitted."""
BELIEVED = 10.0
"""Prior standard deviation of a rival's curve, over what its place roams: what would have to be larger is no rival."""


def place_separability(base: Identified, along: Nuisance, f: np.ndarray, truth: Location) -> Mapping[str, float]:
    """λ_sep by name of every place but the true one. `base`: fit without the law, and with all else that is concealed,
    to flights without noise; `f`: the law's curve over all records of the evidence (N,)."""
    where = [p for p in locations(base) if p.name != truth.name]
    columns = Columns(base, [p.parameter for p in where], [p.through for p in where if p.through is not None])
    names = list(dict.fromkeys(p.parameter for p in where))
    projection = Projection(base)
    curves = np.column_stack([f, np.ones(len(f))])[base.number]
    sums = Sums(projection, columns, grid(names, curves, [[0, 1]]))
    left = {}
    for p in where:
        own = np.array([[names.index(p.parameter), 0], [names.index(p.parameter), 1]])
        left[p.name] = projection.objective - sums.score(own).statistic
    near = sorted((p for p in where if left[p.name] < NEAR + 0.05 * projection.objective), key=lambda p: left[p.name])
    for p in near[:REFITTED]:
        rival = joined(base.hypothesis, curved(p, {"law": f - f.mean()}, base, BELIEVED))
        fit = lowest(base.evidence, rival, along, base, ALIAS)
        if fit.converged:
            left[p.name] = Projection(fit).objective
    return left


def inseparable(left: Mapping[str, float]) -> frozenset[str]:
    """Names of the places that cannot be told from the true one."""
    return frozenset(name for name, x in left.items() if x < ALIAS)


def joined(*hypotheses: Hypothesis) -> Hypothesis:
    """All of them at once."""
    return Hypothesis(
        tuple(e for h in hypotheses for e in h.effects),
        tuple(d for h in hypotheses for d in h.discrepancies),
        {k: v for h in hypotheses for k, v in h.curves.items()},
    )


def curved(place: Location, curves: Mapping[str, np.ndarray], base: Identified, over: float = 1.0) -> Hypothesis:
    """The place's parameter free to follow curves (N,) of the evidence's records, and to be off by a constant where it
    is not identified; each by `over` times what the place roams, as root mean square."""
    own = {n: c / max(float(np.nanstd(c)), 1e-300) for n, c in curves.items()}
    if place.parameter not in base.problem.names and place.through is None:
        own["always"] = np.ones(len(next(iter(own.values()))))
    sought = tuple(Discrepancy(place.parameter, n, over * place.scale) for n in own)
    return Hypothesis(() if place.through is None else (place.through,), sought, own)


def place_named(places: Sequence[Location], name: str) -> Location | None:
    return next((p for p in places if p.name == name), None)
