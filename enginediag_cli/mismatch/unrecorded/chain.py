"""Forward–backward of a two-state Markov chain over all records of many chains at once.

Record k contributes the 2 × 2 matrix of P(s_k = j | s_{k−1} = i) · likelihood of row k given (i, j). Records are cut
into about √N stretches: products of the matrices of each stretch are formed side by side, what enters a stretch is
handed on from one to the next, and then messages run through all stretches side by side: √N batched steps of N in all.

Messages are probabilities, brought to a largest entry of 1 with its logarithm kept. The two entries of a message are
as far apart, in logarithms, as those of the last matrix at most, and those of a product as its first and its last
together, so none comes to nothing where those of every matrix are within FAR_APART; where they are not, the same is
done in logarithms, at twice the cost.

Source: L. R. Rabiner, Proc. IEEE 77 (1989) 257–286, sec. III and V.A (scaling); S. Särkkä and Á. F. García-Fernández,
"Temporal Parallelization of Bayesian Smoothers", IEEE Trans. Autom. Control 66 (2021) 299–306.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

FAR_APART = 300.0
"""Entries of a matrix, in logarithms: those of a product are then above e^−600, where doubles end at e^−708."""


@dataclass(frozen=True)
class Posterior:
    """`log_evidence` (S,): ln of the sum over all state paths; `on` (S, N): P(s_k = 1); `both` (S, N):
    P(s_{k−1} = 1, s_k = 1), 0 for the first record; `changed` (S, N): P(s_{k−1} ≠ s_k)."""

    log_evidence: np.ndarray
    on: np.ndarray
    both: np.ndarray
    changed: np.ndarray


def changing(gap: np.ndarray, probability: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """ln P(s_k = s_{k−1}) and ln P(s_k ≠ s_{k−1}), (S, N), for S probabilities of a change from one record to the next,
    of records so far apart (N,): the chance of having changed after Δ is ½ (1 − (1 − 2p)^Δ), ½ where nothing is known
    of the record before (gap 0)."""
    stay = np.where(gap > 0, (1.0 - 2.0 * probability[:, None]) ** gap, 0.0)
    return np.log(0.5 * (1.0 + stay)), np.log(0.5 * (1.0 - stay))


def transitions(gap: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """The same as matrices ln P(s_k = j | s_{k−1} = i), (S, N, 2, 2)."""
    same, change = changing(gap, probability)
    return np.stack([np.stack([same, change], -1), np.stack([change, same], -1)], -2)


class _Plain:
    """Products and sums of numbers."""

    one, nothing = 1.0, 0.0

    @staticmethod
    def of(logarithms: np.ndarray) -> np.ndarray:
        return np.exp(logarithms)

    @staticmethod
    def sums(a: np.ndarray, x: np.ndarray, b: np.ndarray, y: np.ndarray) -> np.ndarray:
        """a x + b y."""
        return a * x + b * y

    @staticmethod
    def scaled(v: np.ndarray, axes: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """v over its largest along the first axes, and the logarithm of that."""
        top = v.max(axis=axes)
        return v / top, np.log(top)

    @staticmethod
    def shares(v: np.ndarray) -> np.ndarray:
        """Of all along the first two axes."""
        return np.asarray(v / v.sum(axis=(0, 1)))

    @staticmethod
    def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(a * b)


class _Logarithms(_Plain):
    """The same by their logarithms."""

    one, nothing = 0.0, -np.inf

    @staticmethod
    def of(logarithms: np.ndarray) -> np.ndarray:
        return logarithms

    @staticmethod
    def sums(a: np.ndarray, x: np.ndarray, b: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.asarray(np.logaddexp(a + x, b + y))

    @staticmethod
    def scaled(v: np.ndarray, axes: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        top = v.max(axis=axes)
        return v - top, top

    @staticmethod
    def shares(v: np.ndarray) -> np.ndarray:
        w = np.exp(v - v.max(axis=(0, 1)))
        return np.asarray(w / w.sum(axis=(0, 1)))

    @staticmethod
    def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.asarray(a + b)


def forward_backward(steps: np.ndarray) -> Posterior:
    """Of the matrices' logarithms (S, N, 2, 2); the first is taken from state 0, its rows being alike."""
    S, N = steps.shape[:2]
    entries = [steps[:, :, i, j] for i in (0, 1) for j in (0, 1)]
    top, least = reduce(np.maximum, entries), reduce(np.minimum, entries)
    near = float((top - least).max()) <= FAR_APART
    by: type[_Plain] = _Plain if near else _Logarithms
    length = max(1, round((0.5 * N) ** 0.5))
    count = -(-N // length)
    # time within a stretch first: (length, i, j, S, stretches), filled up with matrices that change nothing
    M = np.full((S, count * length, 2, 2), by.nothing)
    M[:, N:, [0, 1], [0, 1]] = by.one
    M[:, :N] = by.of(steps - top[:, :, None, None])
    M = np.ascontiguousarray(M.reshape(S, count, length, 2, 2).transpose(2, 3, 4, 0, 1))
    whole = _products(M, by)
    forward, scale = _forward(M, whole, by)
    backward = _backward(M, whole, by)
    log_evidence = top.sum(axis=1) + scale
    # of each record with the one before it
    before = np.empty_like(forward)
    before[1:], before[0, :, :, 1:] = forward[:-1], forward[-1, :, :, :-1]
    before[0, :, :, 0] = np.array([by.one, by.nothing])[:, None]
    pair = by.shares(np.moveaxis(by.times(by.times(before[:, :, None], M), backward[:, None]), 0, 2))
    # (i, j, length, S, stretches) to (i, j, S, N)
    pair = pair.transpose(0, 1, 3, 4, 2).reshape(2, 2, S, -1)[..., :N]
    on = pair[0, 1] + pair[1, 1]
    both, changed = pair[1, 1].copy(), pair[0, 1] + pair[1, 0]
    both[:, 0] = changed[:, 0] = 0.0
    return Posterior(log_evidence, np.clip(on, 0.0, 1.0), both, changed)


def _products(M: np.ndarray, by: type[_Plain]) -> np.ndarray:
    """Of the matrices of each stretch, (i, j, S, stretches), their largest entry 1."""
    found = M[0]
    for m in M[1:]:
        found = by.scaled(by.sums(found[:, 0, None], m[0], found[:, 1, None], m[1]), (0, 1))[0]
    return found


def _forward(M: np.ndarray, whole: np.ndarray, by: type[_Plain]) -> tuple[np.ndarray, np.ndarray]:
    """Messages after every record, (length, j, S, stretches), and ln of the last one's sum."""
    v, entering = np.empty(whole.shape[1:]), np.array([[by.one], [by.nothing]])
    for k in range(whole.shape[3]):
        v[:, :, k] = entering
        entering = by.scaled(by.sums(entering[0], whole[0, :, :, k], entering[1], whole[1, :, :, k]), (0,))[0]
    found, scales = np.empty((len(M), *v.shape)), np.zeros(v.shape[1:])
    for k, m in enumerate(M):
        v, scale = by.scaled(by.sums(v[0], m[0], v[1], m[1]), (0,))
        found[k] = v
        scales += scale
    last = by.sums(v[0, :, -1], np.full(1, by.one), v[1, :, -1], np.full(1, by.one))
    return found, scales.sum(axis=1) + by.scaled(last[None], (0,))[1]


def _backward(M: np.ndarray, whole: np.ndarray, by: type[_Plain]) -> np.ndarray:
    """Messages from what follows every record, (length, i, S, stretches)."""
    v, entering = np.empty(whole.shape[1:]), np.full((2, 1), by.one)
    for k in range(whole.shape[3])[::-1]:
        v[:, :, k] = entering
        entering = by.scaled(by.sums(whole[:, 0, :, k], entering[0], whole[:, 1, :, k], entering[1]), (0,))[0]
    found = np.empty((len(M), *v.shape))
    for k in range(len(M))[::-1]:
        found[k] = v
        v = by.scaled(by.sums(M[k, :, 0], v[0], M[k, :, 1], v[1]), (0,))[0]
    return found
