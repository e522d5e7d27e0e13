"""Combinations of parameters that these recordings cannot identify, by name.

In prior standard deviations the data's information has eigenvalues λ; a direction of eigenvalue λ is known to
λ/(1 + λ) from the data and for the rest from the prior. The directions below a threshold span a space whose
eigenvectors are an arbitrary mixture; they are rewritten so that each has a leading parameter that is in no
other (reduced echelon form with pivots from a QR factorisation, Golub and Van Loan, §5.5.7), and printed as

    θ_lead + c₂ θ₂ + …     changes in this ratio, in the parameters' own units, leave the readings as they are

with the share of the prior variance along the direction v that the data removed, 1 − vᵀCv / vᵀv.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

THRESHOLD = 0.1
"""A direction of which the data give less than this share counts as unidentified."""

NAMED = 0.15
"""A parameter is named in a combination when its part reaches this share of the leader's, in prior sigmas."""


SHOWN = 5
"""Parameters of one combination that its sentence names."""


@dataclass(frozen=True)
class Combination:
    """Changes of parameters in the ratio of `coefficients`, which the readings hardly show.

    `from_data` is the share of what is known of it that the data give, 0 to 1.
    """

    parameters: tuple[str, ...]
    coefficients: tuple[float, ...]
    from_data: float

    def __str__(self) -> str:
        terms = [self.parameters[0]]
        for name, c in list(zip(self.parameters, self.coefficients, strict=True))[1:SHOWN]:
            terms.append(f"{'+' if c > 0 else '−'} {abs(c):.2g}·{name}")
        if len(self.parameters) > SHOWN:
            terms.append(f"and {len(self.parameters) - SHOWN} smaller parts")
        return f"{' '.join(terms)}: data give {100 * self.from_data:.0f} % of what is known"


def unidentified_combinations(
    information: np.ndarray, covariance: np.ndarray, prior_sigma: np.ndarray, names: Sequence[str]
) -> tuple[Combination, ...]:
    """Combinations below THRESHOLD, the least known first.

    `information` and posterior `covariance` are (p, p) in prior standard deviations, `prior_sigma` (p,) in
    the parameters' units.
    """
    from scipy.linalg import qr

    values, vectors = np.linalg.eigh(information)
    space = vectors[:, values / (1 + np.maximum(values, 0)) < THRESHOLD]
    if space.shape[1] == 0:
        return ()
    _, _, order = qr(space.T, pivoting=True, mode="economic")
    pivots = order[: space.shape[1]]
    basis = space @ np.linalg.inv(space[pivots])
    found = [_named(basis[:, j], covariance, prior_sigma, names) for j in range(basis.shape[1])]
    return tuple(sorted(found, key=lambda c: (c.from_data, c.parameters)))


def _named(direction: np.ndarray, covariance: np.ndarray, prior_sigma: np.ndarray, names: Sequence[str]) -> Combination:
    size = np.abs(direction)
    order = [int(i) for i in np.argsort(-size, kind="stable") if size[i] >= NAMED * size.max()]
    w = np.zeros_like(direction)
    w[order] = direction[order]
    from_data = float(np.clip(1 - w @ covariance @ w / (w @ w), 0.0, 1.0))
    physical = direction[order] * prior_sigma[order]
    coefficients = physical / physical[0]
    return Combination(tuple(names[i] for i in order), tuple(float(c) for c in coefficients), from_data)
