"""States of whole stretches, judged with the nuisance free to follow.

Mean field holds the nuisance at what the states of the round before have made of it, and so each state confirms
itself: a stretch of a few records at a power that no other record has is on because the maps were fitted with it on.
Here the states of a whole piece, records of one state without a pause between them, are exchanged, nuisance and
amplitude following to the optimum of each account, both of which the linear model gives in closed form:

    ln P(e, s) = ½ (gᵀs)²/(sᵀGs + σ_a⁻²) − ½ ln σ_a²(sᵀGs + σ_a⁻²) + ln P(s)

Of two accounts that differ by less than TIED the one with fewer changes stands, and the other is told as a doubt.

What an exchange of the records a to before b gains follows from sums over them and from the pairs at their ends: with
s' = 1 − s there, and T tridiagonal,

    s'ᵀTs' − sᵀTs = Σ (1 − 2s) diag T + 2 Σ ((1 − s)(1 − s₊) − s s₊) beside T + the pairs (a − 1, a) and (b − 1, b)

so all pieces are compared by running sums; the best of them is then weighed by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from enginediag_cli.mismatch.unrecorded.chain import changing
from enginediag_cli.mismatch.unrecorded.states import CHANGES, Bounds, States
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction

TIED = 3.0
"""ln 20: the wrong one of two accounts leads by so much once in twenty times."""
PAUSE = 3.0
"""Usual steps from which records are of different pieces. Judgement: something else may have been done in between."""
EVEN = 0.499
"""Probability of the account that does not stand, at most."""
FARTHEST = 700.0
"""ln odds whose exponential is still a number."""
ROUNDS = 30
"""Exchanges at most; each raises the evidence or takes a change away."""
ROUNDING = 1e-6
"""Gains, in ln probability, that differ by less may be one gain that was summed in another order."""


@dataclass(frozen=True)
class Account:
    """Evidence of states as above and the amplitude that goes with them, clipped to its bounds; B (N, q) and g (N,):
    the nuisance along the place, and what is left gathered there, of all states the same; `unchanged` (S,): ln P(s) of
    states that never change, `more` (S, N): what a change before a record adds."""

    of: Basis
    along: Direction
    bounds: Bounds
    B: np.ndarray
    g: np.ndarray
    unchanged: np.ndarray = field(init=False)
    more: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        same, change = changing(self.of.gap, CHANGES)
        object.__setattr__(self, "unchanged", same.sum(axis=1))
        object.__setattr__(self, "more", change - same)

    def __call__(self, on: np.ndarray) -> float:
        """ln P(e, s) against no effect, of states (N,) 0 or 1, at the rate of change that suits them best."""
        if not on.any():
            return -np.inf
        Cs = self.along.applied(on)
        inner = float((Cs**2).sum() - ((on @ self.B) ** 2).sum())
        full, g = inner + self.bounds.sigma**-2, float(self.g @ on)
        a = float(np.clip(g / full, self.bounds.lower, self.bounds.upper))
        fits = a * g - 0.5 * a**2 * full - 0.5 * np.log(self.bounds.sigma**2 * full)
        return float(fits + self._prior(on))

    def exchanged(self, on: np.ndarray, pieces: Sequence[slice]) -> np.ndarray:
        """The same (P,) of each exchange of a piece, but for rounding."""
        ends = np.array([(p.start, p.stop) for p in pieces])
        a, b, N = ends[:, 0], ends[:, 1], len(on)
        turned, d = 1.0 - on, 1.0 - 2.0 * on

        def over(terms: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
            """Sums (P, …) of terms (n, …) from first to before last."""
            sums = np.concatenate([np.zeros((1, *terms.shape[1:])), np.cumsum(terms, axis=0)])
            return np.asarray(sums[np.maximum(first, last)] - sums[first])

        inside = over(self.along.beside * (turned[:-1] * turned[1:] - on[:-1] * on[1:]), a, b - 1)
        ends_of = _Ends(a, b, N)
        edges = ends_of.sum(self.along.beside * d[1:] * on[:-1], self.along.beside * d[:-1] * on[1:])
        square = over(self.along.diagonal * d, a, b) + 2.0 * (inside + edges)
        Bs = on @ self.B + over(self.B * d[:, None], a, b)
        Cs = float((self.along.applied(on) ** 2).sum())
        full = Cs + square - (Bs**2).sum(axis=1) + self.bounds.sigma**-2
        g = float(self.g @ on) + over(self.g * d, a, b)
        size = np.clip(g / full, self.bounds.lower, self.bounds.upper)
        fits = size * g - 0.5 * size**2 * full - 0.5 * np.log(self.bounds.sigma**2 * full)
        # within a piece what was a change is one still; at its ends it is none any more, and the other way round
        changed = np.diff(on) != 0.0
        turn = np.where(changed, -1.0, 1.0) * self.more[:, 1:]  # (S, N − 1)
        prior = (self.unchanged + self.more[:, 1:][:, changed].sum(axis=1))[:, None] + ends_of.sum(turn, turn)
        empty = over(on, a, b) - over(turned, a, b) == on.sum()
        return np.where(empty, -np.inf, fits + prior.max(axis=0))

    def _prior(self, on: np.ndarray) -> float:
        """ln P(s), largest over CHANGES."""
        # of the record before the first nothing is known: a change there adds nothing
        changed = np.flatnonzero(np.diff(on)) + 1
        return float((self.unchanged + self.more[:, changed].sum(axis=1)).max())


def judged(of: Basis, along: Direction, bounds: Bounds, states: States) -> States:
    """The states with each piece as the likelier of its accounts, and its probability from the two; `states` as they
    are where they are told from the first."""
    account = Account(of, along, bounds, along.B, along.gathered(of.left))
    on = (states.on > 0.5).astype(float)
    best, first = account(on), _pieces(on, of.gap)
    for _ in range(ROUNDS):
        pieces = [*_pieces(on, of.gap), *first]
        gains, needed = account.exchanged(on, pieces) - best, TIED * np.sign(_more_changes(on, pieces, of.gap))
        # a change more must be told from none, a change less need not
        near = gains > needed - ROUNDING
        near &= gains > gains[gains > needed + ROUNDING].max(initial=-np.inf) - ROUNDING
        weighed = [(account(_exchanged(on, pieces[k])) - best, k) for k in np.flatnonzero(near)]
        better = [(gain, k) for gain, k in weighed if gain > needed[k]]
        if not better:
            break
        gain, k = max(better, key=lambda f: f[0])
        on = _exchanged(on, pieces[k])
        best += gain
    doubt = on.copy()
    # a piece that has joined another may still be doubted by itself
    for piece in (*_pieces(on, of.gap), *(p for p in first if np.ptp(on[p]) == 0.0)):
        odds = account(_exchanged(on, piece)) - best
        # what stands by having fewer changes may be the less likely one by a little: as good as even
        other = min(1.0 / (1.0 + np.exp(min(-odds, FARTHEST))), EVEN)
        doubt[piece] = 1.0 - other if on[piece.start] else other
    changed = np.concatenate([[0.0], np.abs(np.diff(doubt))])
    return replace(states, on=doubt, changed=np.where(of.gap > 0, changed, 0.0))


@dataclass(frozen=True)
class _Ends:
    """Of pieces from a to before b (P,) of N records."""

    a: np.ndarray
    b: np.ndarray
    N: int

    def sum(self, first: np.ndarray, last: np.ndarray) -> np.ndarray:
        """(…, P): of what pairs of neighbours say, (…, N − 1) by the first of the two: `first` at the pair into a
        piece, `last` at the one out of it; none at the first and the last record."""
        into = np.where(self.a > 0, first[..., self.a - 1], 0.0)
        return np.asarray(into + np.where(self.b < self.N, last[..., np.minimum(self.b, self.N - 1) - 1], 0.0))


def _pieces(on: np.ndarray, gap: np.ndarray) -> list[slice]:
    """Runs of one state without a pause, of one flight each, and runs of one state with their pauses."""
    changes = (np.diff(on) != 0) | (gap[1:] == 0)
    found: dict[tuple[int, int], None] = {}
    for ends in (changes, changes | (gap[1:] > PAUSE)):
        edges = [0, *(np.flatnonzero(ends) + 1), len(on)]
        found |= {(int(a), int(b)): None for a, b in pairwise(edges)}
    return [slice(a, b) for a, b in found]


def _exchanged(on: np.ndarray, piece: slice) -> np.ndarray:
    other = on.copy()
    other[piece] = 1.0 - other[piece]
    return other


def _more_changes(on: np.ndarray, pieces: Sequence[slice], gap: np.ndarray) -> np.ndarray:
    """(P,): how many more changes within flights there are when a piece is exchanged."""
    turn = np.where(np.diff(on) != 0.0, -1, 1) * (gap[1:] > 0)
    ends = np.array([(p.start, p.stop) for p in pieces])
    return _Ends(ends[:, 0], ends[:, 1], len(on)).sum(turn, turn)
