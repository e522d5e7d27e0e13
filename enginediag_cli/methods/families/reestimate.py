"""Residuals of windows carried back to θ0 from their own estimate, or taken at θ0: input of estimation and local."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from enginediag_cli.methods.families.sums import nominal_residuals
from enginediag_cli.methods.windows import Windows
from enginediag_cli.residuals.monitor import Monitor
from enginediag_cli.residuals.pipeline import LINEARISE
from enginediag_cli.residuals.relinearise import relinearise


@dataclass(frozen=True)
class WindowResiduals:
    """e (W, n, m), NaN where missing, J (W, n, m, p), point of linearisation theta (W, p), converged (W,).

    e0, J0: the same at θ0, with the same readings missing.
    """

    e: np.ndarray
    J: np.ndarray
    e0: np.ndarray
    J0: np.ndarray
    theta: np.ndarray
    converged: np.ndarray


def linearised(monitor: Monitor, windows: Windows, linearise: str, precision: np.ndarray) -> WindowResiduals:
    """Residuals ẽ = y − Φ(û) + Ĵ(θ̂ − θ0) at θ0 ("nominal") or at the estimate held by `precision` (p, p)."""
    if linearise not in LINEARISE:
        raise ValueError(f"`linearise` must be one of {', '.join(LINEARISE)}, not {linearise!r}")
    W, n, m = windows.y.shape
    if linearise == "nominal":
        e, J = nominal_residuals(monitor, windows)
        return WindowResiduals(e, J, e, J, np.tile(monitor.theta0, (W, 1)), np.ones(W, bool))
    inputs = windows.flat_inputs()

    def predict(theta: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return monitor.predict({c: v[rows] for c, v in inputs.items()}, theta, nuisance=False)[:3]

    *nominal, prediction = monitor.predict(inputs, monitor.theta0)
    inputs = {**inputs, **getattr(prediction, "frozen", {})}
    found = relinearise(
        predict,
        windows.y.reshape(-1, m),
        replace(monitor.hold, precision=precision),
        monitor.noise,
        window=np.repeat(np.arange(W), n),
        nominal=(nominal[0], nominal[1], nominal[2]),
    )
    shape = windows.y.shape
    e = np.where(found.ok[:, None], found.e, np.nan).reshape(shape)
    e0 = np.where(np.isfinite(e), windows.y - nominal[0].reshape(shape), np.nan)
    J, J0 = found.J.reshape(*shape, -1), nominal[1].reshape(*shape, -1)
    return WindowResiduals(e, J, e0, J0, found.theta, found.converged)
