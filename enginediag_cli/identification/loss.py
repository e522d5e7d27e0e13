"""Losses that bound the pull of a gross outlier, as functions of the normalised residual z = e/σ.

Written as ρ(z) with ρ → ½z² for small z, so that the sum over readings is minus a log-likelihood:

    soft_l1   ρ = c²(√(1 + z²/c²) − 1)          ψ = ρ' = z/√(1 + z²/c²)
    huber     ρ = ½z² for |z| ≤ c, c|z| − ½c²   ψ = z clipped to ±c
    none      ρ = ½z²

Source: P. J. Huber, "Robust Estimation of a Location Parameter", Ann. Math. Statist. 35 (1964) 73–101;
P. J. Huber, Robust Statistics (1981), chapter 7, for the regression equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.engine.identification_block import LOSSES


@dataclass(frozen=True)
class Loss:
    """A loss by name and its scale `c` in standard deviations: readings beyond it count less and less."""

    name: str = "soft_l1"
    scale: float = 2.5

    def __post_init__(self) -> None:
        if self.name not in LOSSES:
            raise ValueError(f"`loss` must be one of {LOSSES}, not {self.name!r}")
        if not self.scale > 0:
            raise ValueError(f"the scale of a loss must be positive, not {self.scale!r}")

    @property
    def robust(self) -> bool:
        """Whether a gross outlier counts less than its square."""
        return self.name != "none"

    def cost(self, z: np.ndarray) -> np.ndarray:
        """ρ(z), any shape, dimensionless."""
        c = self.scale
        if self.name == "soft_l1":
            # z²/(1+√(1+z²/c²)) is c²(√(1+z²/c²)−1) without its cancellation at small z
            return np.asarray(z**2 / (1 + np.sqrt(1 + (z / c) ** 2)))
        if self.name == "huber":
            a = np.abs(z)
            return np.where(a <= c, 0.5 * z**2, c * a - 0.5 * c**2)
        return np.asarray(0.5 * z**2)

    def weight(self, z: np.ndarray) -> np.ndarray:
        """ψ(z)/z, the weight of iteratively reweighted least squares; 1 at z = 0."""
        if self.name == "soft_l1":
            return np.asarray(1 / np.sqrt(1 + (z / self.scale) ** 2))
        if self.name == "huber":
            return self.scale / np.maximum(np.abs(z), self.scale)
        return np.ones_like(z)

    def curvature(self, z: np.ndarray) -> np.ndarray:
        """ψ'(z), never negative; its mean is the bread of the sandwich covariance."""
        if self.name == "soft_l1":
            return np.asarray((1 + (z / self.scale) ** 2) ** -1.5)
        if self.name == "huber":
            return np.asarray(np.abs(z) <= self.scale, float)
        return np.ones_like(z)
