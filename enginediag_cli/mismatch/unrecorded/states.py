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
from enginediag_cli.mismatch.unrecorded.whitened_rows import Basis, Direction

CHANGES = np.array([0.25, 0.1, 0.04, 0.015, 0.005])
"""Probabilities of a change from one record to the next that are tried."""

ROUNDS, SETTLED = 60, 1e-3
"""Rounds of amplitude and states (expectation–maximisation) at most, and the change of any state's probability that
ends them."""


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
    p = np.repeat(CHANGES, len(starts))
    on = np.tile(starts, (len(CHANGES), 1)).astype(float)
    steps = transitions(of.gap, p)
    own = np.einsum("nm,nm->n", along.own, of.e)
    before = np.einsum("nm,nm->n", along.before, of.e)
    lengths = [
        np.einsum("nm,nm->n", x, y)
        for x, y in ((along.own, along.own), (along.before, along.before), (along.own, along.before))
    ]
    g, B = along.gathered(of.left), along.B
    chain = Posterior(np.zeros(len(p)), on, _pairs(on), np.zeros_like(on))
    value, last, settled = np.full(len(p), -np.inf), chain.on, False
    a = np.zeros(len(p))
    for _ in range(ROUNDS):
        Bs = chain.on @ B
        full = _full_square(along, chain) + 1.0 / bounds.sigma**2
        a = np.clip((chain.on @ g) / (full - (Bs**2).sum(axis=1)), bounds.lower, bounds.upper)
        w = of.pull - a[:, None] * Bs
        # a g: what rows without the nuisance's share say of each pair of states
        r_own, r_before = own - w @ along.own_rows.T, before - w @ along.before_rows.T
        emission = _emission(a[:, None], r_own, r_before, lengths)
        chain = forward_backward(steps + emission)
        spread = _full_square(along, chain) - ((chain.on @ B) ** 2).sum(axis=1)
        value = (
            chain.log_evidence
            - 0.5 * a**2 * (Bs**2).sum(axis=1)
            - 0.5 * (a / bounds.sigma) ** 2
            - 0.5 * np.log1p(bounds.sigma**2 * np.maximum(spread, 0.0))
        )
        settled = bool(np.abs(chain.on - last).max() < SETTLED)
        if settled:
            break
        last = chain.on
    # of each probability of a change the best start counts
    table = value.reshape(len(CHANGES), -1)
    k = int(np.argmax(value))
    top = table.max(axis=1)
    evidence = float(top.max() + np.log(np.exp(top - top.max()).mean()))
    doubt = float(_full_square(along, chain)[k] - (along.applied(chain.on[k]) ** 2).sum())
    return States(chain.on[k], chain.changed[k], float(a[k]), max(doubt, 0.0), evidence, settled)


def standard_error(of: Basis, along: Direction, bounds: Bounds, states: States, given: float) -> float:
    """Of the amplitude, states unknown: from the curvature of the likelihood over steps of `given`, the standard
    error at given states, which it is never below."""
    at = states.amplitude + given * np.array([-1.0, 0.0, 1.0])
    value = [two_states(of, along, replace(bounds, lower=a, upper=a), states.on[None]).evidence for a in at]
    curvature = -(value[0] - 2.0 * value[1] + value[2]) / given**2
    return max(given, float(curvature**-0.5) if curvature > 0 else np.inf)


def _full_square(along: Direction, chain: Posterior) -> np.ndarray:
    """E|Cs|² (S,)."""
    return np.asarray(chain.on @ along.diagonal + 2.0 * chain.both[:, 1:] @ along.beside)


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
