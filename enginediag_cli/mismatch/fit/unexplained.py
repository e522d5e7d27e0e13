"""The residual of a fit off the space of all that may be missing, of a bounded number of records.

Columns of nuisance and candidates C = [Q, C⊥], each of unit length, span the space; of CᵀC = LLᵀ, by the strongest
column first (Cholesky with pivots), those that the ones before them leave something of are its basis, S = CB with
B = L⁻ᵀ. Where it may take no more than a share of the rows it is of the strongest directions: of CᵀC = V Λ Vᵀ,
B = V Λ^(−1/2). Only sums (CᵀC and Cᵀe) and the rows of one chunk are ever held. The share of its readings that the
space takes of a sensor is a sum over the rows of S, or of many rows is drawn, which needs the same sums:

    Σ_{rows of s} h_ii = tr(P_s H) = E[zᵀP_s H P_s z] = E[|BᵀCᵀP_s z|²]      z of random signs, H = SSᵀ

Source: M. F. Hutchinson, "A Stochastic Estimator of the Trace of the Influence Matrix for Laplacian Smoothing
Splines", Commun. Stat. Simul. Comput. 19 (1990) 433–450.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, solve_triangular
from scipy.linalg.lapack import dpstrf

from enginediag_cli.mismatch.fit.families import AT_ONCE, Scored, Sums
from enginediag_cli.mismatch.fit.projection import Projection, Rows

SAMPLED, STRETCH = 3000, 250
"""Records that are looked at, at most, and those of a stretch of neighbours: with more recorded, stretches are taken
evenly over all. 3,000 readings of a sensor give its σ to 1.3 %."""

DEPENDENT = 1e-6
"""Of its squared length: a column of which less is left beside others is a combination of them. With 1e-8 the
model's curvature makes directions of its own, which take up what is missing: noise comes out some per cent too
small."""

DRAWN, SIGNS = 6000, 16
"""Rows from which on the share is drawn, and draws of z: a sensor of 700 readings, of which the space takes 100, is
told it to 4 %, which is 0.6 % of its σ²."""


@dataclass(frozen=True)
class Unexplained:
    """By row (n,): what is left of the residual, record and sensor; by sensor (m,): the share of its readings that is
    free, 1 − h on average."""

    left: np.ndarray
    free: np.ndarray
    record: np.ndarray
    sensor: np.ndarray


def unexplained(projection: Projection, blocks: Sequence[Scored], largest_share: float) -> Unexplained:
    """Of a fit, off the span of the nuisance and of the blocks' projected columns; where that is more than
    `largest_share` of the rows only its strongest directions count."""
    chosen = _chosen(len(projection.frame.keep))
    keep = projection.frame.keep & chosen[:, None]
    n, m = int(keep.sum()), keep.shape[1]
    rng = np.random.default_rng((projection.found.evidence.settings.seed, n))
    signs = rng.choice((-1.0, 1.0), (len(chosen), SIGNS)) if n >= DRAWN else None
    sample = _Sample(projection, blocks, chosen)
    G, pull, signed = np.zeros((sample.width,) * 2), np.zeros(sample.width), np.zeros((m, sample.width, SIGNS))
    for rows, C in sample.chunks():
        G += C.T @ C
        pull += C.T @ projection.residual[rows].ravel()
        if signs is not None:
            signed += C.reshape(len(rows), m, -1).transpose(1, 2, 0) @ signs[rows]
    B = _basis(G, int(largest_share * n))
    along = B @ (B.T @ pull)
    left = projection.residual.copy()
    for rows, found in sample.combined(along):
        left[rows] -= found
    if signs is not None:
        taken = ((B.T @ signed) ** 2).sum(axis=(1, 2)) / SIGNS
    else:
        taken = sum(((C @ B).reshape(len(rows), m, -1) ** 2).sum(axis=(0, 2)) for rows, C in sample.chunks())
    record, sensor = np.nonzero(keep)
    return Unexplained(left[keep], 1.0 - taken / np.maximum(keep.sum(axis=0), 1), record, sensor)


def _basis(G: np.ndarray, most: int) -> np.ndarray:
    """B (width, k) of at most so many directions, from CᵀC."""
    length = np.sqrt(np.diag(G))
    scale = np.where(length > 0, 1.0 / np.maximum(length, 1e-300), 0.0)
    unit = G * np.outer(scale, scale)
    L, order, rank, _ = dpstrf(unit, tol=DEPENDENT, lower=1)
    if rank > most:
        values, vectors = eigh(unit, subset_by_index=(len(G) - most, len(G) - 1))
        return np.asarray(scale[:, None] * vectors / np.sqrt(values))
    B = np.zeros((len(G), int(rank)))
    B[order[:rank] - 1] = solve_triangular(L[:rank, :rank], np.eye(rank), lower=True, trans=1)
    return scale[:, None] * B


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
        for rows, own, before in self._rows():
            yield from self._pieces(rows, own, before)

    def combined(self, along: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Records (n,), and the sum (n, m) of their columns times `along` (width,)."""
        amounts, x, j = [], along[: self.p].copy(), self.first
        for sums, own in zip(self.families, self.own, strict=True):
            W = np.zeros((len(self.families[0].columns.at), sums.family.curves.shape[1]))
            np.add.at(W, (self._columns(sums)[own[:, 0]], own[:, 1]), along[j : j + len(own)])
            amounts.append((sums.family.curves, W))
            x -= sums.along[:, own[:, 0], own[:, 1]] @ along[j : j + len(own)]
            j += len(own)
        x = np.linalg.solve(self.projection.R, x)
        for rows, now, before in self._rows():
            k = np.flatnonzero(self.chosen[rows.span])
            records = rows.span.start + k
            found = rows.A[k] @ x
            if self.q:
                found += rows.Z[k] @ along[self.place[rows.recording] :][: self.q]
            for part, at, sign in ((now, records, 1.0), (before, np.maximum(records - 1, 0), -1.0)):
                if part is not None and amounts:
                    driven = sum(curves[at] @ W.T for curves, W in amounts)
                    found += sign * np.einsum("nml,nl->nm", part[k], driven)
            yield records, found

    def _rows(self) -> Iterator[tuple[Rows, np.ndarray | None, np.ndarray | None]]:
        if self.families:
            yield from self.families[0].columns.whitened(self.projection)
        else:
            yield from ((rows, None, None) for rows in self.projection.stream())

    def _columns(self, sums: Sums) -> np.ndarray:
        """Of a family's names, their places among the columns."""
        return np.array([sums.columns.at[n] for n in sums.family.names])

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
                at = self._columns(sums)[name]
                part = C[:, :, j : j + len(name)]
                if own is not None:
                    part += own[k][:, :, at] * sums.family.curves[records][:, None, curve]
                if before is not None:
                    part -= before[k][:, :, at] * sums.family.curves[np.maximum(records - 1, 0)][:, None, curve]
                part -= (Q @ sums.along[:, name, curve]).reshape(part.shape)
                j += len(name)
            yield records, C.reshape(-1, self.width)
