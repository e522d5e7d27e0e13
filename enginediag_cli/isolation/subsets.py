"""Sets of parameters: all of them with their quadratic forms, and the best explaining set of each size.

Enumeration: β_Sᵀ A_SS⁻¹ β_S and log det A_SS of every set S at once. Parameter by parameter every set splits into
"without" and "with", the latter by one elimination step (Gauss–Jordan), about six operations per set in total.
Parameters of which a set has two at most, as those of instruments, come last, and in closed form: with c, G the Schur
complements of β and A given the others, adding i and j gains

    c_i²/G_ii + (c_j − c_i G_ij/G_ii)²/π_j  and  log G_ii + log π_j,     π_j = G_jj − G_ij²/G_ii

Best subset of each size, exactly: all sets of few parameters, else branch and bound.

    maximise  f(S) = b_Sᵀ I_SS⁻¹ b_S  over all sets S of k parameters       (step 1 of incremental diagnosis)

This is best-subset regression, by "leaps and bounds" where there are too many sets to visit them all: Furnival,
G. M. and Wilson, R. W. (1974) Technometrics 16, 499–511. The tree
starts at the full set and drops parameters. With P = I_SS⁻¹, δ = P b_S, dropping j loses δ_j²/P_jj, and
dropping any set T loses at least the largest single loss in T; so a branch that must still drop d parameters
loses at least the d-th smallest of its single losses.

Sizes of the changes of a set are Gaussian, one for each slab, within bounds and by the direction of wear. Given the set
S and the slab w the changes, in widths of the prior, are Gaussian,

    x_S | S, w, data ~ N(P b_S, P),    P = (I_SS + w⁻² 1)⁻¹
    ln p(data | S, w) − ln p(data | no change) = ½ b_Sᵀ P b_S + ½ ln det P − |S| ln w

The slab prior of a change lies within what a component or an instrument can do (`SetPrior.bounds`). Of a parameter that
wear changes one way only, 1 − ρ of the mass lies on that side and ρ, for replaced and repaired modules, on the other.
Relative to the unbounded symmetric prior the marginal likelihood of a set changes by the factor

    E[Π_i h_i(x_i) | S, slab, data],     h_i = (1 − ρ)/P(0 < s x < bound) in the direction of wear,
                                              ρ/P(0 < −s x < bound) in the other, 0 beyond either bound

over the parameters i of S that have bounds, with the sign s of their wear (ρ = ½ where both directions are equally
probable), averaged over slabs by their posterior. The expectation is taken parameter by parameter: the others keep the
first two moments that each step leaves, as if they were still Gaussian (Mendell, N. R. and Elston, R. C. (1974)
Biometrics 30, 41–57). That is exact for one parameter and for independent ones, and costs no integral.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from math import comb

import numpy as np

from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.probability import normalized_weights
from enginediag_cli.residuals.score import Score

PAIRS = 2
"""Of rare parameters, as many at once have a closed form here."""


def enumerate_sets(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray | None = None, most: int = 0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masks (M, p) of all sets of at most `limit` parameters, quadratic forms (w, M), log determinants (w, M).

    beta (w, p), A (w, p, p) positive definite: w problems over the same parameters. few (p,) bool: of these
    parameters no set has more than `most`.
    """
    p = beta.shape[1]
    rare = np.zeros(p, bool) if few is None else np.asarray(few, bool)
    if rare.any() and most <= PAIRS:
        return _enumerate_with_pairs(beta, A, limit, rare, most)
    masks, growing = enumeration_plan(p, limit, tuple(rare.tolist()), most)
    return masks, *_eliminate(beta, A, growing)[:2]


def _eliminate(
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


def _enumerate_with_pairs(
    beta: np.ndarray, A: np.ndarray, limit: int, few: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """`enumerate_sets` with none, one or two of the `few` parameters (p,)."""
    order = np.argsort(few, kind="stable")
    n, r = int(np.sum(~few)), int(np.sum(few))
    sets = pair_plan(tuple(few.tolist()), limit, most)
    quadratic, log_det, c, G = _eliminate(beta[:, order], A[:, order][:, :, order], enumeration_plan(n, limit)[1])
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
    for size, rows in ((1, sets.with_one_rare), (2, sets.with_two_rare)):
        if most < size or not r:
            break
        if len(rows) < len(sets.without_rare):
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
    without_rare: np.ndarray
    with_one_rare: np.ndarray
    with_two_rare: np.ndarray


@lru_cache(maxsize=8)
def pair_plan(few: tuple[bool, ...], limit: int, most: int) -> PairPlan:
    """The order in which `enumerate_sets` visits sets of at most `limit` parameters, none with more than `most` (up to
    two) of the `few`."""
    rare = np.asarray(few, bool)
    other, r = enumeration_plan(int(np.sum(~rare)), limit)[0], int(np.sum(rare))
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


def enumeration_masks(p: int, limit: int, few: tuple[bool, ...], most: int) -> np.ndarray:
    """Masks (M, p) of `enumerate_sets`, in its order."""
    return pair_plan(few, limit, most).masks if any(few) and most <= PAIRS else enumeration_plan(p, limit, few, most)[0]


@lru_cache(maxsize=256)
def count_sets(p: int, limit: int, few: int = 0, most: int = 0) -> int:
    """How many sets of at most `limit` of p parameters there are, with no more than `most` out of `few` of them."""
    return sum(
        comb(few, j) * sum(comb(p - few, i) for i in range(max(limit - j, -1) + 1)) for j in range(min(most, few) + 1)
    )


@lru_cache(maxsize=8)
def enumeration_plan(
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


MAX_SETS = 1_200_000
"""Enough for all sets of 20 parameters, or up to five of 40; about a second."""


def size_limit(
    p: int, wanted: int | None = None, max_sets: int = MAX_SETS, sensors: int = 0, wrong_sensors: int = 0
) -> int:
    """Largest size (at most `wanted`) for which there are no more than `max_sets` sets of p parameters, of which no
    more than `max_sensor_faults` are out of `sensors` of them."""
    limit = 0
    while limit < (p if wanted is None else min(wanted, p)):
        if count_sets(p, limit + 1, sensors, wrong_sensors) > max_sets:
            break
        limit += 1
    return limit


ENUMERATED = 12
"""Up to so many parameters all sets are visited: that takes 2 ms, for all sizes together."""


BATCH = 1024
"""Nodes handled together: numpy overhead is shared, memory stays small."""


RIDGE = 1e-9
"""Added to the unit diagonal of I while searching, so that imitating parameters do not divide by zero."""


@dataclass(frozen=True)
class BestSubsets:
    """Best set of each size k = 1…: `sets[k-1]` as sorted indices, `values[k-1]` = f; `exact` False when the
    search was cut short at its node limit, and the sets are then the best found."""

    sets: tuple[tuple[int, ...], ...]
    values: np.ndarray
    nodes: int
    exact: bool


def subset_value(b: np.ndarray, information: np.ndarray, chosen: tuple[int, ...]) -> float:
    """f(S) by pseudo-inverse, for unit-diagonal information."""
    i = list(chosen)
    eigenvalues, vectors = np.linalg.eigh(information[np.ix_(i, i)])
    kept = eigenvalues > RIDGE
    return float(np.sum((b[i] @ vectors[:, kept]) ** 2 / eigenvalues[kept]))


def best_subsets(score: Score, largest: int, max_nodes: int = 2_000_000) -> BestSubsets:
    """Best set of every size up to `largest` among the parameters that the data excite."""
    b, information = score.scaled()
    diagonal = np.diag(information)
    alive = np.flatnonzero(diagonal > RIDGE * np.max(diagonal, initial=0.0))
    unit = 1 / np.sqrt(diagonal[alive])
    b, information = b[alive] * unit, information[np.ix_(alive, alive)] * unit[:, None] * unit
    largest = min(largest, len(alive))
    if len(alive) <= ENUMERATED:
        sets, nodes, exact = _best_by_enumeration(b, information, largest), 2 ** len(alive), True
    else:
        search = _BranchAndBound(b, information, largest, max_nodes)
        search.run()
        sets, nodes, exact = [tuple(sorted(s)) for s in search.sets[1:]], search.nodes, search.exact
    return BestSubsets(
        tuple(tuple(int(alive[i]) for i in s) for s in sets),
        np.array([subset_value(b, information, s) for s in sets]),
        nodes,
        exact,
    )


def _best_by_enumeration(b: np.ndarray, information: np.ndarray, largest: int) -> list[tuple[int, ...]]:
    """Best set of every size 1…largest, for unit-diagonal information."""
    masks, values, _ = enumerate_sets(b[None], (information + RIDGE * np.eye(len(b)))[None], largest)
    size = masks.sum(axis=1)
    best = [np.argmax(np.where(size == k, values[0], -np.inf)) for k in range(1, largest + 1)]
    return [tuple(int(i) for i in np.flatnonzero(masks[k])) for k in best]


class _BranchAndBound:
    """State of one search: incumbents by size, and a stack of batches of nodes of equal set size."""

    def __init__(self, b: np.ndarray, information: np.ndarray, largest: int, max_nodes: int):
        self.b, self.I, self.largest, self.max_nodes = (
            b,
            information + RIDGE * np.eye(len(b)),
            largest,
            max_nodes,
        )
        self.values = np.full(largest + 1, -np.inf)
        self.sets: list[tuple[int, ...]] = [()] * (largest + 1)
        self.nodes, self.exact = 0, True

    def run(self) -> None:
        p = len(self.b)
        if not self.largest:
            return
        self._seed()
        P = np.linalg.inv(self.I)
        order = np.arange(p)
        self._offer(p, self.b @ P @ self.b, order)
        stack = [(order[None], P[None], (P @ self.b)[None], np.array([self.b @ P @ self.b]), np.zeros(1, int))]
        while stack:
            variables, P, delta, value, fixed = stack.pop()
            self.nodes += len(value)
            if self.nodes > self.max_nodes:
                self.exact = False
                return
            for children in self._expand(variables, P, delta, value, fixed):
                stack.append(children)

    def _expand(
        self, variables: np.ndarray, P: np.ndarray, delta: np.ndarray, value: np.ndarray, fixed: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """Children of a batch of sets of n parameters, the first `fixed` of which may not be dropped."""
        n = variables.shape[1]
        losses = delta**2 / np.einsum("bii->bi", P)
        droppable = np.arange(n) >= fixed[:, None]
        # parameters that cost most to drop first: their branches, which may still drop all others, die early
        order = np.argsort(np.where(droppable, -losses, -np.inf), axis=1, kind="stable")
        variables, losses = np.take_along_axis(variables, order, 1), np.take_along_axis(losses, order, 1)
        P = np.take_along_axis(np.take_along_axis(P, order[:, :, None], 1), order[:, None, :], 2)
        delta = np.take_along_axis(delta, order, 1)
        alive = self._alive(value, losses, fixed)
        if not alive.any():
            return []
        node, drop = np.nonzero(alive[:, None] & droppable & (np.arange(n) <= self.largest))
        child_value = value[node] - losses[node, drop]
        sizes = np.arange(self.largest + 1)
        useful = (sizes >= np.maximum(drop, 1)[:, None]) & (sizes <= n - 1)
        promising = np.any(useful & (child_value[:, None] > self.values), axis=1)
        node, drop, child_value = node[promising], drop[promising], child_value[promising]
        keep = np.arange(n - 1) + (np.arange(n - 1) >= drop[:, None])
        if n - 1 <= self.largest:
            for i in np.argsort(-child_value, kind="stable")[:1]:
                self._offer(n - 1, child_value[i], variables[node[i], keep[i]])
        if n - 1 <= 1:
            return []
        children = []
        for first in range(0, len(node), BATCH):
            rows = slice(first, first + BATCH)
            k, d, kept = node[rows], drop[rows], keep[rows]
            column = np.take_along_axis(P[k, :, d], kept, 1)
            pivot = P[k, d, d]
            smaller = P[k[:, None, None], kept[:, :, None], kept[:, None, :]]
            smaller = smaller - column[:, :, None] * column[:, None, :] / pivot[:, None, None]
            shifted = np.take_along_axis(delta[k], kept, 1) - column * (delta[k, d] / pivot)[:, None]
            children.append((np.take_along_axis(variables[k], kept, 1), smaller, shifted, child_value[rows], d))
        return children[::-1]

    def _alive(self, value: np.ndarray, losses: np.ndarray, fixed: np.ndarray) -> np.ndarray:
        """Which nodes can still better an incumbent; `losses` sorted: fixed first, then descending."""
        n = losses.shape[1]
        alive = np.zeros(len(value), bool)
        for k in range(1, min(self.largest, n - 1) + 1):
            # of the n−k to be dropped, the dearest costs at least the (n−k)-th cheapest single loss
            alive |= (fixed <= k) & (value - losses[:, k] > self.values[k])
        return alive

    def _offer(self, size: int, value: float, chosen: np.ndarray) -> None:
        if size <= self.largest and value > self.values[size]:
            self.values[size], self.sets[size] = float(value), tuple(int(i) for i in chosen)

    def _seed(self) -> None:
        """Forward selection with exchanges: good incumbents make the bounds bite from the first node."""
        chosen: list[int] = []
        for size in range(1, self.largest + 1):
            chosen = self._best_addition(chosen)
            improved = True
            while improved and size > 1:
                value = self._value(chosen)
                improved = False
                for j in list(chosen):
                    trial = self._best_addition([i for i in chosen if i != j])
                    if self._value(trial) > value * (1 + 1e-12):
                        chosen, improved = trial, True
                        break
            self._offer(size, self._value(chosen), np.array(chosen))

    def _best_addition(self, chosen: list[int]) -> list[int]:
        rest = np.setdiff1d(np.arange(len(self.b)), chosen)
        if not chosen:
            return [int(rest[np.argmax(self.b[rest] ** 2 / np.diag(self.I)[rest])])]
        cross = self.I[rest][:, chosen]
        inner = np.linalg.solve(self.I[chosen][:, chosen], np.column_stack([cross.T, self.b[chosen]]))
        residual = self.b[rest] - cross @ inner[:, -1]
        room = np.diag(self.I)[rest] - np.einsum("ij,ji->i", cross, inner[:, :-1])
        return [*chosen, int(rest[np.argmax(residual**2 / room)])]

    def _value(self, chosen: list[int]) -> float:
        return float(self.b[chosen] @ np.linalg.solve(self.I[chosen][:, chosen], self.b[chosen]))


NO_SCORES: Mapping[bytes, Score] = {}
"""Where no set has a score about its own estimate."""


def score_groups(masks: np.ndarray, score: Score, about: Mapping[bytes, Score]) -> Iterator[tuple[np.ndarray, Score]]:
    """Rows of the sets `masks` (M, p) with the score that describes them: the common one, then for each set in `about`
    (by the bytes of its mask) the score about its own estimate."""
    own = np.array([mask.tobytes() in about for mask in masks], bool)
    if not own.all():
        yield np.flatnonzero(~own), score
    for k in np.flatnonzero(own):
        yield np.array([k]), about[masks[k].tobytes()]


def sets_by_size(masks: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rows (S,) and members (S, d) of the sets `masks` (M, p) of each size d from 1 on."""
    sizes = masks.sum(axis=1)
    for size in np.unique(sizes[sizes > 0]):
        rows = np.flatnonzero(sizes == size)
        yield rows, np.nonzero(masks[rows])[1].reshape(len(rows), size)


@dataclass(frozen=True)
class SlabGaussians:
    """Changes of S sets of one size d, in widths of the prior: their `rows` (S,) and `members` (S, d); for each of W
    slabs and set the `log` (W, S) of the marginal likelihood relative to no change, mean (W, S, d) and covariance
    (W, S, d, d)."""

    rows: np.ndarray
    members: np.ndarray
    log: np.ndarray
    mean: np.ndarray
    covariance: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """Posterior probability (W, S) of each slab, given the set."""
        return normalized_weights(self.log)


def slab_gaussians(
    score: Score, masks: np.ndarray, prior: SetPrior, about: Mapping[bytes, Score] = NO_SCORES
) -> Iterator[SlabGaussians]:
    """The changes of every set of `masks` (M, p) that is not empty, those of a size and a score together."""
    slabs = np.asarray(prior.slabs, float)
    for group, local in score_groups(masks, score, about):
        b, information = prior.scaled(local)
        for rows, members in sets_by_size(masks[group]):
            size = members.shape[1]
            I = information[members[:, :, None], members[:, None, :]]
            P = np.linalg.inv(I + slabs[:, None, None, None] ** -2 * np.eye(size))
            mean = np.einsum("wsij,sj->wsi", P, b[members])
            log = 0.5 * np.einsum("wsi,si->ws", mean, b[members]) + 0.5 * np.linalg.slogdet(P)[1]
            yield SlabGaussians(group[rows], members, log - size * np.log(slabs)[:, None], mean, P)


WEIGHED = 300
"""Sets that are weighed at once, those first that could be likeliest: in the others signs and bounds are as right as
before the data."""


BATCHES = 10
"""Times so many are weighed: where the likeliest are all beyond what is possible, others lead."""


FAINT = 1e-4
"""Of what the likeliest could weigh; sets that could weigh less are not weighed. All that changes no stated probability
by more than 0.002."""


def log_leading_factors(score: Score, masks: np.ndarray, logs: np.ndarray, prior: SetPrior) -> np.ndarray:
    """Log factors (M,) of sets (M, p) whose log weights without them are `logs` (M,); 0 of what is not weighed; of
    the sets beyond BATCHES no more than of those."""
    bounded = np.isfinite(prior.bounds(score.described)[1])
    found = np.zeros(len(masks))
    if not bounded.any() or not len(masks):
        return found
    most = np.log(2 * max(prior.p_recovery, 1 - prior.p_recovery))
    ceiling = logs + most * (masks & (wear_signs(score, prior) != 0)).sum(axis=1)
    order = np.argsort(-ceiling, kind="stable")
    best, weighed = -np.inf, 0
    for _ in range(BATCHES):
        top = order[weighed : weighed + WEIGHED]
        top = top[ceiling[top] > max(best, ceiling[order[0]] + np.log(FAINT) if weighed == 0 else best + np.log(FAINT))]
        if not len(top):
            return found
        found[top] = log_bound_factors(score, masks[top], prior)
        best = max(best, float((logs + found)[top].max()))
        weighed += len(top)
        if weighed >= len(order) or ceiling[order[weighed]] <= best + np.log(FAINT):
            return found
    found[order[weighed:]] = min(float(found[order[:weighed]].min()), 0.0)
    return found


def wear_signs(score: Score, prior: SetPrior) -> np.ndarray:
    """Way (p,) on which wear takes each parameter, −1 or +1, 0 where both are as probable."""
    known = prior.p_recovery != 0.5
    return np.array([p.wear if known else 0 for p in score.described], float)


def log_bound_factors(
    score: Score,
    masks: np.ndarray,
    prior: SetPrior,
    moved: np.ndarray | None = None,
    of: np.ndarray | None = None,
) -> np.ndarray:
    """Log factor (w,) by which wear and bounds change the marginal likelihood of each set (w, p) bool.

    moved (r, p): what is added to the score, in widths of the prior, and of (r,): to which of the sets; the factors are
    then (r,), one for each.
    """
    b, information = prior.scaled(score)
    slabs = np.asarray(prior.slabs, float)[:, None]
    which = np.arange(len(masks)) if of is None else of
    pulls = np.broadcast_to(b, masks.shape) if moved is None else b + moved
    factors = np.zeros(len(which))
    signs, widths = wear_signs(score, prior), prior.widths(score.described)
    low, high = (end / widths for end in prior.bounds(score.described))
    bounded = np.isfinite(high)
    sizes, counts = masks.sum(axis=1), (masks & bounded).sum(axis=1)
    for size, count in np.unique(np.column_stack([sizes, counts])[counts > 0], axis=0):
        rows = np.flatnonzero((sizes == size) & (counts == count))
        sets = np.nonzero(masks[rows])[1].reshape(len(rows), size)
        sets = np.take_along_axis(sets, np.argsort(~bounded[sets], axis=1, kind="stable"), 1)  # bounded ones first
        A = np.eye(size) + slabs[..., None, None] ** 2 * information[sets[:, :, None], sets[:, None, :]]
        covariance = np.linalg.inv(A)
        log_det = 0.5 * np.linalg.slogdet(covariance)[1]
        place = np.full(len(masks), -1)
        place[rows] = np.arange(len(rows))
        told = np.flatnonzero(place[which] >= 0)
        at = place[which[told]]
        members, covariance = sets[at], covariance[:, at]
        right = slabs[..., None] * np.take_along_axis(pulls[told], members, 1)
        mean = np.einsum("wsij,wsj->wsi", covariance, right)
        log = 0.5 * np.sum(mean * right, axis=2) + log_det[:, at]
        share = log - np.logaddexp.reduce(log, axis=0)
        cut = [np.broadcast_to(x[members], mean.shape).reshape(-1, size)[:, :count] for x in (signs, low, high)]
        unit = np.broadcast_to(slabs[..., None], mean.shape).reshape(-1, size)[:, :count]
        each = _log_expected(
            mean.reshape(-1, size),
            covariance.reshape(-1, size, size),
            cut[0],
            cut[1] / unit,
            cut[2] / unit,
            prior.p_recovery,
        )
        factors[told] = np.logaddexp.reduce(share + each.reshape(share.shape), axis=0)
    return factors


def _log_expected(
    mean: np.ndarray, covariance: np.ndarray, signs: np.ndarray, low: np.ndarray, high: np.ndarray, rises: float
) -> np.ndarray:
    """Log of the expectation (w,) of Gaussians, mean (w, d), covariance (w, d, d), over the first k of their variables,
    whose signs, lowest and highest values are (w, k)."""
    from scipy.special import ndtr

    mean, covariance = mean.copy(), covariance.copy()
    total = np.zeros(len(mean))
    for i in range(signs.shape[1]):
        sign = signs[:, i]
        up = np.where(sign > 0, 1 - rises, np.where(sign < 0, rises, 0.5)) / (ndtr(high[:, i]) - 0.5)
        down = np.where(sign < 0, 1 - rises, np.where(sign > 0, rises, 0.5)) / (0.5 - ndtr(low[:, i]))
        spread = np.sqrt(covariance[:, i, i])
        a, c, z = ((x - mean[:, i]) / spread for x in (low[:, i], np.zeros(len(mean)), high[:, i]))
        log, moved, square = piecewise_normal_moments(a, c, z, down, up)
        total += log
        along = covariance[:, :, i] / spread[:, None]
        mean += along * moved[:, None]
        covariance += (square - moved**2 - 1.0)[:, None, None] * along[:, :, None] * along[:, None, :]
        # of the variable itself nothing but what is within the bounds is left: keep the matrix definite
        covariance[:, i, i] = np.maximum(covariance[:, i, i], 1e-12 * spread**2)
    return total


def piecewise_normal_moments(
    a: np.ndarray, c: np.ndarray, z: np.ndarray, down: np.ndarray, up: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Log of the mass, mean and mean square (w,) of a standard normal variable with the weight `down` from a to c and
    `up` from c to z, 0 beyond."""
    below, above = np.log(down) + log_normal_mass(a, c), np.log(up) + log_normal_mass(c, z)
    total = np.logaddexp(below, above)
    density = [-0.5 * x**2 - 0.5 * np.log(2 * np.pi) for x in (a, c, z)]
    at_a, at_c = (np.exp(np.log(down) + density[k] - total) for k in (0, 1))
    to_c, to_z = (np.exp(np.log(up) + density[k] - total) for k in (1, 2))
    mean = at_a - at_c + to_c - to_z
    low, high = np.where(np.isfinite(a), a, 0.0), np.where(np.isfinite(z), z, 0.0)  # no density so far out
    square = 1.0 + low * at_a - c * at_c + c * to_c - high * to_z
    # far beyond a bound rounding decides: all of the mass lies at it
    at = np.where(a > FAR, a, np.where(z < -FAR, z, np.nan))
    mean = np.where(np.isfinite(at), at, mean)
    square = np.where(np.isfinite(at), at**2, np.maximum(square, mean**2))
    return total, mean, square


FAR = 30.0
"""Standard deviations beyond a bound from which the truncated normal is a point there."""


def log_normal_mass(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """log of the mass (w,) of the standard normal law between `low` and `high`, however far out."""
    from scipy.special import log_ndtr

    flip = low > 0
    one, other = np.where(flip, -high, low), np.where(flip, -low, high)
    upper, lower = log_ndtr(other), log_ndtr(one)
    return np.asarray(upper + np.log(np.maximum(-np.expm1(np.minimum(lower - upper, -1e-300)), 1e-300)))
