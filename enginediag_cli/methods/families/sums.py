"""What a window tells of the parameters, for many windows at once: z·z, s = Gᵀz and F = GᵀG.

z ~ N(G Δθ, 1) are whitened residuals. Everything uncertain about θ0 and the sensors, of covariance C = L Lᵀ,
makes their covariance 1 + G C Gᵀ, whose inverse 1 − G L A⁻¹ Lᵀ Gᵀ, A = 1 + Lᵀ F L (Woodbury), needs only sums.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.methods.families.whitening import white_residuals
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.excitation import RANK_TOLERANCE
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.root import root_of

BLIND = 1e-6
"""Share of a parameter's direction in what the window does not excite, beyond which the window does not determine it:
well above rounding, well below any share that matters."""


@dataclass(frozen=True)
class WindowSums:
    """zz (W,), s (W, p), F (W, p, p) and `dof` (W,), the number of independent residuals."""

    zz: np.ndarray
    s: np.ndarray
    F: np.ndarray
    dof: np.ndarray

    def with_uncertainty(self, C: np.ndarray, keep: int) -> WindowSums:
        """The sums of the first `keep` parameters, with the covariance C (p, p) counted as noise."""
        if np.any(C):
            spread = np.sqrt(np.diag(C))
            L = root_of(C, np.where(spread > 0, spread, 1.0))
            A = np.eye(L.shape[1]) + L.T @ self.F @ L
            Ls, LF = self.s @ L, L.T @ self.F
            inner = np.linalg.solve(A, np.concatenate([Ls[:, :, None], LF], axis=2))
            zz = self.zz - np.einsum("wi,wi->w", Ls, inner[:, :, 0])
            s = self.s - np.einsum("wip,wi->wp", LF, inner[:, :, 0])
            F = self.F - np.swapaxes(LF, 1, 2) @ inner[:, :, 1:]
        else:
            zz, s, F = self.zz, self.s, self.F
        return WindowSums(zz, s[:, :keep], F[:, :keep, :keep], self.dof)


@dataclass(frozen=True)
class WaldStatistics:
    """Estimate Δθ̂ = F⁺s (W, p) with variance diag(F⁺), infinite where the window does not determine it.

    wald (W, p) = Δθ̂²/variance ~ χ²(1), zero where undetermined; joint (W,) = sᵀF⁺s ~ χ²(rank (W,)).
    """

    estimate: np.ndarray
    variance: np.ndarray
    wald: np.ndarray
    joint: np.ndarray
    rank: np.ndarray


def window_sums(e: np.ndarray, J: np.ndarray, monitor: Monitor) -> WindowSums:
    """Sums over the records of e (W, n, m), NaN where missing, and J (W, n, m, p)."""
    z, G, present = white_residuals(e, J, monitor.noise)
    W, p = len(z), G.shape[3]
    z, G = z.reshape(W, -1), G.reshape(W, -1, p)
    G_t = np.swapaxes(G, 1, 2)
    return WindowSums(
        np.sum(z**2, axis=1), (G_t @ z[:, :, None])[:, :, 0], G_t @ G, present.sum(axis=(1, 2)).astype(float)
    )


def nominal_residuals(monitor: Monitor, windows: Windows) -> tuple[np.ndarray, np.ndarray]:
    """e = Y − Φ(U, θ0) (W, n, m), eq. (4), NaN where a reading or the model fails, and J (W, n, m, p)."""
    y, J, ok, _ = monitor.predict(windows.flat_inputs(), monitor.theta0)
    shape = windows.y.shape
    predicted = np.where(ok[:, None], y, np.nan).reshape(shape)
    return windows.y - predicted, J.reshape(*shape, -1)


def wald_statistics(s: np.ndarray, F: np.ndarray, scale: np.ndarray) -> WaldStatistics:
    """Joint and single Wald tests of s (W, p), F (W, p, p), parameters in units of `scale` (p,)."""
    eigenvalues, U = np.linalg.eigh(scale[:, None] * F * scale)
    floor = RANK_TOLERANCE * np.maximum(eigenvalues[:, -1:], 0.0)
    kept = eigenvalues > floor
    inverse = np.where(kept, 1 / np.where(kept, eigenvalues, 1.0), 0.0)
    v = np.einsum("wpi,wp->wi", U, scale * s)
    estimate = np.einsum("wpi,wi->wp", U, inverse * v)
    variance = np.einsum("wpi,wi->wp", U**2, inverse)
    blind = np.einsum("wpi,wi->wp", U**2, (~kept).astype(float)) > BLIND
    variance = np.where(blind, np.inf, variance)
    wald = np.where(blind | (variance == 0), 0.0, estimate**2 / np.where(variance > 0, variance, 1.0))
    return WaldStatistics(estimate * scale, variance * scale**2, wald, np.sum(inverse * v**2, axis=1), kept.sum(axis=1))


def holm(p_values: np.ndarray, false_alarm: float) -> np.ndarray:
    """Rejected by Holm's step-down procedure (W, q) for p values (W, q), W families of q hypotheses."""
    order = np.argsort(p_values, axis=1, kind="stable")
    q = p_values.shape[1]
    steps = np.take_along_axis(p_values, order, 1) * (q - np.arange(q))
    accepted = np.logical_and.accumulate(steps <= false_alarm, axis=1)
    rejected = np.zeros_like(accepted)
    np.put_along_axis(rejected, order, accepted, 1)
    return rejected
