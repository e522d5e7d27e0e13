"""Two states that no column records: when the effect was on, and how large it then is.

    e = A x + a C s + noise      x nuisance, N(0, 1)      s_k in {0, 1}, a Markov chain      a ~ N(0, σ_a²)

Nuisance and states are taken as independent given the data and found in turn (mean field): with the states' means ŝ
and the part V of E[(Cs)²] that is theirs,

    a = g·ŝ/(ŝᵀGŝ + V + σ_a⁻²)         Qᵀ(e − aCŝ) is what the nuisance explains; forward–backward on what is left

Each round raises a lower bound of the marginal likelihood, which against "no such effect" is

    LR = ln Σ_s P(s) exp{a g_s − ½ a² |Cs|²} − ½ a² |Bŝ|² − ½ ln(1 + σ_a² (ŝᵀGŝ + V)) − ½ a²/σ_a²

Source: M. J. Beal, "Variational Algorithms for Approximate Bayesian Inference", thesis, University College London
(2003), ch. 3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.mismatch.unrecorded.chain import Posterior, forward_backward, transitions
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction, joined

CHANGES = np.array([0.25, 0.1, 0.04, 0.015, 0.005])
"""Probabilities of a change from one record to the next that are tried."""

ROUNDS, SETTLED = 60, 1e-3
"""Rounds of amplitude and states (expectation–maximisation) at most, and the change of any state's probability that
ends them."""

AT_ONCE = 160_000
"""Records times chains that go through their rounds together: 20 MB, and √N batched steps are still worth it."""


@dataclass(frozen=True)
class States:
    """`on` (N,): probability of the on state; `changed` (N,): that it differs from the record before; `amplitude` of
    on against off; `doubt`: V, what the states' uncertainty adds to the amplitude's normal equation; `evidence`: LR
    above, averaged over CHANGES; `settled`: the rounds had converged."""

    on: np.ndarray
    changed: np.ndarray
    amplitude: float
    doubt: float
    evidence: float
    settled: bool


@dataclass(frozen=True)
class Bounds:
    """Of the amplitude on minus off, and its prior standard deviation."""

    lower: float
    upper: float
    sigma: float


def two_states(of: Basis, along: Direction, bounds: Bounds, starts: np.ndarray) -> States:
    """The states of the highest likelihood over CHANGES from each of the starts (s, N), 0 to 1."""
    rows = _Rows(of, along, bounds)
    p = np.repeat(CHANGES, len(starts))
    on = np.tile(starts, (len(CHANGES), 1)).astype(float)
    size = max(1, AT_ONCE // len(of.gap))
    parts = [_settled(rows, p[k : k + size], on[k : k + size]) for k in range(0, len(p), size)]
    # of each probability of a change the best start counts
    value = np.concatenate([part.value for part in parts])
    top = value.reshape(len(CHANGES), -1).max(axis=1)
    evidence = float(top.max() + np.log(np.exp(top - top.max()).mean()))
    k = int(np.argmax(value))
    part, k = parts[k // size], k % size
    on, both = part.chain.on[k], part.chain.both[k]
    doubt = float(_full_square(along, on[None], both[None])[0] - (along.applied(on) ** 2).sum())
    return States(on, part.chain.changed[k], float(part.a[k]), max(doubt, 0.0), evidence, bool(part.settled[k]))


class _Rows:
    """What the readings say of the states, whatever they are."""

    def __init__(self, of: Basis, along: Direction, bounds: Bounds):
        self.of, self.along, self.bounds = of, along, bounds
        self.own = np.einsum("nm,nm->n", along.own, of.e)
        self.before = np.einsum("nm,nm->n", along.before, of.e)
        self.lengths = [
            np.einsum("nm,nm->n", x, y)
            for x, y in ((along.own, along.own), (along.before, along.before), (along.own, along.before))
        ]
        self.g = along.gathered(of.left)
        self.own_rows, self.before_rows = along.own_rows, along.before_rows
        self.B = joined(self.own_rows, self.before_rows)

    def amplitude(self, on: np.ndarray, both: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the likeliest effect at given states (S, N), (S,), and what the nuisance explains of it, (S, q)."""
        Bs = on @ self.B
        full = _full_square(self.along, on, both) + 1.0 / self.bounds.sigma**2
        a = (on @ self.g) / (full - (Bs**2).sum(axis=1))
        return np.clip(a, self.bounds.lower, self.bounds.upper), Bs

    def emission(self, a: np.ndarray, Bs: np.ndarray) -> np.ndarray:
        """ln likelihood of the rows without the nuisance's share, (S, N, 2, 2)."""
        w = self.of.pull - a[:, None] * Bs
        own = self.own - w @ self.own_rows.T
        return _emission(a[:, None], own, self.before - w @ self.before_rows.T, self.lengths)

    def value(self, chain: Posterior, a: np.ndarray, Bs: np.ndarray) -> np.ndarray:
        """LR above, (S,)."""
        spread = _full_square(self.along, chain.on, chain.both) - ((chain.on @ self.B) ** 2).sum(axis=1)
        sigma = self.bounds.sigma
        return np.asarray(
            chain.log_evidence
            - 0.5 * a**2 * (Bs**2).sum(axis=1)
            - 0.5 * (a / sigma) ** 2
            - 0.5 * np.log1p(sigma**2 * np.maximum(spread, 0.0))
        )


@dataclass(frozen=True)
class _Found:
    """Of S chains where their rounds ended, and whether they had settled."""

    chain: Posterior
    a: np.ndarray
    value: np.ndarray
    settled: np.ndarray


def _settled(rows: _Rows, p: np.ndarray, on: np.ndarray) -> _Found:
    """Rounds of amplitude and states from the starts (S, N), of every chain until it settles."""
    S = len(p)
    found = _Found(
        Posterior(np.zeros(S), on.copy(), _pairs(on), np.zeros_like(on)),
        np.zeros(S),
        np.full(S, -np.inf),
        np.zeros(S, bool),
    )
    steps, left = transitions(rows.of.gap, p), np.arange(S)
    for _ in range(ROUNDS):
        last = found.chain.on[left]
        a, Bs = rows.amplitude(last, found.chain.both[left])
        chain = forward_backward(steps + rows.emission(a, Bs))
        found.a[left], found.value[left] = a, rows.value(chain, a, Bs)
        for kept, new in zip(vars(found.chain).values(), vars(chain).values(), strict=True):
            kept[left] = new
        moves = np.abs(chain.on - last).max(axis=1) >= SETTLED
        found.settled[left] = ~moves
        left, steps = left[moves], steps[moves]
        if not left.size:
            break
    return found


def standard_error(of: Basis, along: Direction, bounds: Bounds, states: States, given: float) -> float:
    """Of the amplitude, states unknown: from the curvature of the likelihood over steps of `given`, the standard
    error at given states, which it is never below."""
    at = states.amplitude + given * np.array([-1.0, 0.0, 1.0])
    value = [two_states(of, along, replace(bounds, lower=a, upper=a), states.on[None]).evidence for a in at]
    curvature = -(value[0] - 2.0 * value[1] + value[2]) / given**2
    return max(given, float(curvature**-0.5) if curvature > 0 else np.inf)


def _full_square(along: Direction, on: np.ndarray, both: np.ndarray) -> np.ndarray:
    """E|Cs|² (S,)."""
    return np.asarray(on @ along.diagonal + 2.0 * both[:, 1:] @ along.beside)


def _pairs(on: np.ndarray) -> np.ndarray:
    """P(s_{k−1} = 1, s_k = 1) as if records were independent."""
    both = np.zeros_like(on)
    both[:, 1:] = on[:, 1:] * on[:, :-1]
    return both


def _emission(a: np.ndarray, own: np.ndarray, before: np.ndarray, lengths: list[np.ndarray]) -> np.ndarray:
    """ln likelihood of each row (S, N, 2, 2) given the states (before, now), against both off."""
    now = a * own - 0.5 * a**2 * lengths[0]
    past = a * before - 0.5 * a**2 * lengths[1]
    both = now + past - a**2 * lengths[2]
    return np.stack([np.stack([np.zeros_like(now), now], -1), np.stack([past, both], -1)], -2)


def first_guesses(amplitude: np.ndarray, both_ways: bool) -> np.ndarray:
    """Starts (s, N) from the amplitude (N,): above its median, and above the best division into two (Otsu); with the
    states' names exchanged as well where the sign of the effect is not known."""
    order = np.sort(amplitude)
    n = np.arange(1, len(order))
    low, high = np.cumsum(order)[:-1] / n, (order.sum() - np.cumsum(order)[:-1]) / (len(order) - n)
    k = int(np.argmax(n * (len(order) - n) * (high - low) ** 2))
    cuts = (float(np.median(amplitude)), 0.5 * float(order[k] + order[k + 1]))
    starts = np.array([amplitude > c for c in cuts], float)
    return np.concatenate([starts, 1.0 - starts]) if both_ways else starts
