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
    """Scores b (L, k, p + 1) and information S (L, k, p + 1, p + 1), of parameters of one component each, of every
    course in every mode of one law of scatter. The last parameter is a change of that mode alone by one; effect
    (k, n, p + 1)."""

    wander: Wander
    effect: np.ndarray
    b: np.ndarray
    S: np.ndarray


def table(readings: Readings, wander: Wander, among: Courses, together: np.ndarray) -> Table:
    """together (p, p) bool: pairs of parameters of which the information is needed."""
    effect = np.einsum("amp,mk->kap", readings.J, wander.W)
    effect = np.concatenate([effect, np.ones((*effect.shape[:2], 1))], axis=2)
    L, m, p = len(among.g), len(effect), effect.shape[2]
    pairs = [*zip(*np.nonzero(np.triu(together)), strict=True), (p - 1, p - 1)]
    b, S = np.empty((L, m, p)), np.zeros((L, m, p, p))
    for k in range(m):
        A, inverse = effect[k], wander.inverse[k]
        b[:, k] = along(A * wander.c[k][:, None], among)
        for i, j in pairs:
            if not (A[:, i].any() and A[:, j].any()):
                continue
            both = A[:, i, None] * inverse * A[:, j]
            S[:, k, i, j] = S[:, k, j, i] = _twice(both, among)
    return Table(wander, effect, b, S)


def along(values: np.ndarray, among: Courses) -> np.ndarray:
    """Σ_i g(i) values(i) (L, …) of every course, values (n, …)."""
    found = np.empty((len(among.g), *values.shape[1:]))
    steps = ~among.growing
    found[steps] = np.cumsum(values[::-1], axis=0)[::-1][among.onset[steps]]
    found[~steps] = np.tensordot(among.g[~steps], values, 1)
    return found


def _twice(both: np.ndarray, among: Courses) -> np.ndarray:
    """Σ_ij g(i) both(i, j) g(j) (L,) of every course; both (n, n) symmetric but for the order of two parameters."""
    steps = ~among.growing
    found = np.empty(len(among.g))
    # sum over i, j ≥ τ: what τ adds is its row and its column from τ on
    upper = np.triu(both).sum(axis=1) + np.tril(both).sum(axis=0) - np.diag(both)
    found[steps] = np.cumsum(upper[::-1])[::-1][among.onset[steps]]
    grown = among.g[~steps]
    found[~steps] = np.sum((grown @ both) * grown, axis=1)
    return found
