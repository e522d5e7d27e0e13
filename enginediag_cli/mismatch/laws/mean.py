"""The mean of what a law may be, where neither its form nor perhaps its variables are settled.

    f̄ = Σ_v P_v Σ_i p_vi f_vi      P_v: probability of variables v among those at one place
                                    p_vi: of a law among those of v

with the coefficients that each has been fitted with, or sought at the fit that carries a law there; one of them is all
smooth curves of their variable, or all sums of one of each of two (`additive`). Laws that are nearly as likely err each
in its own way, and their average less than the likeliest of them. Most forms are approximations, and evidence B tells
approximations apart more surely than they are right, so

    p_vi ∝ √B_vi      P_v ∝ Σ_i B_vi

Where these flights do not tell the likeliest form from the average it is told as it stands: its coefficients say more
to a reader than an average does. Else the average is written with the fewest of its laws that these flights cannot
tell from it, weighed so that they come nearest,

    min_w (Σ_k w_k f_k − f̄)ᵀ H (Σ_k w_k f_k − f̄)      w ≥ 0

one more at a time. In a linear twin of the search (`tests/benchmarks/law_twin.py`) what is told is within noise of the
truth more often than the likeliest law, with B in the place of √B one time in a hundred less, and with the likeliest
variables alone two in a hundred less.

Sources: J. A. Hoeting et al., Statistical Science 14 (1999) 382–417; of powers of the evidence J. W. Miller, D. B.
Dunson, J. Am. Stat. Assoc. 114 (2019) 1113–1125; of non-negative least squares C. L. Lawson, R. J. Hanson, Solving
Least Squares Problems (1974), chapter 23.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.proposed import DIGITS
from enginediag_cli.mismatch.laws.scan import KnownVariable
from enginediag_cli.physics.law import LONGEST

COARSE = 0.5
"""Power of the evidence that is a form's weight. Chosen in the twin, where 0.3 does as well."""
THE_SAME = 0.5
"""Non-centrality below which these flights do not tell the likeliest form from the average. In the twin, with maps that
may err, half of the laws of the grammar's own forms are then told as an average and 55 of 463 laws of known variables
are beyond noise; with 1 in its place a quarter and 59, with 0.3 two thirds and 55."""
NEAR = 0.1
"""Non-centrality at which what is written is the average; what is nearer by less is no nearer."""
LEAST = 1e-3
"""Probability from which a law has a part."""

BESIDE = 4 * DIGITS
"""Letters of a form's weight, its sign and parentheses, about."""


@dataclass(frozen=True)
class Member:
    """What may be: `curve` (N,) over the records, ln evidence."""

    words: tuple[str, ...]
    text: str
    curve: np.ndarray
    evidence: float


@dataclass(frozen=True)
class Along:
    """What a law at a place may be along some variables: `evidence`, ln, of all that, and its members."""

    of: tuple[KnownVariable, ...]
    evidence: float
    members: tuple[Member, ...]


@dataclass(frozen=True)
class Part:
    """A member with its variables, its probability, and the `weight` that it is written with, 0 where it is not."""

    member: Member
    of: tuple[KnownVariable, ...]
    probability: float
    weight: float = 0.0


@dataclass(frozen=True)
class Mean:
    """`curve` (N,) of an average as it is written, and what it is of, likeliest first."""

    of: tuple[Part, ...]
    curve: np.ndarray

    @property
    def written(self) -> tuple[Part, ...]:
        return tuple(x for x in self.of if x.weight)


def mean_of(along: Sequence[Along], alone: np.ndarray | None, says: AnyCurve) -> Mean | None:
    """The average of laws at one place along these variables; `alone` (N,): the likeliest one's curve, none where that
    is a smooth curve and no formula is lost by the average; `says`: what the place says of any curve. None where the
    likeliest is the average as far as it was flown, or no formula that there is room for comes visibly nearer."""
    parts = sorted(_parts(along), key=lambda x: -x.probability)
    if not parts:
        return None
    curves = np.stack([x.member.curve for x in parts], axis=1)
    mean = curves @ [x.probability for x in parts]
    off = np.inf if alone is None else _apart_in_shape(alone, mean, says)
    if off < THE_SAME:
        return None
    weights = _fewest(parts, curves, mean, says)
    curve = curves @ weights
    # the likeliest one alone, weighed, is as far but for rounding
    if not np.std(curve) or _apart_in_shape(curve, mean, says) > off - NEAR:
        return None
    return Mean(tuple(replace(x, weight=float(w)) for x, w in zip(parts, weights, strict=True)), curve)


def _apart_in_shape(f: np.ndarray, g: np.ndarray, says: AnyCurve) -> float:
    """The non-centrality at which a curve could be told from another one of any size: fits find sizes again."""
    ((ff, fg), (_, gg)) = says.grams(np.stack([f, g], axis=1)[:, None, :])[0]
    return float(gg - fg**2 / ff) if ff > 0.0 else float(gg)


def _parts(along: Sequence[Along]) -> Iterator[Part]:
    for share, own in zip(shares([a.evidence for a in along]), along, strict=True):
        for q, member in zip(shares([COARSE * m.evidence for m in own.members]), own.members, strict=True):
            if share * q >= LEAST:
                yield Part(member, own.of, float(share * q))


def _fewest(parts: Sequence[Part], curves: np.ndarray, mean: np.ndarray, says: AnyCurve) -> np.ndarray:
    """Weights (K,) of the fewest of `curves` (N, K) that come near their mean (N,), as far as there is room."""
    G = says.grams(np.column_stack([curves, mean])[:, None, :])[0]
    values, vectors = np.linalg.eigh(G)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # rootᵀ root = G
    seen, target = root[:, :-1], root[:, -1]
    weights, kept, room = np.zeros(len(parts)), list[int](), LONGEST
    while float(np.sum((seen @ weights - target) ** 2)) > NEAR:
        further = [j for j in range(len(parts)) if j not in kept and len(parts[j].member.text) + BESIDE <= room]
        tried = [(own, j) for j in further if (own := _weighed(seen[:, [*kept, j]], target)) is not None]
        if not tried:
            break
        (found, _), j = min(tried, key=lambda t: t[0][1])
        kept, room = [*kept, j], room - len(parts[j].member.text) - BESIDE
        weights[kept] = found
    return weights


def _weighed(A: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Weights w ≥ 0 of the least |Aw − b|, and that; None where its iteration does not end."""
    try:
        w, left = nnls(A, b)
    except RuntimeError:
        return None
    return w, float(left)
