"""What a model that is linear about nominal leaves out: whether a window needs the engine at its estimate as well.

    y(θ₀ + δ) = y₀ + J δ + ½ δᵀHδ + …,      left out, in standard errors:   ‖½ R^-½ δᵀHδ‖ over the records of a window

H by central differences of the engine's exact sensitivities, at operating points that identification saw.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from enginediag_cli.residuals.order_statistics import quantile

if TYPE_CHECKING:
    from enginediag_cli.residuals.monitor import Monitor

POINTS = 30
"""Operating points at which the engine is differentiated; at a hundred the answer is the same to two per cent."""
STEP = 0.25
"""Of a difference, in prior standard deviations."""
SHARE = 0.9
"""Of operating points at which the model is less curved than is assumed of all records."""


@dataclass(frozen=True)
class Curvature:
    """`half` (K, m, a, a): ½ R^-½ ∂²y/∂θ² at K operating points, in noise units per parameter unit squared."""

    half: np.ndarray

    def left_out(self, step: np.ndarray, records: np.ndarray) -> np.ndarray:
        """Upper estimate (w,), in standard errors, of what steps (w, a) from nominal add to so many records (w,)."""
        bent = np.einsum("kjab,wa,wb->wkj", self.half, step, step, optimize=True)
        return np.asarray(np.sqrt(records * quantile(np.sum(bent**2, axis=2), SHARE)))


def curvature(monitor: Monitor, inputs: Mapping[str, np.ndarray], start: np.ndarray | None = None) -> Curvature | None:
    """Curvature in the monitored parameters at some of the operating points `inputs` (n,); None where the engine
    fails about too many of them. start: the engine's unknowns (nx, n) at nominal, to begin with."""
    a, n = len(monitor.monitored), len(next(iter(inputs.values())))
    at = np.array(sorted(set(np.linspace(0, n - 1, POINTS).astype(int).tolist())))
    steps = STEP * monitor.prior_sigma[:a]
    theta = np.tile(monitor.theta0, (2 * a, len(at), 1))
    for i, h in enumerate(steps):
        theta[2 * i, :, i] += h
        theta[2 * i + 1, :, i] -= h
    _, J, ok, _ = monitor.predict(
        {c: np.tile(v[at], 2 * a) for c, v in inputs.items()},
        theta.reshape(-1, theta.shape[2]),
        nuisance=False,
        **({} if start is None else {"start": np.tile(start[:, at], 2 * a)}),
    )
    J, good = J.reshape(a, 2, len(at), -1, a), ok.reshape(2 * a, len(at)).all(axis=0)
    if good.sum() < POINTS // 2:
        return None
    second = ((J[:, 0] - J[:, 1]) / (2 * steps[:, None, None, None])).transpose(1, 2, 0, 3)[good]
    weight = 1 / (monitor.noise.sigma * np.sqrt(monitor.noise.inflation))
    return Curvature(0.25 * (second + second.transpose(0, 1, 3, 2)) * weight[:, None, None])
