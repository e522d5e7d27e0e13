"""Extended Kalman filter: the engine linearised at the present estimate, H = ∂Φ/∂θ there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from enginediag_cli.methods.families.observer import Earlier, Linearisation, Observer, ScaledModel


@dataclass(frozen=True)
class ExtendedKalman(Observer):
    """Observer with exact sensitivities of the engine. On a linear engine it is recursive least squares."""

    HELP: ClassVar[str] = "Kalman filter with the parameters as states, linearised by the engine's sensitivities"

    @property
    def name(self) -> str:
        return "extended_kalman"

    def linearise(self, model: ScaledModel, x: np.ndarray, P: np.ndarray, k: int, earlier: Earlier) -> Linearisation:
        y, H, ok = model(x, k)
        mean = y - earlier.share(x[:, None])[:, 0]
        H = H - earlier.c[:, :, None] * earlier.H
        cross = P @ np.swapaxes(H, 1, 2)
        return Linearisation(mean, H @ cross, cross, H, ok)
