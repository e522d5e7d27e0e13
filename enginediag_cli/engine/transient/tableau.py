"""The Runge–Kutta method that moves the states: singly diagonally implicit, of third order, with a second-order
estimate of its error.

Every stage is one solve of the network with one more term in the balances, x − base = γ h f(x): as long as a solve of
the steady engine, and as robust. The method is L-stable, so that what settles fast (a valve, a probe) does not bound
the step, and its last stage is the end of the step, so that where nothing changes any more the engine stands on its
steady solution.

Source: ESDIRK3(2)4L[2]SA, C. A. Kennedy and M. H. Carpenter, Appl. Numer. Math. 44 (2003) 139–181, appendix C
(the implicit part of ARK3(2)4L[2]SA).
"""

from __future__ import annotations

import numpy as np

GAMMA = 0.4358665215084589994160194
"""Weight of a stage's own derivative: the root of γ³ − 3γ² + 3γ/2 − 1/6 at which the method is L-stable."""
NODES = np.array([0.0, 2.0 * GAMMA, 0.6, 1.0])
"""Where the stages are, of the step."""


def _stages() -> np.ndarray:
    """Weights of the derivatives in each stage, from the conditions of order: Σ b = 1, Σ b c = 1/2, Σ b c² = 1/3, and
    stages of order two, Σ a c = c²/2."""
    c = NODES
    third = (c[2] ** 2 / 2.0 - GAMMA * c[2]) / c[1]
    A = np.zeros((4, 4))
    A[1, :2] = GAMMA
    A[2, :3] = c[2] - third - GAMMA, third, GAMMA
    rest = np.array([1.0 - GAMMA, 0.5 - GAMMA, 1.0 / 3.0 - GAMMA])
    A[3] = *np.linalg.solve(np.vander(c[:3], increasing=True).T, rest), GAMMA
    return A


STAGES = _stages()
"""Weights of the derivatives in each stage; the first stage is the beginning of the step, the last one its end."""
EMBEDDED = np.array(
    [
        2756255671327 / 12835298489170,
        -10771552573575 / 22201958757719,
        9247589265047 / 10645013368117,
        2193209047091 / 5459859503100,
    ]
)
"""Weights of the method of second order that tells the error."""
ORDER = 3
"""Of the local error: it grows with this power of the step."""
