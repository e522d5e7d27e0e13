"""All sets of parameters at once: β_Sᵀ A_SS⁻¹ β_S and log det A_SS for every S.

Parameter by parameter every set splits into "without" and "with", the latter by one elimination step
(Gauss–Jordan), about six operations per set in total.
"""

from __future__ import annotations

from functools import lru_cache
from math import comb

import numpy as np


def all_sets(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray | None = None, most: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks (M, p) of all sets of at most `limit` parameters, quadratic forms (w, M), log determinants (w, M).

    beta (w, p), A (w, p, p) positive definite: w problems over the same parameters. few (p,) bool: of these
    parameters no set has more than `most`.
    """
    w, p = beta.shape
    masks, growing = plan(p, limit, () if few is None else tuple(few.tolist()), most)
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


def number_of_sets(p: int, limit: int, few: int = 0, most: int = 0) -> int:
    """How many sets of at most `limit` of p parameters there are, with no more than `most` out of `few` of them."""
    return sum(
        comb(few, j) * sum(comb(p - few, i) for i in range(max(limit - j, -1) + 1)) for j in range(min(most, few) + 1)
    )


@lru_cache(maxsize=8)
def plan(
    p: int, limit: int, few: tuple[bool, ...] = (), most: int = 0
) -> tuple[np.ndarray, tuple[np.ndarray | slice, ...]]:
    """Masks of the sets in the order in which they are visited, and per parameter the sets that may grow."""
    masks, size, held = np.zeros((1, p), bool), np.zeros(1, int), np.zeros(1, int)
    rare = few or (False,) * p
    growing: list[np.ndarray | slice] = []
    for j in range(p):
        grow = np.flatnonzero((size < limit) & ((held < most) | (not rare[j])))
        growing.append(slice(None) if len(grow) == len(size) else grow)
        grown = masks[grow]
        grown[:, j] = True
        masks, size = np.concatenate([masks, grown]), np.concatenate([size, size[grow] + 1])
        held = np.concatenate([held, held[grow] + rare[j]])
    masks.flags.writeable = False
    return masks, tuple(growing)
