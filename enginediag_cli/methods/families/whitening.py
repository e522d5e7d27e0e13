"""Residuals and sensitivities in units of independent noise, also where noise is correlated in time.

AR(1) noise, cov(e_k, e_l) = σ² ρ^|k−l|, becomes white by differencing with the last reading of the same sensor,

    z_k = (e_k − ρ^g e_{k−g}) / (σ √(1 − ρ^2g)),        g = records since that reading,

and the sensitivities likewise (generalised least squares; Bryson, A. E. and Henrikson, L. J. (1968) J.
Spacecraft and Rockets 5, 662–665, for filters).
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.residuals.local import whiten
from enginediag_cli.residuals.noise import NoiseModel


def white_residuals(e: np.ndarray, J: np.ndarray, noise: NoiseModel) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z (W, n, m), G (W, n, m, p) of unit white noise, zero where missing, and what is present (W, n, m).

    e (W, n, m), NaN where missing; J (W, n, m, p); records of a window are one step apart.
    """
    W, n, m, p = J.shape
    present = np.isfinite(e) & np.all(np.isfinite(J), axis=3)
    if noise.white:
        z, G = whiten(e.reshape(-1, m), J.reshape(-1, m, p), noise)
        return z.reshape(W, n, m), G.reshape(W, n, m, p), present
    z = np.where(present, e, 0.0) / noise.sigma
    G = np.where(present[..., None], J, 0.0) / noise.sigma[:, None]
    if not n:
        return z, G, present
    here = np.where(present, np.arange(n)[:, None], -1)
    last = np.maximum.accumulate(here, axis=1)
    before = np.concatenate([np.full((W, 1, m), -1), last[:, :-1]], axis=1)
    gap = np.arange(n)[:, None] - before
    c = np.where(present & (before >= 0), noise.rho**gap, 0.0)
    source = np.maximum(before, 0)
    scale = 1 / np.sqrt(1 - c**2)
    z = (z - c * np.take_along_axis(z, source, 1)) * scale
    G = (G - c[..., None] * np.take_along_axis(G, source[..., None], 1)) * scale[..., None]
    return z, G, present
