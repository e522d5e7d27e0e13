"""The mean of what a law may be, where none of its forms is settled.

    f̄ = Σ_i p_i f_i      p_i: probability of a law among those of the same variables at one place

with the coefficients that each has been fitted with, or sought at the fit that carries a law there. Several forms that
are nearly as likely err each in its own way, and their average less than the likeliest of them. Where the likeliest
form has most of what all listed ones have, or these flights do not tell it from the average, it is told as it stands:
its coefficients say more to a reader than an average does. In a linear twin of the search
(`tests/benchmarks/law_twin.py`, 600 laws of two seeds) the average is told of one law in six, and what is told is
within noise of the truth in 498 where the likeliest alone is in 494.

Source: J. A. Hoeting et al., Statistical Science 14 (1999) 382–417.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.any_curve import AnyCurve
from enginediag_cli.mismatch.laws.posterior import shares
from enginediag_cli.mismatch.laws.proposed import DIGITS
from enginediag_cli.physics.laws.expression import LONGEST

SETTLED = 0.7
"""Share of all listed forms from which one is told as it stands. Judgement."""
THE_SAME = 0.5
"""Non-centrality below which these flights do not tell the likeliest form from the average: the form is told."""
LEAST = 0.01
"""Probability from which a form is part of the average."""
MISSED = 0.1
"""Probability of forms for which a formula has no room, up to which the others are still an average of all."""

BESIDE = 4 * DIGITS
"""Letters of a form's weight, its sign and parentheses, about."""


@dataclass(frozen=True)
class Member:
    """What may be: `curve` (N,) over the records, ln evidence, whether it is a single listed form."""

    words: tuple[str, ...]
    text: str
    curve: np.ndarray
    evidence: float
    listed: bool


@dataclass(frozen=True)
class Mean:
    """`curve` (N,) of an average, of these members with their probabilities, likeliest first."""

    of: tuple[tuple[Member, float], ...]
    curve: np.ndarray


def mean_of(members: Sequence[Member], says: AnyCurve) -> Mean | None:
    """The average of laws of the same variables at one place; `says`: what that does of any curve. None where a form is
    settled, or is the average as far as it was flown, or a formula has no room for enough of them."""
    evidence = [m.evidence for m in members]
    best = members[int(np.argmax(evidence))]
    if shares([m.evidence for m in members if m.listed or not best.listed]).max() >= SETTLED:
        return None
    chosen, room = list[tuple[Member, float]](), LONGEST
    for q, m in sorted(zip(shares(evidence), members, strict=True), key=lambda x: -x[0]):
        own = len(m.text) + BESIDE
        if q >= LEAST and own <= room:
            chosen.append((m, float(q)))
            room -= own
    told = sum(q for _, q in chosen)
    if told < 1.0 - MISSED:
        return None
    curve = np.sum([q * m.curve for m, q in chosen], axis=0) / told
    if not np.std(curve) or says.apart(best.curve, curve) < THE_SAME:
        return None
    return Mean(tuple(chosen), curve)
