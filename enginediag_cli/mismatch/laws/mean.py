"""The mean of what a law may be, where none of its forms is settled.

    f̄ = Σ_i p_i f_i      p_i: probability of a law among those of the same variables at one place

with the coefficients that each has been fitted with, or sought at the fit that carries a law there; one of them is all
smooth curves of their variable, or all sums of one of each of two (`additive`). Forms that are nearly as likely err
each in its own way, and their average less than the likeliest of them. Most of them are approximations, and evidence B
tells approximations apart more surely than they are right, so

    p_i ∝ √B_i

Where these flights do not tell the likeliest form from the average it is told as it stands: its coefficients say more
to a reader than an average does. In a linear twin of the search (`tests/benchmarks/law_twin.py`) what is told is
within noise of the truth more often than the likeliest law, and with B in the place of √B one time in a hundred less.

Sources: J. A. Hoeting et al., Statistical Science 14 (1999) 382–417; of powers of the evidence J. W. Miller, D. B.
Dunson, J. Am. Stat. Assoc. 114 (2019) 1113–1125.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.proposed import DIGITS
from enginediag_cli.physics.laws.expression import LONGEST

COARSE = 0.5
"""Power of the evidence that is a form's weight. Chosen in the twin, where 0.3 does as well."""
THE_SAME = 0.5
"""Non-centrality below which these flights do not tell the likeliest form from the average. In the twin, with maps that
may err, half of the laws of the grammar's own forms are then told as an average and 55 of 463 laws of known variables
are beyond noise; with 1 in its place a quarter and 59, with 0.3 two thirds and 55."""
LEAST = 0.01
"""Probability from which a form is part of the average."""
MISSED = 0.1
"""Probability of forms for which a formula has no room, up to which the others are still an average of all."""

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
class Mean:
    """`curve` (N,) of an average, of these members with their probabilities, likeliest first."""

    of: tuple[tuple[Member, float], ...]
    curve: np.ndarray


def mean_of(members: Sequence[Member], alone: np.ndarray | None, says: AnyCurve) -> Mean | None:
    """The average of laws of the same variables at one place; `alone` (N,): the likeliest one's curve, none where that
    is a smooth curve and no formula is lost by the average; `says`: what the place says of any curve. None where the
    likeliest is the average as far as it was flown, or a formula has no room for enough of them."""
    p = shares([COARSE * m.evidence for m in members])
    chosen, room = list[tuple[Member, float]](), LONGEST
    for q, m in sorted(zip(p, members, strict=True), key=lambda x: -x[0]):
        own = len(m.text) + BESIDE
        if q >= LEAST and own <= room:
            chosen.append((m, float(q)))
            room -= own
    told = sum(q for _, q in chosen)
    if told < 1.0 - MISSED:
        return None
    curve = np.sum([q * m.curve for m, q in chosen], axis=0) / told
    if not np.std(curve) or (alone is not None and says.apart(alone, curve) < THE_SAME):
        return None
    return Mean(tuple(chosen), curve)
