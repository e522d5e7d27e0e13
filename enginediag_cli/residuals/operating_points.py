"""What an error that differs from operating point to operating point leaves in the statistics of a window.

An error δ_c ~ N(0, diag v) of k of the parameters at operating point c, independent of that at any other, adds to s

    Σ_c F_c δ_c        of covariance        M = Σ_q v_q Q_q,    Q_q = Σ_c f_cq f_cqᵀ,

F_c being the information of the records at point c and f_cq its column of parameter q. With nuisance of covariance C
counted as noise, s becomes (1 + F C)⁻¹ s, and M with it. In units of a change of the parameters that is F⁺ M F⁺.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.repeated_points import cells_of
from enginediag_cli.residuals.excitation import range_space
from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.root import root_of
from enginediag_cli.residuals.statistics import LocalStatistics


def sums_by_point(
    predicted: np.ndarray, e: np.ndarray, J: np.ndarray, noise: NoiseModel, columns: np.ndarray
) -> np.ndarray:
    """Q (k, p, p) for the parameters at `columns` (k,), from predictions and residuals (N, m) and sensitivities
    (N, m, p); records without a residual are at no point."""
    _, G = whiten(e, J, noise)
    there = np.isfinite(e).any(axis=1) & np.isfinite(predicted).all(axis=1)
    p = G.shape[2]
    found = np.zeros((len(columns), p, p))
    if not there.any():
        return found
    G, cell = G[there], cells_of(predicted[there])
    order = np.argsort(cell, kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cell[order])) + 1):
        flat = G[rows].reshape(-1, p)
        f = flat.T @ flat[:, columns]
        found += f.T[:, :, None] * f.T[:, None, :]
    return found


def covariance_of_change(
    statistics: LocalStatistics, kept: LocalStatistics, uncertainty: np.ndarray, variance: np.ndarray
) -> np.ndarray:
    """F⁺ M F⁺ (a, a) of the parameters of `kept`, which `statistics` become with `uncertainty` (p, p) as noise.

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
    inverse = (space.basis / space.eigenvalues) @ space.basis.T
    half = inverse @ through
    found = half @ M @ half.T
    return np.asarray(kept.prior_sigma[:, None] * (found + found.T) / 2 * kept.prior_sigma)
