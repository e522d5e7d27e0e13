"""Marginal likelihood and estimate of an amplitude that no column records.

The amplitudes of a location are a Gaussian process of variance τ² and correlation K in time. With g = CᵀPe and
G = CᵀPC the likelihood of the readings against "no such effect" is

    LR(τ²) = ½ [gᵀ M⁻¹ g − ln |I + τ²KG|]        M = (τ²K)⁻¹ + G        â = M⁻¹g        var(a) = diag M⁻¹

K is independent from record to record, or exponential, exp(−Δ/ℓ), within a recording: the covariance of a random
telegraph of mean dwell 2ℓ is the same. Its inverse is tridiagonal, so S = (τ²K)⁻¹ + T is, and M = S − BBᵀ is
solved through S and a matrix of the nuisance's size (Woodbury): the work grows as N, not N³.

Of the nuisance only that counts which the location can be taken for. S ⪰ T whatever K and τ, so that with
BᵀT⁻¹B = V diag(b²) Vᵀ a direction of V is worth less than −½ ln(1 − b²) in ln|M|: those of small b are left out, and
some dozens of hundreds stay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigh
from scipy.linalg.lapack import dpttrf, dpttrs

from enginediag_cli.mismatch.unrecorded.whitened_rows import Direction

SIGNAL = np.logspace(-1.0, 2.5, 15)
"""Grid of τ, in standard errors of one record's own estimate of its amplitude."""

GIVE_UP, DRAW_GIVES_UP = 10.0, 3.0
"""LR this far below its best on the way up the grid does not come back; nor does, of residuals in which nothing is
missing, one that has fallen so far."""

SLIGHT, NOTHING = 1e-3, 1e-7
"""b² up to which a direction of the nuisance counts as none, and what is added to T, over its largest, where a record
says nothing of its amplitude: less than (τ²K)⁻¹ ever adds."""


@dataclass(frozen=True)
class Kernel:
    """Correlation in time: exp(−Δ/length) within a recording; length 0: none."""

    name: str
    length: float

    def precision(self, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Diagonal (N,) and neighbours (N−1,) of K⁻¹, and ln|K|, of records so far apart (N,)."""
        n = len(gap)
        if self.length == 0.0:
            return np.ones(n), np.zeros(n - 1), 0.0
        phi = np.where(gap > 0, np.exp(-gap / self.length), 0.0)
        own = 1.0 / (1.0 - phi**2)
        diagonal = own.copy()
        diagonal[:-1] += phi[1:] ** 2 * own[1:]
        return diagonal, -phi[1:] * own[1:], float(np.log1p(-(phi**2)).sum())


KERNELS = (
    Kernel("independent", 0.0),
    Kernel("correlated over 8 records", 8.0),
    Kernel("switch with a mean dwell of 100 records", 50.0),
)


@dataclass(frozen=True)
class Likelihood:
    """Largest LR of D residuals (D,), never below 0, which is no effect at all; and of the first residual its LR at
    every point of the grids, (points,), with the best point's kernel and τ in the unit of SIGNAL, 0 where no τ is
    better than none, and the amplitude (N,) there with its standard error (N,), 0 without one."""

    best: np.ndarray
    first: np.ndarray
    kernel: Kernel
    signal: float
    amplitude: np.ndarray
    error: np.ndarray

    @property
    def evidence(self) -> float:
        """ln of the mean likelihood ratio over the grids, of the first residual: grid points that were not reached
        count as nothing."""
        total = len(KERNELS) * len(SIGNAL)
        top = float(self.first.max())
        return top + float(np.log(np.exp(self.first - top).sum() / total))


class Solver:
    """M of one location, kernel and τ."""

    def __init__(self, along: Direction, B: np.ndarray, kernel: Kernel, gap: np.ndarray, tau: float):
        diagonal, beside, log_K = kernel.precision(gap)
        self.d, self.e, info = dpttrf(diagonal / tau**2 + along.diagonal, beside / tau**2 + along.beside)
        if info:
            raise np.linalg.LinAlgError("the amplitudes' precision is not positive definite")
        self.full = diagonal / tau**2 + along.diagonal
        self.off = beside / tau**2 + along.beside
        self.B, self.X = B, self._banded(B)
        H = np.eye(B.shape[1]) - B.T @ self.X
        self.small = cho_factor((H + H.T) / 2 + 1e-12 * np.eye(len(H)), lower=True)
        self.log_determinant = float(
            np.log(self.d).sum() + 2.0 * np.log(np.diag(self.small[0])).sum() + log_K + 2.0 * len(gap) * np.log(tau)
        )

    def _banded(self, rhs: np.ndarray) -> np.ndarray:
        return np.asarray(dpttrs(self.d, self.e, rhs)[0])

    def quadratic(self, g: np.ndarray) -> np.ndarray:
        """gᵀM⁻¹g (D,) of g (N, D)."""
        h = self.X.T @ g
        own, shared = np.einsum("nd,nd->d", g, self._banded(g)), np.einsum("qd,qd->d", h, cho_solve(self.small, h))
        return np.asarray(own + shared)

    def amplitude(self, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """â (N,) and its standard errors (N,)."""
        a = self._banded(g[:, None])[:, 0]
        a = a + self.X @ cho_solve(self.small, self.X.T @ g)
        # diagonal of the inverse of a tridiagonal matrix from its factors from above and from below
        below = dpttrf(self.full[::-1], self.off[::-1])[0][::-1]
        L = np.tril(self.small[0])
        variance = 1.0 / (self.d + below - self.full) + (np.linalg.solve(L, self.X.T) ** 2).sum(axis=0)
        return a, np.sqrt(variance)


def taken_for(along: Direction) -> np.ndarray:
    """B (N, k) of the directions of the nuisance that the location can be taken for."""
    B = np.asfortranarray(along.B)
    if not B.shape[1]:
        return B
    d, e, info = dpttrf(along.diagonal + NOTHING * along.diagonal.max(), along.beside)
    if info:
        raise np.linalg.LinAlgError("the amplitudes' own precision is not positive definite")
    V = eigh(B.T @ dpttrs(d, e, B)[0], subset_by_value=(SLIGHT, np.inf), overwrite_a=True, check_finite=False)[1]
    return np.asfortranarray(B @ V)


def own_error(along: Direction) -> float:
    """Standard error of one record's own estimate of its amplitude, the median of the records that have one."""
    return float(np.median(along.diagonal[along.diagonal > 0]) ** -0.5)


def likelihood(
    along: Direction,
    gap: np.ndarray,
    g: np.ndarray,
    believed: float = np.inf,
    kernels: Sequence[Kernel] = KERNELS,
) -> Likelihood:
    """Largest LR over kernels and τ of residuals gathered at the location, g = CᵀPe (N, D), less what it costs that τ
    is large beside what is `believed`, ½ (τ/believed)². All but the first residual are draws with nothing missing."""
    g = np.asfortranarray(g)
    best, first, top = np.zeros(g.shape[1]), [0.0], (kernels[0], 0.0)
    B, scale = taken_for(along), own_error(along)
    gives_up = np.full(g.shape[1], DRAW_GIVES_UP)
    gives_up[0] = GIVE_UP
    for kernel in kernels:
        own, climbing, rising = np.zeros(g.shape[1]), np.arange(g.shape[1]), g
        for signal in SIGNAL:
            solver = Solver(along, B, kernel, gap, signal * scale)
            lr = 0.5 * (solver.quadratic(rising) - solver.log_determinant) - 0.5 * (signal * scale / believed) ** 2
            if climbing[0] == 0:
                if lr[0] > max(best[0], own[0]):
                    top = kernel, float(signal)
                first.append(float(lr[0]))
            own[climbing] = np.maximum(own[climbing], lr)
            # of hundreds of draws with nothing missing few climb as far as what is there
            on = lr >= own[climbing] - gives_up[climbing]
            if not on.all():
                climbing, rising = climbing[on], np.asfortranarray(rising[:, on])
            if not climbing.size:
                break
        best = np.maximum(best, own)
    kernel, found = top
    a, error = np.zeros(len(g)), np.zeros(len(g))
    if found > 0.0:
        a, error = Solver(along, B, kernel, gap, found * scale).amplitude(g[:, 0])
    return Likelihood(best, np.array(first[1:] or first), kernel, found, a, error)
