"""The residual of a fit off the space of all that may be missing, of a bounded number of records.

Columns of nuisance and candidates C = [Q, C⊥], each of unit length, span the space; with CᵀC = V Λ Vᵀ its orthonormal
basis is S = C V Λ^(−1/2), of which only sums (CᵀC and Cᵀe) and the rows of one chunk are ever held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.families import AT_ONCE, Scored
from enginediag_cli.mismatch.fit.projection import Projection, Rows

SAMPLED, STRETCH = 6000, 250
"""Records that are looked at, at most, and those of a stretch of neighbours: with more recorded, stretches are taken
evenly over all. 6,000 readings of a sensor give its σ to 1 %."""

DEPENDENT = 1e-8
"""Of the largest eigenvalue: a direction below it is a combination of the others."""


@dataclass(frozen=True)
class Unexplained:
    """By row (n,): what is left of the residual, the share 1 − h of it that is free, record and sensor."""

    left: np.ndarray
    free: np.ndarray
    record: np.ndarray
    sensor: np.ndarray


def unexplained(projection: Projection, blocks: Sequence[Scored], largest_share: float) -> Unexplained:
    """Of a fit, off the span of the nuisance and of the blocks' projected columns; where that is more than
    `largest_share` of the rows only its strongest directions count."""
    chosen = _chosen(len(projection.frame.keep))
    keep = projection.frame.keep & chosen[:, None]
    n = int(keep.sum())
    sample = _Sample(projection, blocks, chosen)
    G, pull = np.zeros((sample.width, sample.width)), np.zeros(sample.width)
    for rows, C in sample.chunks():
        G, pull = G + C.T @ C, pull + C.T @ projection.residual[rows].ravel()
    length = np.sqrt(np.diag(G))
    scale = np.where(length > 0, 1.0 / np.maximum(length, 1e-300), 0.0)
    values, vectors = np.linalg.eigh(G * np.outer(scale, scale))
    kept = np.flatnonzero(values > DEPENDENT * values[-1])[::-1][: int(largest_share * n)]
    V = (scale[:, None] * vectors[:, kept]) / np.sqrt(values[kept])
    along = V.T @ pull
    left, free = projection.residual.copy(), np.ones(keep.shape)
    for rows, C in sample.chunks():
        S = C @ V
        left[rows] -= (S @ along).reshape(left[rows].shape)
        free[rows] -= np.einsum("ij,ij->i", S, S).reshape(left[rows].shape)
    record, sensor = np.nonzero(keep)
    return Unexplained(left[keep], free[keep], record, sensor)


def _chosen(N: int) -> np.ndarray:
    """Records that are looked at, (N,) bool."""
    if N <= SAMPLED:
        return np.ones(N, bool)
    chosen = np.zeros(N, bool)
    for a in np.linspace(0, N - STRETCH, SAMPLED // STRETCH).astype(int):
        chosen[a : a + STRETCH] = True
    return chosen


class _Sample:
    """Columns of nuisance, offsets of the recordings and candidates, by chunks of the chosen records."""

    def __init__(self, projection: Projection, blocks: Sequence[Scored], chosen: np.ndarray):
        self.projection, self.chosen = projection, chosen
        self.families = list({id(b.sums): b.sums for b in blocks}.values())
        self.own = [
            np.concatenate([b.candidates for b in blocks if b.sums is sums]).reshape(-1, 2) for sums in self.families
        ]
        self.p, self.q = len(projection.R), projection.found.fit.z.shape[1]
        seen = np.unique(projection.found.problem.recording[chosen])
        self.place = {int(r): self.p + k * self.q for k, r in enumerate(seen)}
        self.first = self.p + len(seen) * self.q
        self.width = self.first + sum(map(len, self.own))

    def chunks(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Records (n,), and their columns (n·m, width)."""
        if not self.families:
            for rows in self.projection.stream():
                yield from self._pieces(rows, None, None)
            return
        for rows, own, before in self.families[0].columns.whitened(self.projection):
            yield from self._pieces(rows, own, before)

    def _pieces(
        self, rows: Rows, own: np.ndarray | None, before: np.ndarray | None
    ) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        here = np.flatnonzero(self.chosen[rows.span])
        for a in range(0, len(here), AT_ONCE):
            k = here[a : a + AT_ONCE]
            C = np.zeros((len(k), rows.A.shape[1], self.width))
            Q = np.linalg.solve(self.projection.R.T, rows.A[k].reshape(-1, self.p).T).T
            C[:, :, : self.p] = Q.reshape(len(k), -1, self.p)
            if self.q:
                C[:, :, self.place[rows.recording] : self.place[rows.recording] + self.q] = rows.Z[k]
            j, records = self.first, rows.span.start + k
            for sums, candidates in zip(self.families, self.own, strict=True):
                name, curve = candidates.T
                at = np.array([sums.columns.at[n] for n in sums.family.names])[name]
                part = C[:, :, j : j + len(name)]
                if own is not None:
                    part += own[k][:, :, at] * sums.family.curves[records][:, None, curve]
                if before is not None:
                    part -= before[k][:, :, at] * sums.family.curves[np.maximum(records - 1, 0)][:, None, curve]
                part -= (Q @ sums.along[:, name, curve]).reshape(part.shape)
                j += len(name)
            yield records, C.reshape(-1, self.width)
