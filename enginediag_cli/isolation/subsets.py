"""The best explaining set of each size, exactly: all sets of few parameters, else branch and bound.

    maximise  f(S) = b_Sᵀ I_SS⁻¹ b_S  over all sets S of k parameters       (step 1 of incremental diagnosis)

This is best-subset regression, by "leaps and bounds" where there are too many sets to visit them all: Furnival,
G. M. and Wilson, R. W. (1974) Technometrics 16, 499–511. The tree
starts at the full set and drops parameters. With P = I_SS⁻¹, δ = P b_S, dropping j loses δ_j²/P_jj, and
dropping any set T loses at least the largest single loss in T; so a branch that must still drop d parameters
loses at least the d-th smallest of its single losses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.isolation.enumeration import all_sets
from enginediag_cli.residuals.score import Score

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
        sets, nodes, exact = _best_of_all(b, information, largest), 2 ** len(alive), True
    else:
        search = _Search(b, information, largest, max_nodes)
        search.run()
        sets, nodes, exact = [tuple(sorted(s)) for s in search.sets[1:]], search.nodes, search.exact
    return BestSubsets(
        tuple(tuple(int(alive[i]) for i in s) for s in sets),
        np.array([subset_value(b, information, s) for s in sets]),
        nodes,
        exact,
    )


def _best_of_all(b: np.ndarray, information: np.ndarray, largest: int) -> list[tuple[int, ...]]:
    """Best set of every size 1…largest, for unit-diagonal information."""
    masks, values, _ = all_sets(b[None], (information + RIDGE * np.eye(len(b)))[None], largest)
    size = masks.sum(axis=1)
    best = [np.argmax(np.where(size == k, values[0], -np.inf)) for k in range(1, largest + 1)]
    return [tuple(int(i) for i in np.flatnonzero(masks[k])) for k in best]


class _Search:
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
