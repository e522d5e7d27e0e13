"""Whitened rows of a fit with the nuisance out of the way, and what a per-record amplitude does to them.

An amplitude a_k at a location moves the readings of record k by a_k c_k, c_k the derivative of the readings with
respect to the location's parameter. In whitened rows, where noise correlated in time has been differenced, it
moves row k+1 as well:

    row k:  own_k a_k + before_k a_{k−1}     own = c/(σ√(1−ρ_k²))     before_k = −ρ_k c_{k−1}/(σ√(1−ρ_k²))

So CᵀC = T is tridiagonal (diagonal where ρ = 0), and with the nuisance Q projected out G = CᵀPC = T − BᵀB, B = QᵀC
of as many rows as there are nuisance columns: nothing of size N × N is ever formed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.mismatch.fit.projection import DenseRows, Frame, Projection
from enginediag_cli.mismatch.unrecorded.aircraft import Grid, grid_of

AT_ONCE = 512
"""Records whose draws are projected at once: a few MB."""


@dataclass(frozen=True)
class Basis:
    """Nuisance of N records of m sensors in `rows` (N, m, q), 0 where there is no reading. Where engines of one
    aircraft fly together, N are the rows of their `grid` and m the sensors of all of them.

    `e` (N, m): whitened residual before projection, `left` (N, m) after it; `objective`: χ² of readings and priors
    without any effect; `pull` (q,) = Qᵀe over readings and priors; `prior_rows` (q, q): Q's rows of the priors;
    `gap` (N,): time since the last record of the same recording, in usual steps, 0 at the first of a recording.
    """

    frame: Frame
    rows: np.ndarray
    e: np.ndarray
    left: np.ndarray
    objective: float
    pull: np.ndarray
    prior_rows: np.ndarray
    gap: np.ndarray
    grid: Grid | None = None

    def of_records(self, values: np.ndarray) -> np.ndarray:
        """Values (…, N) of rows for the records of the fit."""
        return values if self.grid is None else np.asarray(values[..., self.grid.at])

    def of_rows(self, values: np.ndarray) -> np.ndarray:
        """Values (records,) of records, which are one for all engines of an aircraft, for the rows (N,)."""
        return values if self.grid is None else self.grid.folded(values)

    def noise(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Projected residuals (N, m, count) of draws in which nothing is missing."""
        keep = self.frame.keep if self.grid is None else self.grid.laid(self.frame.keep)
        readings = rng.standard_normal((*self.e.shape, count))
        readings *= keep[:, :, None]
        priors = rng.standard_normal((len(self.pull), count))
        q = len(self.pull)
        pull = self.rows.reshape(-1, q).T @ readings.reshape(-1, count) + self.prior_rows.T @ priors
        for a in range(0, len(readings), AT_ONCE):  # in place: there are hundreds of draws of every reading
            rows = self.rows[a : a + AT_ONCE]
            readings[a : a + AT_ONCE] -= (rows.reshape(-1, q) @ pull).reshape(*rows.shape[:2], count)
        return readings


def basis(projection: Projection) -> Basis:
    """The projection's nuisance and residual."""
    return _basis(projection, DenseRows(projection))


def basis_without(projection: Projection, name: str, signal: np.ndarray) -> Basis:
    """The same with one parameter no longer nuisance, and its part of the prediction, `signal` (N, m) in whitened
    rows, given back to the residual."""
    j, dense = projection.names.index(name), DenseRows(projection)
    dense.e += signal
    if projection.free[j]:
        dense.free(int(np.cumsum(projection.free)[j]) - 1)
    return _basis(projection, dense)


def _basis(projection: Projection, dense: DenseRows) -> Basis:
    rows, e, q = dense.rows, dense.e, dense.rows.shape[2]
    pull = rows.reshape(-1, q).T @ e.ravel() + dense.priors.T @ dense.e_priors
    left = e - (rows.reshape(-1, q) @ pull).reshape(e.shape)
    objective = float((e**2).sum() + dense.e_priors @ dense.e_priors - pull @ pull)
    grid = grid_of(projection.found)
    gap = projection.frame.neighbours.gap
    if grid is not None:
        rows, e, left, gap = grid.laid(rows), grid.laid(e), grid.laid(left), grid.gap
    return Basis(projection.frame, rows, e, left, objective, pull, dense.priors, gap, grid)


@dataclass(frozen=True)
class Direction:
    """What an amplitude at a location does: `own` and `before` (N, m) as above, T by `diagonal` (N,) and `beside`
    (N−1,). `rows` (N, m, q), the nuisance of all of them, is held once: what it is along each of dozens of locations is
    quicker multiplied again than kept."""

    own: np.ndarray
    before: np.ndarray
    diagonal: np.ndarray
    beside: np.ndarray
    rows: np.ndarray

    @property
    def own_rows(self) -> np.ndarray:
        """(N, q): the nuisance along `own`."""
        return np.asarray(np.matmul(self.own[:, None, :], self.rows)[:, 0])

    @property
    def before_rows(self) -> np.ndarray:
        """(N, q): the nuisance along `before`."""
        return np.asarray(np.matmul(self.before[:, None, :], self.rows)[:, 0])

    @property
    def B(self) -> np.ndarray:
        """(N, q): QᵀC, transposed."""
        return joined(self.own_rows, self.before_rows) if self.before.any() else self.own_rows

    def applied(self, amplitude: np.ndarray) -> np.ndarray:
        """Whitened rows (N, m) that an amplitude (N,) makes."""
        last = np.concatenate([[0.0], amplitude[:-1]])
        return self.own * amplitude[:, None] + self.before * last[:, None]

    def gathered(self, rows: np.ndarray) -> np.ndarray:
        """Cᵀ rows: (N, …) of rows (N, m, …)."""
        found = np.einsum("nm,nm...->n...", self.own, rows)
        if self.before.any():
            found[:-1] += np.einsum("nm,nm...->n...", self.before[1:], rows[1:])
        return np.asarray(found)


def joined(own: np.ndarray, before: np.ndarray) -> np.ndarray:
    """(N, …): of each amplitude, what it does in its own record and in the next one."""
    found = own.copy()
    found[:-1] += before[1:]
    return found


def direction(of: Basis, column: np.ndarray) -> Direction:
    """Of a location whose derivative of the readings is `column` (N, m), in the readings' units."""
    own, before = _whitened(of.frame, column, slice(None))
    if of.grid is not None:
        own, before = of.grid.laid(own), of.grid.laid(before)
        before[0] = 0.0
    return _direction(own, before, of.rows)


def direction_alone(frame: Frame, column: np.ndarray, rows: slice) -> Direction:
    """Of the records `rows`, a whole recording, as if no nuisance could be taken for it; `column` (n, m) is theirs."""
    own, before = _whitened(frame, column, rows)
    return _direction(own, before, np.zeros((*own.shape, 0)))


def _whitened(frame: Frame, column: np.ndarray, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    """`own` and `before` (n, m) of a derivative (n, m)."""
    scaled = frame.scaled(column[:, :, None], rows)[:, :, 0]
    rho = frame.correlation(rows)
    root = np.sqrt(1.0 - rho**2)
    before = np.zeros_like(scaled)
    before[1:] = -rho[1:] * scaled[:-1] / root[1:]
    return scaled / root, before


def _direction(own: np.ndarray, before: np.ndarray, rows: np.ndarray) -> Direction:
    diagonal, beside = (own**2).sum(axis=1), (before[1:] * own[1:]).sum(axis=1)
    diagonal[:-1] += (before[1:] ** 2).sum(axis=1)
    return Direction(own, before, diagonal, beside, rows)
