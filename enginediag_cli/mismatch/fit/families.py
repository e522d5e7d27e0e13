"""Sums of candidate columns, from which every score, and what all scores have in common, follows.

A candidate is a parameter's derivative times a curve over the records, c = J_l φ_a, and a family is a set of them that
share names (L) and curves (Φ): an effect's amplitudes with φ = 1, changes in time with a step each, places of the
free-form map with polynomials of each driver. Their rows are never formed: with J_nl the m readings of record n,

    Aᵀc = Σ_n φ_na (A_nᵀ J_nl)        c_laᵀc_kb = Σ_n φ_na φ_nb (J_nlᵀ J_nk)

Where noise is correlated in time the rows are differences, J_n φ_n − J'_n φ_{n−1} with J' the share of the record
before, and each sum has the products of both parts. Sums of a recording are freed of its own offsets where it ends.

All of this is additive over records: `Sums` of a recording in two halves are those of the whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby

import numpy as np

from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.projection import Projection, Rows, Score, score_of

AT_ONCE = 256
"""Records whose products are formed at once: 256 x 100 nuisance columns x 60 names are 12 MB."""

Candidates = np.ndarray
"""(k, 2) int: name and curve of each candidate of a block."""


@dataclass(frozen=True)
class Family:
    """`names` (L,) of parameters and `curves` (N, Φ) over the fit's records; `name_pairs`, `curve_pairs` (…, 2): of
    which products are summed (a block needs all pairs within it, first index of a name pair the smaller)."""

    names: tuple[str, ...]
    curves: np.ndarray
    name_pairs: np.ndarray
    curve_pairs: np.ndarray

    @property
    def whole(self) -> Family:
        """With the products of all candidates."""
        a, b = np.meshgrid(np.arange(self.curves.shape[1]), np.arange(self.curves.shape[1]), indexing="ij")
        all_names = np.column_stack(np.triu_indices(len(self.names)))
        return Family(self.names, self.curves, all_names, np.column_stack([a.ravel(), b.ravel()]))


def grid(names: Sequence[str], curves: np.ndarray, blocks: Iterable[Sequence[int]], together: Sequence = ()) -> Family:
    """A family of which each name stands alone, with each block of curves; and pairs of names that stand `together`."""
    own = [(j, j) for j in range(len(names))] + [tuple(sorted(pair)) for pair in together]
    within = list(dict.fromkeys((a, b) for block in blocks for a in block for b in block))
    return Family(tuple(names), curves, np.array(own, int).reshape(-1, 2), np.array(within, int).reshape(-1, 2))


class Sums:
    """A family's sums at a fit: `lengths` (L, Φ) before projection, `along` (p, L, Φ) = R⁻ᵀAᵀc, `pull` (L, Φ) = c⊥ᵀe,
    offsets of the recordings eliminated from all but the first."""

    def __init__(self, projection: Projection, columns: Columns, family: Family):
        self.projection, self.columns, self.family = projection, columns, family
        q, R, p = projection.found.fit.z.shape[1], projection.R, len(projection.R)
        L, Phi = len(family.names), family.curves.shape[1]
        totals, crossed, own = Totals(family, p + q + 1, projection.frame.correlated), np.zeros((p + 1, Phi, L)), -1
        taken = np.zeros_like(totals.products)
        for rows, now, before in family_rows(projection, columns, family):
            if rows.recording != own:
                crossed += _freed(projection, own, totals, taken)
                own = rows.recording
            totals.add(rows, now, before)
        crossed += _freed(projection, own, totals, taken)
        B = crossed.transpose(0, 2, 1)  # (p + 1, L, Φ)
        self.along = np.linalg.solve(R.T, B[:p].reshape(p, -1)).reshape(p, L, Phi)
        self.pull = B[p] - np.tensordot(projection.pull, self.along, axes=1)
        self.lengths = np.sqrt(np.maximum(totals.squares, 0.0))
        self._products = totals.in_both_orders - taken
        self._name_at, self._curve_at = np.full((L, L), -1), np.full((Phi, Phi), -1)
        self._name_at[tuple(family.name_pairs.T)] = np.arange(len(family.name_pairs))
        self._curve_at[tuple(family.curve_pairs.T)] = np.arange(len(family.curve_pairs))

    def gram(self, of: Candidates) -> np.ndarray:
        """C⊥ᵀC⊥ (k, k) of candidates; those whose products were not summed cost a pass over the records."""
        name, curve = of.T
        swap = name[:, None] > name[None, :]
        l = np.where(swap, name[None, :], name[:, None]), np.where(swap, name[:, None], name[None, :])
        c = np.where(swap, curve[None, :], curve[:, None]), np.where(swap, curve[:, None], curve[None, :])
        at = self._curve_at[c], self._name_at[l]
        if min(at[0].min(initial=0), at[1].min(initial=0)) < 0:
            return self.whole.gram(of)
        W = self.along[:, name, curve]
        G = self._products[at] - W.T @ W
        return np.asarray((G + G.T) / 2)

    def alone(self, name: int) -> np.ndarray:
        """c⊥ᵀc⊥ (Φ,) of a name with each curve by itself, as a `grid` has them."""
        curve = np.arange(self.family.curves.shape[1])
        own = self._products[self._curve_at[curve, curve], self._name_at[name, name]]
        return np.asarray(own - np.sum(self.along[:, name] ** 2, axis=0))

    def score(self, of: Candidates) -> Score:
        """Of one block."""
        return score_of(self.gram(of), self.pulls(of), float(self.lengths[tuple(of[0])]))

    def pulls(self, of: Candidates) -> np.ndarray:
        """C⊥ᵀe (k,)."""
        return np.asarray(self.pull[of[:, 0], of[:, 1]])

    def rows_along(self, of: Candidates, coefficients: np.ndarray) -> np.ndarray:
        """C⊥ times coefficients (k,), as whitened rows (N, m), 0 where there is no reading."""
        projection, (name, curve) = self.projection, of.T
        alpha = np.linalg.solve(projection.R, self.along[:, name, curve] @ coefficients)
        found = np.zeros(projection.frame.keep.shape)
        for r, rows in groupby(family_rows(projection, self.columns, self.family), key=lambda row: row[0].recording):
            pull, parts = np.zeros(projection.found.fit.z.shape[1]), []
            for row, own, before in rows:
                phi = self.family.curves[row.span][:, curve] * coefficients
                found[row.span] = np.einsum("nmk,nk->nm", own[:, :, name], phi)
                if before is not None:
                    last = self.family.curves[np.maximum(np.arange(row.span.start, row.span.stop) - 1, 0)][:, curve]
                    found[row.span] -= np.einsum("nmk,nk->nm", before[:, :, name], last * coefficients)
                found[row.span] -= row.A @ alpha
                pull += np.einsum("nmq,nm->q", row.Z, found[row.span])
                parts.append(row)
            # what is left along the recording's offsets, their priors counted
            own_R = projection.offsets[r].R
            beta = np.linalg.solve(own_R, np.linalg.solve(own_R.T, pull))
            for row in parts:
                found[row.span] -= row.Z @ beta
        return found

    @cached_property
    def whole(self) -> Sums:
        """With the products of all candidates."""
        return Sums(self.projection, self.columns, self.family.whole)


def family_rows(
    projection: Projection, columns: Columns, family: Family
) -> Iterator[tuple[Rows, np.ndarray, np.ndarray | None]]:
    """Rows of the nuisance, and of the family's names in the two parts (n, m, L) of `Whitening.parts`."""
    at = np.array([columns.at[n] for n in family.names], int)
    for rows, own, before in columns.whitened(projection):
        yield rows, own[:, :, at], None if before is None else before[:, :, at]


def _freed(projection: Projection, recording: int, totals: Totals, taken: np.ndarray) -> np.ndarray:
    """A recording's [A e]ᵀC (p + 1, Φ, L) freed of its offsets, whose products are added to `taken`; `totals` begins
    anew with the next recording, but for the products."""
    k, q = len(totals.crossed), projection.found.fit.z.shape[1]
    own, totals.crossed = totals.crossed, np.zeros_like(totals.crossed)
    if not q or recording < 0:
        return np.asarray(own[q:])
    offsets = projection.offsets[recording]
    W = np.linalg.solve(offsets.R.T, own[:q].reshape(q, -1)).reshape(q, *own.shape[1:])
    (i, j), (a, b) = totals.family.name_pairs.T, totals.family.curve_pairs.T
    for w in W:
        taken += w[a][:, i] * w[b][:, j]
    along = np.column_stack([offsets.along, offsets.pull])
    return np.asarray(own[q:] - (along.T @ W.reshape(q, -1)).reshape(k - q, *own.shape[1:]))


class Totals:
    """Sums while records go by. `crossed` (k, Φ, L): candidates with the k columns [Z A e]; `products` (curve pairs,
    name pairs): with each other; `squares` (L, Φ) of each."""

    def __init__(self, family: Family, k: int, correlated: bool):
        self.family = family
        L, Phi = len(family.names), family.curves.shape[1]
        self.crossed = np.zeros((k, Phi, L))
        self.products = np.zeros((len(family.curve_pairs), len(family.name_pairs)))
        self.squares = np.zeros((L, Phi))
        self._all_names = len(family.name_pairs) == L * (L + 1) // 2
        a, b = family.curve_pairs.T
        # in white noise the products of two curves are the same in either order
        self._once = np.flatnonzero((a <= b) | correlated)

    @property
    def in_both_orders(self) -> np.ndarray:
        """The products, with those that were left out as another's mirror image."""
        a, b = self.family.curve_pairs.T
        at = np.full((self.family.curves.shape[1],) * 2, -1)
        at[a[self._once], b[self._once]] = self._once
        return np.asarray(self.products[np.where(at[a, b] >= 0, at[a, b], at[b, a])])

    def add(self, rows: Rows, own: np.ndarray, before: np.ndarray | None) -> None:
        """`own` and `before` (n, m, L) of the family's names."""
        f, X = self.family, rows.stacked
        for a in range(0, len(own), AT_ONCE):
            part = slice(a, a + AT_ONCE)
            here = slice(rows.span.start + a, min(rows.span.start + a + AT_ONCE, rows.span.stop))
            F, O = f.curves[here], own[part]
            Xt = X[part].transpose(0, 2, 1)
            self.crossed += _gathered(F, Xt @ O)
            self.squares += (O**2).sum(axis=1).T @ F**2
            self._multiply(F, F, O, O)
            if before is not None:
                # the first record of all has none before it: its share is 0
                P, Fb = before[part], f.curves[np.maximum(np.arange(here.start, here.stop) - 1, 0)]
                self.crossed -= _gathered(Fb, Xt @ P)
                self.squares += (P**2).sum(axis=1).T @ Fb**2 - 2.0 * (O * P).sum(axis=1).T @ (F * Fb)
                self._multiply(Fb, Fb, P, P)
                self._multiply(F, Fb, O, P, -1.0)
                self._multiply(Fb, F, P, O, -1.0)

    def _multiply(self, F: np.ndarray, H: np.ndarray, O: np.ndarray, P: np.ndarray, sign: float = 1.0) -> None:
        i, j = self.family.name_pairs.T
        a, b = self.family.curve_pairs[self._once].T
        if F.shape[1] == 1:
            L = O.shape[2]
            G = (O * F[:, :, None]).reshape(-1, L).T @ (P * H[:, :, None]).reshape(-1, L)
            self.products[0] += sign * G[i, j]
            return
        if self._all_names:
            D = (O.transpose(0, 2, 1) @ P)[:, i, j]
        else:
            D = np.einsum("nmk,nmk->nk", O[:, :, i], P[:, :, j])
        self.products[self._once] += sign * ((F[:, a] * H[:, b]).T @ D)


def _gathered(F: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Σ_n φ_na M_nxl as (x, Φ, L)."""
    n, x, L = M.shape
    return np.asarray((F.T @ M.reshape(n, -1)).reshape(F.shape[1], x, L).transpose(1, 0, 2))


@dataclass(frozen=True)
class Scored:
    """A block of candidates with its score."""

    sums: Sums
    candidates: Candidates
    score: Score


def correlations(blocks: Sequence[Scored]) -> tuple[np.ndarray, list[int]]:
    """Products (K, K) of orthonormal columns that span each block of one family, and how many each block has."""
    if not blocks:
        return np.zeros((0, 0)), []
    sizes = [len(b.candidates) for b in blocks]
    G = blocks[0].sums.gram(np.concatenate([b.candidates for b in blocks]))
    V, row, column = np.zeros((len(G), sum(b.score.dof for b in blocks))), 0, 0
    for b, k in zip(blocks, sizes, strict=True):
        values, vectors = np.linalg.eigh(G[row : row + k, row : row + k])
        strongest = slice(k - b.score.dof, k)
        root = np.sqrt(np.maximum(values[strongest], 1e-300))
        V[row : row + k, column : column + b.score.dof] = vectors[:, strongest] / root
        row, column = row + k, column + b.score.dof
    return np.asarray(V.T @ G @ V), [b.score.dof for b in blocks]


def first_products(blocks: Sequence[Scored]) -> np.ndarray:
    """C⊥ᵀC⊥ (k, k) of the first column of each block, of whatever families of one fit; of several, by a pass over the
    records."""
    one = blocks[0].sums
    if all(b.sums is one for b in blocks):
        return one.gram(np.array([b.candidates[0] for b in blocks]))
    names = list(dict.fromkeys(b.sums.family.names[b.candidates[0, 0]] for b in blocks))
    curves: dict[tuple[int, int], np.ndarray] = {}
    chosen = []
    for b in blocks:
        name, curve = b.candidates[0]
        key = (id(b.sums), int(curve))
        curves.setdefault(key, b.sums.family.curves[:, curve])
        chosen.append((names.index(b.sums.family.names[name]), list(curves).index(key)))
    family = grid(names, np.stack(list(curves.values()), axis=1), []).whole
    return Sums(one.projection, one.columns, family).gram(np.array(chosen))
