"""Forward–backward of a two-state Markov chain, in logarithms, over all records at once.

Record k contributes the 2 × 2 matrix of ln[P(s_k = j | s_{k−1} = i) · likelihood of row k given (i, j)]. Products of
these matrices from the first record on, and up to the last, are formed by doubling: log₂ N batched steps.

Source: L. R. Rabiner, Proc. IEEE 77 (1989) 257–286, sec. III; S. Särkkä and Á. F. García-Fernández, "Temporal
Parallelization of Bayesian Smoothers", IEEE Trans. Autom. Control 66 (2021) 299–306.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Posterior:
    """`log_evidence` (S,): ln of the sum over all state paths; `on` (S, N): P(s_k = 1); `both` (S, N):
    P(s_{k−1} = 1, s_k = 1), 0 for the first record; `changed` (S, N): P(s_{k−1} ≠ s_k)."""

    log_evidence: np.ndarray
    on: np.ndarray
    both: np.ndarray
    changed: np.ndarray


def transitions(gap: np.ndarray, probability: np.ndarray) -> np.ndarray:
    """ln P(s_k = j | s_{k−1} = i), (S, N, 2, 2), for S probabilities of a change from one record to the next, of
    records so far apart (N,): the chance of having changed after Δ is ½ (1 − (1 − 2p)^Δ), ½ where nothing is known
    of the record before (gap 0)."""
    stay = np.where(gap > 0, (1.0 - 2.0 * probability[:, None]) ** gap, 0.0)
    change = np.log(0.5 * (1.0 - stay))
    same = np.log(0.5 * (1.0 + stay))
    return np.stack([np.stack([same, change], -1), np.stack([change, same], -1)], -2)


def forward_backward(steps: np.ndarray) -> Posterior:
    """Of matrices (S, N, 2, 2); the first is taken from state 0, its rows being alike."""
    forward = _products(steps)[:, :, 0, :]
    backward = np.zeros_like(forward)
    if steps.shape[1] > 1:
        # transposed and reversed, products from the front are products up to the end
        turned = _products(np.swapaxes(steps[:, :0:-1], 2, 3))[:, ::-1]
        backward[:, :-1] = np.logaddexp(turned[:, :, 0, :], turned[:, :, 1, :])
    log_evidence = np.logaddexp(forward[:, -1, 0], forward[:, -1, 1])
    on = np.exp(forward[:, :, 1] + backward[:, :, 1] - log_evidence[:, None])
    both, changed = np.zeros_like(on), np.zeros_like(on)
    pair = forward[:, :-1, :, None] + steps[:, 1:] + backward[:, 1:, None, :] - log_evidence[:, None, None, None]
    both[:, 1:] = np.exp(pair[:, :, 1, 1])
    changed[:, 1:] = np.exp(pair[:, :, 0, 1]) + np.exp(pair[:, :, 1, 0])
    return Posterior(log_evidence, np.clip(on, 0.0, 1.0), both, changed)


def _products(steps: np.ndarray) -> np.ndarray:
    """Products of the matrices from the first to each, (S, N, 2, 2)."""
    found, reach = steps.copy(), 1
    while reach < steps.shape[1]:
        found[:, reach:] = _times(found[:, :-reach], found[:, reach:])
        reach *= 2
    return found


def _times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Matrix product in logarithms."""
    return np.asarray(np.logaddexp(a[..., :, 0, None] + b[..., None, 0, :], a[..., :, 1, None] + b[..., None, 1, :]))
