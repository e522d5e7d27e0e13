"""All sets of parameters at once: β_Sᵀ A_SS⁻¹ β_S and log det A_SS for every S.

Parameter by parameter every set splits into "without" and "with", the latter by one elimination step
(Gauss–Jordan), about six operations per set in total.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np


def all_sets(beta: np.ndarray, A: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks (M, p) of all sets of at most `limit` parameters, quadratic forms (w, M), log determinants (w, M).

    beta (w, p), A (w, p, p) positive definite: w problems over the same parameters.
    """
    w, p = beta.shape
    masks, growing = _plan(p, limit)
    quadratic, log_det = np.zeros((w, 1)), np.zeros((w, 1))
    # what is left of β and A for the undecided parameters, given the decided ones
    c, G = beta[:, None, :], A[:, None, :, :]
    for grow in growing:
        grown_c, grown_G = c[:, grow], G[:, grow]
        pivot = grown_G[:, :, 0, 0]
        gain = grown_c[:, :, 0] / pivot
        column = grown_G[:, :, 1:, 0]
        quadratic = np.concatenate([quadratic, quadratic[:, grow] + grown_c[:, :, 0] * gain], axis=1)
        log_det = np.concatenate([log_det, log_det[:, grow] + np.log(pivot)], axis=1)
        c = np.concatenate([c[:, :, 1:], grown_c[:, :, 1:] - column * gain[:, :, None]], axis=1)
        taken = column[:, :, :, None] * (column / pivot[:, :, None])[:, :, None, :]
        G = np.concatenate([G[:, :, 1:, 1:], grown_G[:, :, 1:, 1:] - taken], axis=1)
    return masks, quadratic, log_det


@lru_cache(maxsize=8)
def _plan(p: int, limit: int) -> tuple[np.ndarray, tuple[np.ndarray | slice, ...]]:
    """Masks of the sets in the order in which they are visited, and per parameter the sets that may grow."""
    masks, size = np.zeros((1, p), bool), np.zeros(1, int)
    growing: list[np.ndarray | slice] = []
    for j in range(p):
        grow = np.flatnonzero(size < limit)
        growing.append(slice(None) if len(grow) == len(size) else grow)
        grown = masks[grow]
        grown[:, j] = True
        masks, size = np.concatenate([masks, grown]), np.concatenate([size, size[grow] + 1])
    masks.flags.writeable = False
    return masks, tuple(growing)
