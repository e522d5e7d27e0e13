"""What any curve over the records says at one place, from vectors of each record that are summed once.

A curve f (N,) at a place with the whitened derivatives d_n is the column c = Σ_n f_n d_n (d_n reaches into the next
record where noise is correlated in time). Freed of the nuisance A = QR and of the recordings' offsets A_r = Q_r R_r,

    c⊥ᵀe = Σ_n f_n r_n        c⊥ᵀc'⊥ = fᵀ T f' − (Wf)ᵀ(Wf') − Σ_r (W_r f)ᵀ(W_r f')

with T tridiagonal, t_n = d_nᵀd_n and u_n = d_nᵀd_n+1, and the columns of W and W_r Qᵀd_n and Q_rᵀd_n: some dozens of
numbers a record, so that thousands of curves cost two products of matrices. `families.Sums` has the same numbers of
curves that are known beforehand, and needs a pass over the records for each family of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.columns import Columns
from enginediag_cli.mismatch.fit.families import family_rows, grid
from enginediag_cli.mismatch.fit.projection import Projection


@dataclass(frozen=True)
class AnyCurve:
    """By record: `pull` r (N,), `squares` t (N,), `next_to` u (N,) of a record and the next (0 at the end of a
    recording), `along` w (N, p), `own` w_r (N, q); `starts` (R,): first record of each recording."""

    pull: np.ndarray
    squares: np.ndarray
    next_to: np.ndarray
    along: np.ndarray
    own: np.ndarray
    starts: np.ndarray

    @staticmethod
    def at(projection: Projection, columns: Columns, name: str) -> AnyCurve:
        """At the parameter `name`, which `columns` has."""
        N, q, p = len(projection.found.problem.recording), projection.found.fit.z.shape[1], len(projection.R)
        family = grid([name], np.ones((N, 1)), [[0]])
        crossed, squares, next_to = np.zeros((N, q + p + 1)), np.zeros(N), np.zeros(N)
        for rows, now, before in family_rows(projection, columns, family):
            X, d, n = rows.stacked, now[:, :, 0], rows.span
            crossed[n] += np.einsum("nmk,nm->nk", X, d)
            squares[n] += np.sum(d**2, axis=1)
            if before is not None:
                b = before[:, :, 0]
                # the first record of all has none before it: its share is 0
                last = np.maximum(np.arange(n.start, n.stop) - 1, 0)
                np.add.at(crossed, last, -np.einsum("nmk,nm->nk", X, b))
                np.add.at(squares, last, np.sum(b**2, axis=1))
                np.add.at(next_to, last, -np.sum(d * b, axis=1))
        recording = projection.found.problem.recording
        starts = np.flatnonzero(np.diff(recording, prepend=recording[0] - 1))
        own, A, e = crossed[:, :q], crossed[:, q : q + p], crossed[:, -1]
        for r, start, stop in zip(recording[starts], starts, [*starts[1:], N], strict=True):
            if q:
                offsets = projection.offsets[r]
                own[start:stop] = np.linalg.solve(offsets.R.T, own[start:stop].T).T
                A[start:stop] -= own[start:stop] @ offsets.along
                e[start:stop] -= own[start:stop] @ offsets.pull
        along = np.linalg.solve(projection.R.T, A.T).T
        return AnyCurve(e - along @ projection.pull, squares, next_to, along, own, starts)

    def pulls(self, curves: np.ndarray) -> np.ndarray:
        """c⊥ᵀe (…) of curves (N, …)."""
        return np.tensordot(self.pull, curves, axes=1)

    def grams(self, curves: np.ndarray) -> np.ndarray:
        """C⊥ᵀC⊥ (K, k, k) of K sets of k curves (N, K, k)."""
        F = curves.transpose(1, 0, 2)
        touched = self.squares[:, None] * F
        touched[:, :-1] += self.next_to[:-1, None] * F[:, 1:]
        touched[:, 1:] += self.next_to[:-1, None] * F[:, :-1]
        w = np.tensordot(self.along.T, curves, axes=1).transpose(1, 0, 2)
        G = F.transpose(0, 2, 1) @ touched - w.transpose(0, 2, 1) @ w
        for k in range(self.own.shape[1]):
            v = np.add.reduceat(self.own[:, k, None, None] * curves, self.starts, axis=0).transpose(1, 0, 2)
            G -= v.transpose(0, 2, 1) @ v
        return np.asarray((G + G.transpose(0, 2, 1)) / 2)

    def apart(self, f: np.ndarray, g: np.ndarray) -> float:
        """The non-centrality at which two curves (N,) could be told apart here."""
        return float(self.grams((f - g)[:, None, None])[0, 0, 0])
