"""All sets of parameters at once: β_Sᵀ A_SS⁻¹ β_S and log det A_SS for every S.

Parameter by parameter every set splits into "without" and "with", the latter by one elimination step
(Gauss–Jordan), about six operations per set in total. Parameters of which a set has two at most, as those of
instruments, come last, and in closed form: with c, G what is left of β and A given the others, adding i and j gains

    c_i²/G_ii + (c_j − c_i G_ij/G_ii)²/π_j  and  log G_ii + log π_j,     π_j = G_jj − G_ij²/G_ii
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np

PAIRS = 2
"""Of rare parameters, as many at once have a closed form here."""


def all_sets(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray | None = None, most: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks (M, p) of all sets of at most `limit` parameters, quadratic forms (w, M), log determinants (w, M).

    beta (w, p), A (w, p, p) positive definite: w problems over the same parameters. few (p,) bool: of these
    parameters no set has more than `most`.
    """
    p = beta.shape[1]
    rare = np.zeros(p, bool) if few is None else np.asarray(few, bool)
    if rare.any() and most <= PAIRS:
        return _with_pairs(beta, A, limit, rare, most)
    masks, growing = plan(p, limit, tuple(rare.tolist()), most)
    return masks, *_eliminated(beta, A, growing)[:2]


def _eliminated(
    beta: np.ndarray, A: np.ndarray, growing: tuple[np.ndarray | slice, ...]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray]]:
    """Quadratic forms and log determinants (w, M) of the sets that grow by the first parameters in turn, and what is
    then left of β (w, r, M) and of A for the r others: of each, row by row, its own entry and those to the right.

    The sets lie along the last axis, so that every operation runs over them without a stride.
    """
    w, p = beta.shape
    quadratic, log_det = np.zeros((w, 1)), np.zeros((w, 1))
    # what is left of β and A for the undecided parameters, given the decided ones
    c, rows = beta[:, :, None], [A[:, i, i:, None] for i in range(p)]
    for grow in growing:
        first = rows[0][:, :, grow]
        pivot, column = first[:, :1], first[:, 1:]
        gain, share = c[:, :1, grow] / pivot, column / pivot
        quadratic = np.concatenate([quadratic, quadratic[:, grow] + (c[:, :1, grow] * gain)[:, 0]], axis=1)
        log_det = np.concatenate([log_det, log_det[:, grow] + np.log(pivot[:, 0])], axis=1)
        c = np.concatenate([c[:, 1:], c[:, 1:, grow] - column * gain], axis=2)
        rows = [
            np.concatenate([row, row[:, :, grow] - share[:, i : i + 1] * column[:, i:]], axis=2)
            for i, row in enumerate(rows[1:])
        ]
    return quadratic, log_det, c, rows


def _with_pairs(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`all_sets` with none, one or two of the `few` parameters (p,)."""
    order = np.argsort(few, kind="stable")
    n, r = int(np.sum(~few)), int(np.sum(few))
    sets = pair_plan(tuple(few.tolist()), limit, most)
    quadratic, log_det, c, G = _eliminated(beta[:, order], A[:, order][:, :, order], plan(n, limit)[1])
    found = np.empty((2, len(beta), len(sets.masks)))
    filled = 0

    def fill(quadratics: np.ndarray, log_dets: np.ndarray) -> None:
        nonlocal filled
        k = int(np.prod(quadratics.shape[1:]))
        for whole, part in zip(found, (quadratics, log_dets), strict=True):
            whole[:, filled : filled + k] = part.reshape(len(beta), k)
        filled += k

    fill(quadratic, log_det)
    at: np.ndarray | slice = slice(None)
    for size, rows in ((1, sets.with_one), (2, sets.with_two)):
        if most < size or not r:
            break
        if len(rows) < len(sets.alone):
            at = rows
        gain = [c[:, i, at] ** 2 / G[i][:, 0, at] for i in range(r)]
        if size == 1:
            fill(
                np.stack([quadratic[:, at] + gain[i] for i in range(r)], axis=1),
                np.stack([log_det[:, at] + np.log(G[i][:, 0, at]) for i in range(r)], axis=1),
            )
            continue
        for i in range(r - 1):
            own, common = G[i][:, :1, at], G[i][:, 1:, at]
            across = common / own
            pivot = np.stack([G[j][:, 0, at] for j in range(i + 1, r)], axis=1)
            pivot -= across * common
            left = c[:, i + 1 :, at] - c[:, i : i + 1, at] * across
            left *= left
            left /= pivot
            left += (quadratic[:, at] + gain[i])[:, None]
            pivot *= own  # one logarithm for both
            fill(left, np.log(pivot, out=pivot) + log_det[:, None, at])
    return sets.masks, found[0], found[1]


@dataclass(frozen=True)
class PairPlan:
    """Sets of at most two of the rare parameters: `masks` (M, p), none of the rare, each of them, each pair in turn; of
    the sets of the others, which stand `alone`, get one and get two of the rare beside them."""

    masks: np.ndarray
    alone: np.ndarray
    with_one: np.ndarray
    with_two: np.ndarray


@lru_cache(maxsize=8)
def pair_plan(few: tuple[bool, ...], limit: int, most: int) -> PairPlan:
    """The order in which `all_sets` visits sets of at most `limit` parameters, none with more than `most` (up to two)
    of the `few`."""
    rare = np.asarray(few, bool)
    other, r = plan(int(np.sum(~rare)), limit)[0], int(np.sum(rare))
    size = other.sum(axis=1)
    rows = [np.flatnonzero(size <= limit - k) if k <= min(most, r) else np.zeros(0, int) for k in range(PAIRS + 1)]
    pairs = np.array(np.triu_indices(r, 1))
    beside = [
        np.zeros((1, r), bool),
        np.eye(r, dtype=bool),
        np.eye(r, dtype=bool)[pairs[0]] | np.eye(r, dtype=bool)[pairs[1]],
    ]
    masks = np.zeros((sum(len(a) * len(b) for a, b in zip(rows, beside, strict=True)), len(few)), bool)
    masks[:, ~rare] = np.concatenate([np.tile(other[a], (len(b), 1)) for a, b in zip(rows, beside, strict=True)])
    masks[:, rare] = np.concatenate([np.repeat(b, len(a), axis=0) for a, b in zip(rows, beside, strict=True)])
    masks.flags.writeable = False
    return PairPlan(masks, rows[0], rows[1], rows[2])


def sets_of(p: int, limit: int, few: tuple[bool, ...], most: int) -> np.ndarray:
    """Masks (M, p) of `all_sets`, in its order."""
    return pair_plan(few, limit, most).masks if any(few) and most <= PAIRS else plan(p, limit, few, most)[0]


@lru_cache(maxsize=256)
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
