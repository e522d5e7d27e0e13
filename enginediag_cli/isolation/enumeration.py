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
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Quadratic forms and log determinants (w, M) of the sets that grow by the first parameters in turn, and what is
    then left of β (w, M, r) and A (w, M, r, r) for the others."""
    w = len(beta)
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
    return quadratic, log_det, c, G


def _with_pairs(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`all_sets` with none, one or two of the `few` parameters (p,)."""
    order = np.argsort(few, kind="stable")
    n, r = int(np.sum(~few)), int(np.sum(few))
    quadratic, log_det, c, G = _eliminated(beta[:, order], A[:, order][:, :, order], plan(n, limit)[1])
    sets = pair_plan(tuple(few.tolist()), limit, most)
    quadratics, log_dets = [quadratic[:, sets.alone]], [log_det[:, sets.alone]]
    if most >= 1:
        diagonal = G[:, :, range(r), range(r)]
        gain, log = c**2 / diagonal, np.log(diagonal)
        rows = sets.with_one
        quadratics.append((quadratic[:, rows, None] + gain[:, rows]).reshape(len(beta), -1))
        log_dets.append((log_det[:, rows, None] + log[:, rows]).reshape(len(beta), -1))
    if most >= PAIRS:
        rows, (i, j) = sets.with_two, sets.pairs
        if len(rows) < len(sets.alone):
            c, G, diagonal, gain, log = (x[:, rows] for x in (c, G, diagonal, gain, log))
        common = G.reshape(*G.shape[:2], r * r).take(i * r + j, axis=2)
        across = common / diagonal.take(i, axis=2)
        pivot = diagonal.take(j, axis=2) - across * common
        left = c.take(j, axis=2) - c.take(i, axis=2) * across
        left *= left
        left /= pivot
        left += (quadratic[:, rows, None] + gain).take(i, axis=2)
        quadratics.append(left.reshape(len(beta), -1))
        more = np.log(pivot, out=pivot)
        more += (log_det[:, rows, None] + log).take(i, axis=2)
        log_dets.append(more.reshape(len(beta), -1))
    return sets.masks, np.concatenate(quadratics, axis=1), np.concatenate(log_dets, axis=1)


@dataclass(frozen=True)
class PairPlan:
    """Sets of at most two of the rare parameters: `masks` (M, p); of the sets of the others, which stand `alone`, get
    one and get two of the rare beside them, and the `pairs` (2, r (r − 1)/2) of these."""

    masks: np.ndarray
    alone: np.ndarray
    with_one: np.ndarray
    with_two: np.ndarray
    pairs: np.ndarray


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
    masks[:, ~rare] = np.concatenate([np.repeat(other[a], len(b), axis=0) for a, b in zip(rows, beside, strict=True)])
    masks[:, rare] = np.concatenate([np.tile(b, (len(a), 1)) for a, b in zip(rows, beside, strict=True)])
    masks.flags.writeable = False
    return PairPlan(masks, rows[0], rows[1], rows[2], pairs)


@lru_cache(maxsize=8)
def counted(p: int, limit: int, few: tuple[bool, ...], most: int) -> tuple[np.ndarray, np.ndarray]:
    """How many of the `few` parameters, and how many others, each set of `all_sets` has, in its order (M,) each."""
    rare = np.asarray(few, bool)
    masks = pair_plan(few, limit, most).masks if rare.any() and most <= PAIRS else plan(p, limit, few, most)[0]
    return (masks & rare).sum(axis=1), (masks & ~rare).sum(axis=1)


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
