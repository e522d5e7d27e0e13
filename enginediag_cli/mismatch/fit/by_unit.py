"""Scores of a family when whole units of its records are drawn again: the sums of each unit.

With X = [Z A e] of a recording, c⊥ = c − X γ and e⊥ = X λ, where γ and λ are known from the sums over all records, a
unit's share of every score follows from its own sums Xᵀc, XᵀX and cᵀc:

    c⊥ᵀe⊥ = (Xᵀc − XᵀXγ)ᵀλ        c⊥ᵀd⊥ = cᵀd − γ_cᵀ Xᵀd − (Xᵀc − XᵀXγ_c)ᵀ γ_d
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby, pairwise

import numpy as np

from enginediag_cli.mismatch.fit.families import Candidates, Sums, Totals, family_rows
from enginediag_cli.mismatch.fit.projection import Rows


@dataclass(frozen=True)
class UnitSums:
    """Of each of U units and, last, of the priors: `pull` (U + 1, L, Φ) = c⊥ᵀe⊥, and `products` (U + 1, curve pairs,
    name pairs) of those that the family sums."""

    pull: np.ndarray
    products: np.ndarray
    _at: np.ndarray
    _name_at: np.ndarray

    def of(self, block: Candidates) -> tuple[np.ndarray, np.ndarray]:
        """c⊥ᵀe⊥ (U + 1, k) and C⊥ᵀC⊥ (U + 1, k, k) of a block whose products the family sums."""
        name, curve = block.T
        swap = name[:, None] > name[None, :]
        i, j = np.minimum(name[:, None], name[None, :]), np.maximum(name[:, None], name[None, :])
        a, b = np.where(swap, curve[None, :], curve[:, None]), np.where(swap, curve[:, None], curve[None, :])
        return self.pull[:, name, curve], self.products[:, self._at[a, b], self._name_at[i, j]]


def unit_sums(sums: Sums, unit: np.ndarray, count: int) -> UnitSums:
    """Sums of each unit; `unit` (N,) is that of each record, and none has records of two recordings."""
    projection, family = sums.projection, sums.family
    L, Phi, fit = len(family.names), family.curves.shape[1], projection.found.fit
    q, p = fit.z.shape[1], len(projection.R)
    pairs, (i, j) = family.curve_pairs, family.name_pairs.T
    pull, products = np.zeros((count + 1, L, Phi)), np.zeros((count + 1, len(pairs), len(i)))
    alpha = np.linalg.solve(projection.R, sums.along.reshape(p, -1)).reshape(p, L, Phi).transpose(0, 2, 1)
    free_x = fit.x[: len(fit.at_bound)][~fit.at_bound] + projection.step
    a, b = pairs.T

    def add(k: int, pulled: np.ndarray, multiplied: np.ndarray) -> None:
        pull[k] += pulled.T
        products[k] += multiplied

    add(count, np.tensordot(free_x, alpha, axes=1), _beside(alpha[:, a][:, :, i], alpha[:, b][:, :, j]))
    for r, rows in groupby(family_rows(projection, sums.columns, family), key=lambda row: row[0].recording):
        totals: dict[int, tuple[Totals, np.ndarray]] = {}
        for row, now, before in rows:
            for k, part in _parts(unit, row):
                t, XX = totals.get(k) or (Totals(family, q + p + 1, projection.frame.correlated), np.zeros(()))
                piece = Rows(r, slice(row.span.start + part.start, row.span.start + part.stop), *_cut(row, part))
                t.add(piece, now[part], None if before is None else before[part])
                X = piece.stacked.reshape(-1, q + p + 1)
                totals[k] = t, XX + X.T @ X
        offsets = projection.offsets[r]
        gamma = np.zeros((q + p + 1, Phi, L))
        gamma[q : q + p] = alpha
        if q:
            ZC = np.sum([t.crossed[:q] for t, _ in totals.values()], axis=0).reshape(q, -1)
            W = np.linalg.solve(offsets.R.T, ZC) - offsets.along @ alpha.reshape(p, -1)
            gamma[:q] = np.linalg.solve(offsets.R, W).reshape(q, Phi, L)
        step = projection.offset_step(r)
        lam = np.concatenate([-step, -projection.step, [1.0]])
        for k, (t, XX) in totals.items():
            left = t.crossed - (XX @ gamma.reshape(len(gamma), -1)).reshape(gamma.shape)
            both = _beside(gamma[:, a][:, :, i], t.crossed[:, b][:, :, j])
            both = both + _beside(left[:, a][:, :, i], gamma[:, b][:, :, j])
            add(k, np.tensordot(lam, left, axes=1), t.in_both_orders - both)
        add(
            count,
            np.tensordot(fit.z[r] + step, gamma[:q], axes=1),
            _beside(gamma[:q][:, a][:, :, i], gamma[:q][:, b][:, :, j]),
        )
    at = np.full((Phi, Phi), -1)
    at[a, b] = np.arange(len(pairs))
    name_at = np.full((L, L), -1)
    name_at[i, j] = np.arange(len(i))
    return UnitSums(pull, products, at, name_at)


def _beside(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Σ_x of products (x, curve pairs, name pairs)."""
    return np.einsum("xal,xal->al", one, other)


def _parts(unit: np.ndarray, rows: Rows) -> list[tuple[int, slice]]:
    """Units among the rows, and where they are."""
    own = unit[rows.span]
    edges = [0, *(np.flatnonzero(np.diff(own)) + 1), len(own)]
    return [(int(own[a]), slice(int(a), int(b))) for a, b in pairwise(edges)]


def _cut(rows: Rows, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return rows.A[part], rows.Z[part], rows.e[part]
