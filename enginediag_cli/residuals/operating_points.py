"""What an error that differs from operating point to operating point leaves in the statistics of a window.

An error δ_c ~ N(0, diag v) of k of the parameters at operating point c, independent of that at any other, adds to s

    Σ_c F_c δ_c        of covariance        M = Σ_q v_q Q_q,    Q_q = Σ_c f_cq f_cqᵀ,

F_c being the information of the records at point c and f_cq its column of parameter q. With nuisance of covariance C
counted as noise, s becomes (1 + F C)⁻¹ s, and M with it. In units of a change of the parameters that is

    (F + S⁻²)⁻¹ M (F + S⁻²)⁻¹,     S = diag(prior_sigma):

in directions of which records tell less than is known beforehand, such as a bias and a scale of one instrument against
each other, F⁺ M F⁺ would be huge changes that cancel at the point where F was computed, and nowhere else.
"""

from __future__ import annotations

from copy import copy

import numpy as np

from enginediag_cli.identification.repeated_points import Cells
from enginediag_cli.residuals.excitation import range_space
from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.statistics import LocalStatistics


class PointSums:
    """f_cq of the parameters at `columns` (k,), record by record, in operating points that `laid_by` (N, m) tells
    apart: predictions of all of the records, or of some that lie everywhere among them."""

    def __init__(self, noise: NoiseModel, columns: np.ndarray, laid_by: np.ndarray):
        self._noise, self._columns = noise, columns
        computed = laid_by[np.isfinite(laid_by).all(axis=1)]
        self._cells = Cells(computed) if len(computed) else None
        self._sums: dict[tuple[int, ...], np.ndarray] = {}

    def empty(self) -> PointSums:
        """The same points without a record."""
        other = copy(self)
        other._sums = {}
        return other

    def add(self, predicted: np.ndarray, e: np.ndarray, J: np.ndarray) -> None:
        """Records with predictions and residuals (N, m) and sensitivities (N, m, p); those without a residual are at no
        point."""
        there = np.isfinite(e).any(axis=1) & np.isfinite(predicted).all(axis=1)
        if self._cells is None or not there.any():
            return
        _, G = whiten(e[there], J[there], self._noise)
        places, cell = np.unique(self._cells.places(predicted[there]), axis=0, return_inverse=True)
        order = np.argsort(cell.reshape(-1), kind="stable")
        groups = np.split(order, np.cumsum(np.bincount(cell.reshape(-1)))[:-1])
        for place, rows in zip(places.tolist(), groups, strict=True):
            flat = G[rows].reshape(-1, G.shape[2])
            self._sums[tuple(place)] = self._sums.get(tuple(place), 0.0) + flat.T @ flat[:, self._columns]

    def squared(self, p: int) -> np.ndarray:
        """Q (k, p, p)."""
        found = np.zeros((len(self._columns), p, p))
        for f in self._sums.values():
            found += f.T[:, :, None] * f.T[:, None, :]
        return found


def sums_by_point(
    predicted: np.ndarray, e: np.ndarray, J: np.ndarray, noise: NoiseModel, columns: np.ndarray
) -> np.ndarray:
    """Q (k, p, p) for the parameters at `columns` (k,), from predictions and residuals (N, m) and sensitivities
    (N, m, p)."""
    there = np.isfinite(e).any(axis=1)
    sums = PointSums(noise, columns, predicted[there])
    sums.add(predicted, e, J)
    return sums.squared(J.shape[2])


def covariance_of_change(
    statistics: LocalStatistics, kept: LocalStatistics, uncertainty: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """(F + S⁻²)⁻¹ M (F + S⁻²)⁻¹ (a, a) of the parameters of `kept`, which `statistics` become with `uncertainty` (p, p)
    as noise.

    variance (k,): of the error of each parameter at one point, in the order of `statistics.points`.
    """
    assert statistics.points is not None
    D = statistics.prior_sigma  # units apart by 10⁸ would drown the small eigenvalues in rounding
    root = root_of(uncertainty, D) / D[:, None]
    F = D[:, None] * statistics.F * D
    inner = np.eye(root.shape[1]) + root.T @ F @ root
    through = np.eye(len(D)) - F @ root @ np.linalg.solve(inner, root.T)
    through = through[statistics.indices(kept.parameters)]
    M = D[:, None] * np.einsum("q,qij->ij", variance, statistics.points) * D
    space = range_space(kept.F, kept.prior_sigma)
    inverse = (space.basis / (space.eigenvalues + 1.0)) @ space.basis.T
    half = inverse @ through
    found = half @ M @ half.T
    return np.asarray(kept.prior_sigma[:, None] * (found + found.T) / 2 * kept.prior_sigma)
