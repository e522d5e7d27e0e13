"""How large map errors are: the standard deviations under which the training records are likeliest.

With information H and pull b of the data about the amounts x (everything else eliminated or beside them), both in units
of the present prior standard deviations, and t the factor by which the standard deviation of each group changes,

    ln L(t) = ½ bᵀ(H + T⁻²)⁻¹ b − ½ ln det(1 + T² H),     ∂ln L/∂ln t_g = Σ_{j in g} [(μ_j² + C_jj)/t_g² − 1]

with μ = C b, C = (H + T⁻²)⁻¹. To it comes the prior ln s_g ~ N(ln stated, 1), and s_g is never below what is stated:
one healthy engine may happen to lie on its map, and the next need not.
"""

from __future__ import annotations

import numpy as np

SPREAD = 1.0
"""Standard deviation of the logarithm of a size about what is stated: two thirds lie within a factor e."""
LARGEST = 5.0
"""Size of a map error, as a multiple of what is stated, that is not exceeded: what asks for more is no error of a map
but physics that is missing, and must stay to be seen."""

SLOPE = 1e-3
"""Slope of ln L per ln t at which the search ends: a size is then found to a thousandth. Its value would not do to end
it: ½ bᵀ C b grows with the records, and what sizes change of it does not."""


def likeliest_factors(
    information: np.ndarray, pull: np.ndarray, group: np.ndarray, present: np.ndarray, stated: np.ndarray
) -> np.ndarray:
    """Factors t (G,) on the present sizes.

    information H (p, p), pull b (p,); group (p,): number of the group of each parameter, −1 for those that keep their
    prior; present and stated (G,): sizes as they are and as the engine file has them.
    """
    from scipy.optimize import minimize

    G = len(present)
    if not G:
        return np.ones(0)
    centre = np.log(stated / present)
    top = centre + np.log(LARGEST)

    def lost(log_t: np.ndarray) -> tuple[float, np.ndarray]:
        t = np.where(group >= 0, np.exp(log_t)[group], 1.0)
        inner = np.eye(len(t)) + t[:, None] * information * t
        L = np.linalg.cholesky(inner)
        half = np.linalg.solve(L, t * pull)
        C = np.linalg.inv(inner)
        mean = C @ (t * pull)  # in units of t
        slope = mean**2 + np.diag(C) - 1.0
        gradient = np.bincount(group[group >= 0], slope[group >= 0], minlength=G)
        value = 0.5 * float(half @ half) - float(np.sum(np.log(np.diag(L))))
        away = (log_t - centre) / SPREAD
        return -(value - 0.5 * float(away @ away)), -(gradient - away / SPREAD)

    start = np.clip(np.zeros(G), centre, top)
    bounds = list(zip(centre, top, strict=True))
    found = minimize(lost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 0.0, "gtol": SLOPE})
    return np.asarray(np.exp(found.x))
