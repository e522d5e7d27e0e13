"""Unscented Kalman filter: the engine asked at 2p + 1 points around the estimate instead of linearised.

Scaled transform, λ = α²(p + κ) − p, points x and x ± columns of √((p + λ) P), weights

    w_0^mean = λ/(p + λ),   w_0^cov = w_0^mean + 1 − α² + β,   w_i = 1/(2(p + λ)).

All points of all windows go to the engine in one call per record. Julier, S. J. and Uhlmann, J. K. (2004) Proc.
IEEE 92, 401–422; Wan, E. A. and van der Merwe, R. (2000) Proc. IEEE AS-SPCC, 153–158.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.config.fields import Field
from enginediag_cli.methods.families.observer import OBSERVER_OPTIONS, Earlier, Linearisation, Observer, ScaledModel

JITTER = 1e-12
"""Added to the diagonal of P (in prior variances) for its square root, where a constant state is certain."""


@dataclass(frozen=True)
class UnscentedKalman(Observer):
    """Observer by sigma points; `alpha`, `beta`, `kappa` as in the scaled transform.

    A small alpha divides differences of the engine's outputs by a small number; 1 keeps them well above its
    solver's tolerance.
    """

    HELP: ClassVar[str] = "Kalman filter with the parameters as states, by sigma points of the engine"
    OPTIONS: ClassVar[tuple[Field, ...]] = (
        *OBSERVER_OPTIONS,
        Field("alpha", "number", "reach of the sigma points", 1.0, minimum=1e-3),
        Field("beta", "number", "weight of the centre in covariances", 2.0),
        Field("kappa", "number", "further reach of the sigma points", 0.0),
    )
    alpha: float = 1.0
    beta: float = 2.0
    kappa: float = 0.0

    @property
    def name(self) -> str:
        return "unscented_kalman"

    def linearise(self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: Earlier) -> Linearisation:
        p = x.shape[1]
        reach = self.alpha**2 * (p + self.kappa)  # p + λ
        if not reach > 0:
            raise ValueError("`alpha` and p + `kappa` must be positive")
        root = np.linalg.cholesky(P + JITTER * np.eye(p))
        steps = np.sqrt(reach) * np.swapaxes(root, 1, 2)
        points = x[:, None] + np.concatenate([np.zeros_like(steps[:, :1]), steps, -steps], axis=1)
        y, ok = model.outputs(points, k)
        y = y - earlier.share(points)
        w = np.full(2 * p + 1, 1 / (2 * reach))
        w_mean, w_cov = w.copy(), w
        w_mean[0] = 1 - p / reach
        w_cov[0] = w_mean[0] + 1 - self.alpha**2 + self.beta
        mean = np.einsum("i,wim->wm", w_mean, y)
        deviation = y - mean[:, None]
        spread = np.einsum("i,wim,win->wmn", w_cov, deviation, deviation)
        cross = np.einsum("i,wip,wim->wpm", w_cov, points - x[:, None], deviation)
        # statistical linearisation: the H for which P Hᵀ is this cross-covariance
        H = np.swapaxes(np.linalg.solve(P + JITTER * np.eye(p), cross), 1, 2)
        return Linearisation(mean, spread, cross, H, ok)
