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
    L) of each name with itself."""

    pull: np.ndarray
    products: np.ndarray
    _at: np.ndarray

    def of(self, block: Candidates) -> tuple[np.ndarray, np.ndarray]:
        """c⊥ᵀe⊥ (U + 1, k) and C⊥ᵀC⊥ (U + 1, k, k) of a block of one name."""
        name, curve = int(block[0, 0]), block[:, 1]
        at = self._at[curve[:, None], curve[None, :]]
        return self.pull[:, name, curve], self.products[:, at, name]


def unit_sums(sums: Sums, unit: np.ndarray, count: int) -> UnitSums:
    """Sums of each unit; `unit` (N,) is that of each record, and none has records of two recordings."""
    projection, family = sums.projection, sums.family
    L, Phi, fit = len(family.names), family.curves.shape[1], projection.found.fit
    q, p = fit.z.shape[1], len(projection.R)
    pairs = family.curve_pairs
    own_names = type(family)(family.names, family.curves, np.column_stack([np.arange(L)] * 2), pairs)
    pull, products = np.zeros((count + 1, L, Phi)), np.zeros((count + 1, len(pairs), L))
    alpha = np.linalg.solve(projection.R, sums.along.reshape(p, -1)).reshape(p, L, Phi).transpose(0, 2, 1)
    free_x = fit.x[: len(fit.at_bound)][~fit.at_bound] + projection.step
    a, b = pairs.T

    def add(k: int, pulled: np.ndarray, multiplied: np.ndarray) -> None:
        pull[k] += pulled.T
        products[k] += multiplied

    add(count, np.tensordot(free_x, alpha, axes=1), np.einsum("xal,xal->al", alpha[:, a], alpha[:, b]))
    for r, rows in groupby(family_rows(projection, sums.columns, own_names), key=lambda row: row[0].recording):
        totals: dict[int, tuple[Totals, np.ndarray]] = {}
        for row, now, before in rows:
            for k, part in _parts(unit, row):
                t, XX = totals.get(k) or (Totals(own_names, q + p + 1, projection.frame.correlated), np.zeros(()))
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
            both = np.einsum("xal,xbl->abl", gamma, t.crossed)[a, b] + np.einsum("xal,xbl->abl", left, gamma)[a, b]
            add(k, np.tensordot(lam, left, axes=1), t.in_both_orders - both)
        add(
            count,
            np.tensordot(fit.z[r] + step, gamma[:q], axes=1),
            np.einsum("xal,xal->al", gamma[:q][:, a], gamma[:q][:, b]),
        )
    at = np.full((Phi, Phi), -1)
    at[a, b] = np.arange(len(pairs))
    return UnitSums(pull, products, at)


def _parts(unit: np.ndarray, rows: Rows) -> list[tuple[int, slice]]:
    """Units among the rows, and where they are."""
    own = unit[rows.span]
    edges = [0, *(np.flatnonzero(np.diff(own)) + 1), len(own)]
    return [(int(own[a]), slice(int(a), int(b))) for a, b in pairwise(edges)]


def _cut(rows: Rows, part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return rows.A[part], rows.Z[part], rows.e[part]
