"""Steps where the misfit has kinks: maps that are read linearly between grid lines have a gradient that jumps.

At a kink the gradient on either side is not small however near the optimum is, and a step along one of them runs into
the other. So every point that was tried near by keeps its gradient, moved to where the search stands by the common
curvature S, with the error e ≥ 0 by which that extrapolation misses the misfit here. The misfit is then the largest of
these pieces, and the best step and the fall of the misfit that it promises follow from their dual,

    fall = min over λ ≥ 0, Σ λ = 1 of  ½ g_λᵀ S⁻¹ g_λ + λᵀe,   g_λ = Σ λ_i g_i,   step = −S⁻¹ g_λ .

With one gradient that is Newton's step, and √(2·fall) is the Newton decrement: the distance to the optimum in standard
errors, which a kink no longer hides. Source: L. Lukšan and J. Vlček, "A bundle-Newton method for nonsmooth
unconstrained minimization", Math. Programming 83 (1998) 373–391.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PIECES = 24
"""Points that are kept. A kink needs one more point than it has pieces, and far points say little: judgement."""
NEAR = 2.0
"""Standard errors: beyond it a tried point belongs to another region of the maps. Judgement: a few times the jumps of
the gradient that linear maps make."""
PAIR_STEPS, SETTLED = 400, 1e-3
"""Exchanges between two weights λ at most, and the relative fall that ends them: more would change no step visibly.
Any λ gives an upper bound of the distance, so that ending early is on the safe side."""


@dataclass(frozen=True)
class Piece:
    """A point that was tried: parameters (p,), gradient there (p,) and misfit, offsets at their best."""

    x: np.ndarray
    gradient: np.ndarray
    cost: float


class Kinks:
    """Gradients of the points tried near where the search stands; the newest last."""

    def __init__(self) -> None:
        self.pieces: list[Piece] = []

    def add(self, piece: Piece) -> None:
        """Remember a point that was tried."""
        self.pieces = [*self.pieces[1 - PIECES :], piece]

    def clear(self) -> None:
        """Forget all points, because records were lost or found and misfits no longer compare."""
        self.pieces = []

    def about(self, here: Piece, S: np.ndarray, free: np.ndarray) -> Pieces:
        """The misfit about `here` as pieces; S (p, p) is the curvature, `free` (p,) not held at a bound."""
        moved, errors = [here.gradient], [0.0]
        for piece in self.pieces:
            back = here.x - piece.x
            bend = S @ back
            size = float(back @ bend)
            if size <= NEAR**2:
                moved.append(piece.gradient + bend)
                # a piece that lies above the misfit here, because S is only the common part of the curvature, counts
                # as far away, too
                errors.append(abs(here.cost - (piece.cost + float(piece.gradient @ back) + 0.5 * size)))
        G = np.array(moved)
        inner = np.zeros((len(G), len(G)))
        if free.any():
            inner = G[:, free] @ np.linalg.solve(S[np.ix_(free, free)], G[:, free].T)
        return Pieces(S, G, np.array(errors), inner)


@dataclass(frozen=True)
class Pieces:
    """The misfit near one point as the largest of n quadratics of the same curvature."""

    S: np.ndarray  # (p, p)
    gradients: np.ndarray  # (n, p), the first that of the point itself
    errors: np.ndarray  # (n,) how far each piece lies below the misfit at the point
    inner: np.ndarray  # (n, n) g_i S⁻¹ g_j over the parameters not held

    def combined(self, boldness: float = 1.0) -> tuple[np.ndarray, float]:
        """g_λ (p,) for a step of `boldness` (0 to 1) times the full one, and twice the fall of a full step."""
        weights = smallest(boldness * self.inner, self.errors)
        return weights @ self.gradients, float(weights @ self.inner @ weights + 2 * weights @ self.errors)

    def fall(self, dx: np.ndarray) -> float:
        """Fall of the misfit that the pieces promise for a step (p,)."""
        return float(-np.max(self.gradients @ dx - self.errors) - 0.5 * dx @ self.S @ dx)


def smallest(M: np.ndarray, e: np.ndarray) -> np.ndarray:
    """Weights λ ≥ 0, Σ λ = 1, (n,), that make ½ λᵀMλ + λᵀe small, by exchanges between the pair that gains most."""
    weights = np.zeros(len(e))
    weights[0] = 1.0
    for _ in range(PAIR_STEPS):
        slope = M @ weights + e
        to = int(np.argmin(slope))
        giver = int(np.argmax(np.where(weights > 0, slope, -np.inf)))
        gap = slope[giver] - slope[to]
        if gap <= SETTLED * (0.5 * weights @ M @ weights + weights @ e):
            break
        bend = M[to, to] + M[giver, giver] - 2 * M[to, giver]
        part = min(weights[giver], gap / bend if bend > 0 else np.inf)
        weights[to] += part
        weights[giver] -= part
    return weights
