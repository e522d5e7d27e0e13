"""How likely variables are at a place, whatever the form: all smooth curves and surfaces of them at once.

A law of a form that no list holds is read as a form of the list, often of other variables that bend as it does. So
variables are weighed by more than forms. With q_i(x) orthonormal polynomials over the records,

    f = δ + Σ_i α_i q_i(x) + Σ_j β_j q_j(y) + Σ_ij γ_ij q_i(x) q_j(y),
    α_i ~ N(0, A_x² ρⁱ),     β_j ~ N(0, A_y² ρʲ),     γ_ij ~ N(0, A_xy² ρⁱ⁺ʲ)

(the variances of a part scaled to add up to its A²) the evidence is that of a linear model, W its variances,

    ln B = ½ gᵀ(W⁻¹ + G)⁻¹g − ½ ln|1 + W G|,     g = C⊥ᵀ(e + c f₀),     G = C⊥ᵀC⊥

averaged over sizes A and smoothness ρ. It is taken at a fit that carries a law f₀ at that place, which is added back to
what this fit leaves: a model without a large law answers it with other derivatives.

Source: C. E. Rasmussen, C. K. I. Williams, Gaussian Processes for Machine Learning (2006), sections 2.2 and 5.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from enginediag_cli.mismatch.fit.freeform import Location
from enginediag_cli.mismatch.laws.linear import linear_evidence, ln_mean
from enginediag_cli.mismatch.laws.polynomials import orthonormal, variances
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import KnownVariable, number_of_groups, share_of_variables
from enginediag_cli.progress import stage

UNLISTED, UNLISTED_OF_TWO = 0.3, 0.02
"""Shares of laws of one variable, and of two, that have no listed form. Judgement: surfaces of two variables that move
nearly together bend along either and along what they differ by, and imitate any sharp curve of one."""
BEST = 8
"""Sets of variables that are weighed again with more degrees."""

LEVEL, SECOND, BOTH = 0, 1, 2
"""Parts of a surface: the first variable's own with the level, the second's, and what both do together."""


@dataclass(frozen=True)
class Smooth:
    """ln evidence of all smooth curves of variables `of` at a place, with the prior of the groups that they are of."""

    place: Location
    of: tuple[KnownVariable, ...]
    evidence: float

    @property
    def groups(self) -> frozenset[int]:
        return frozenset(k.group for k in self.of)

    @property
    def where(self) -> tuple[str, frozenset[int]]:
        """Place, and groups of variables."""
        return self.place.name, self.groups

    @property
    def names(self) -> frozenset[str]:
        return frozenset(k.variable.name for k in self.of)


@dataclass(frozen=True)
class Degrees:
    """Highest of a curve of one variable; of each of two; of their product."""

    alone: int
    beside: int
    together: int

    @property
    def products(self) -> list[tuple[int, int]]:
        return [(i, j) for i, j in product(range(1, self.together), repeat=2) if i + j <= self.together]


ROUGH, FINE = Degrees(7, 5, 5), Degrees(11, 8, 8)
"""Of all variables, and of those that come out best."""


@dataclass(frozen=True)
class Block:
    """Columns of the features of some variables, with the part of the surface and the degree of each."""

    of: tuple[KnownVariable, ...]
    columns: tuple[int, ...]
    parts: tuple[int, ...]
    degrees: tuple[int, ...]


@stage("weighing variables of laws")
def smooth_evidence(said: Said, known: Sequence[KnownVariable], prior: float) -> list[Smooth]:
    """All variables and pairs of them at a place, likeliest first, of what that says by linearisation at the fit that
    carries a law there. ln evidence against the base; `prior`: ln, of the place."""
    every: list[tuple[KnownVariable, ...]] = [(k,) for k in known]
    every += [pair for pair in combinations(known, 2) if pair[0].group != pair[1].group]
    found = _weighed(said, every, ROUGH)
    order = sorted(range(len(every)), key=lambda k: -found[k])[:BEST]
    for k, evidence in zip(order, _weighed(said, [every[k] for k in order], FINE), strict=True):
        found[k] = max(found[k], evidence)
    groups = number_of_groups(known)
    weighed = [
        Smooth(said.at.place, of, e + prior_of_variables(of, groups) + prior + said.gain)
        for of, e in zip(every, found, strict=True)
    ]
    return sorted(weighed, key=lambda s: (-s.evidence, sorted(s.names)))


def prior_of_variables(of: Sequence[KnownVariable], groups: int) -> float:
    """ln of that of a law of variables that has no listed form: those that cannot be told apart have their group's."""
    return float(np.log((UNLISTED if len(of) == 1 else UNLISTED_OF_TWO) * share_of_variables(len(of), groups)))


def _weighed(said: Said, sets: Sequence[tuple[KnownVariable, ...]], to: Degrees) -> list[float]:
    """ln evidence of each set of variables, against the fit without the law that is carried."""
    curves, blocks = _features(sets, to)
    (G,), (g,), _ = said.of(curves[:, None, :])
    size = float(np.std(said.at.f))
    # sizes are those of the law that was found, which might have been anything as large as the place allows
    priced = min(float(np.log(size / said.at.place.scale)), 0.0)
    found = []
    for b in blocks:
        own = list(b.columns)
        W = size**2 * variances(b.parts, b.degrees)
        found.append(ln_mean(linear_evidence(G[np.ix_(own, own)], g[own], W)) + priced)
    return found


def _features(sets: Sequence[tuple[KnownVariable, ...]], to: Degrees) -> tuple[np.ndarray, list[Block]]:
    """Curves (N, F), and which of them each set of one variable or two has."""
    known = {k.variable.name: k for of in sets for k in of}
    most = max(to.alone, to.beside)
    own = {n: orthonormal(k.values, most) for n, k in known.items()}
    at = {n: 1 + most * j for j, n in enumerate(own)}
    columns = [np.ones((len(next(iter(own.values()))), 1)), *own.values()]
    count, blocks = 1 + most * len(own), []
    for of in sets:
        degree = to.alone if len(of) == 1 else to.beside
        terms = [(0, LEVEL, 1)]
        for part, k in enumerate(of):
            terms += [(at[k.variable.name] + d, part, d + 1) for d in range(degree)]
        if len(of) == 2:
            a, b = (own[k.variable.name] for k in of)
            columns.append(np.column_stack([a[:, i - 1] * b[:, j - 1] for i, j in to.products]))
            terms += [(count + c, BOTH, i + j) for c, (i, j) in enumerate(to.products)]
            count += len(to.products)
        at_columns, parts, degrees = zip(*terms, strict=True)
        blocks.append(Block(of, at_columns, parts, degrees))
    return np.column_stack(columns), blocks
