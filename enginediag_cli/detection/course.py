"""What a series says of a change with any course: scores and information of all onsets at once.

In each mode k of `wander` the series is z_k = level + Σ_e g_e(i) A_ki δ_e + scatter, A_ki (p,) the effect of each
parameter. A change with course g has the score b = Σ_i g(i) A_kiᵀ c_k(i) and the information
S = Σ_ij g(i) A_kiᵀ K_k⁻¹(i,j) A_kj g(j); for steps both are cumulative sums from the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.detection.readings import Readings
from enginediag_cli.detection.wander import Wander

STEP, DETERIORATION = "step", "deterioration"
"""At once and for good; growing since its onset."""
ONSETS = 32
"""Onsets of growth that are looked at: it begins slowly, so that its beginning is not told more finely."""
POWERS = (1.0, 2.0, 4.0)
"""Growth with this power of the time since its onset: even, as fouling; ever faster, as wear before a failure."""


@dataclass(frozen=True)
class Courses:
    """L courses: g (L, n) over the epochs, 1 at the last; growing (L,); onset (L,): the first changed epoch, for a
    growing one the last unchanged."""

    g: np.ndarray
    growing: np.ndarray
    onset: np.ndarray

    def laws(self, k: int) -> np.ndarray:
        """Courses (l, n) of the kind and onset of that at k: of growth with every power."""
        return self.g[(self.onset == self.onset[k]) & (self.growing == self.growing[k])]


def courses(clock: np.ndarray, earliest: int = 0) -> Courses:
    """Steps at every epoch after the first `earliest`, and growths over two epochs at least, for one over a single
    epoch would be a step."""
    n = len(clock)
    earliest = min(earliest, n - 1)
    at = np.arange(max(earliest, 1), n)
    steps = (np.arange(n) >= at[:, None]).astype(float)
    last = np.zeros(0, int)
    if n > earliest + 2:
        last = np.unique(np.linspace(max(earliest - 1, 0), n - 3, ONSETS).round().astype(int))
    even = np.clip((clock - clock[last][:, None]) / (clock[-1] - clock[last])[:, None], 0.0, None)
    grown = [even**power for power in POWERS]
    growing = np.repeat([False, True], [len(steps), len(POWERS) * len(last)])
    return Courses(np.concatenate([steps, *grown]), growing, np.concatenate([at, *[last] * len(POWERS)]))


@dataclass(frozen=True)
class Table:
    """Scores b (L, k, p + 1) and information S (L, k, P), of those pairs of parameters that `at` (p + 1, p + 1) has a
    place for, of every course in every mode of one law of scatter. The last parameter is a change of that mode alone by
    one; effect (k, n, p + 1)."""

    wander: Wander
    effect: np.ndarray
    b: np.ndarray
    S: np.ndarray
    at: np.ndarray

    @property
    def pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """First and second parameter (P,) of each pair."""
        return pairs_of(self.at)


def pairs_of(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First and second parameter (P,) of each pair, in their order."""
    i, j = np.nonzero(np.triu(at >= 0))
    order = np.argsort(at[i, j])
    return i[order], j[order]


def places(together: np.ndarray) -> np.ndarray:
    """Place (p + 1, p + 1) of every pair of parameters that is needed, and of a change of a mode alone; −1 for the
    others. together (p, p) bool."""
    p = len(together)
    at = np.full((p + 1, p + 1), -1)
    i, j = np.nonzero(np.triu(together))
    i, j = np.append(i, p), np.append(j, p)
    at[i, j] = at[j, i] = np.arange(len(i))
    return at


def table(readings: Readings, wander: Wander, among: Courses, at: np.ndarray) -> Table:
    """at: places of the pairs of parameters of which the information is needed."""
    effect = np.einsum("amp,mk->kap", readings.J, wander.W)
    effect = np.concatenate([effect, np.ones((*effect.shape[:2], 1))], axis=2)
    first, second = pairs_of(at)
    L, m, n = len(among.g), len(effect), effect.shape[1]
    b, S = np.empty((L, m, effect.shape[2])), np.zeros((L, m, len(first)))
    steps = ~among.growing
    onset, grown = among.onset[steps], among.g[~steps]
    one, of = np.triu(np.ones((n, n))), np.arange(len(first))
    for k in range(m):
        A, inverse = effect[k], wander.inverse[k]
        b[:, k] = along(A * wander.c[k][:, None], among)
        told = of[A[:, first].any(axis=0) & A[:, second].any(axis=0)]
        i, j = first[told], second[told]
        # sum over i, j ≥ τ of one parameter with another: what τ adds is its row and its column from τ on
        later = inverse * one
        row, column = later @ A, later @ A - np.diag(inverse)[:, None] * A
        upper = A[:, i] * row[:, j] + A[:, j] * column[:, i]
        of_steps = np.cumsum(upper[::-1], axis=0)[::-1][onset]
        S[np.flatnonzero(steps)[:, None], k, told] = of_steps
        if len(grown):
            moved = grown[:, :, None] * A  # (l, n, p)
            held = np.matmul(inverse, moved)
            both = np.einsum("lnq,lnq->lq", moved[:, :, i], held[:, :, j])
            S[np.flatnonzero(~steps)[:, None], k, told] = both
    return Table(wander, effect, b, S, at)


def along(values: np.ndarray, among: Courses) -> np.ndarray:
    """Σ_i g(i) values(i) (L, …) of every course, values (n, …)."""
    found = np.empty((len(among.g), *values.shape[1:]))
    steps = ~among.growing
    found[steps] = np.cumsum(values[::-1], axis=0)[::-1][among.onset[steps]]
    found[~steps] = np.tensordot(among.g[~steps], values, 1)
    return found
