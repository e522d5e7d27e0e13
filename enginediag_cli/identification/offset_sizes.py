"""How large the offsets of instruments are from one recording to the next: standard deviations under which the training
records are likeliest.

With H, b information and pull of the data about the parameters x and the offsets z_r of every recording, in units of
their present prior standard deviations, and t the factors by which the standard deviations s of the offsets change,

    ln L(t) = ½ bᵀ(H + T⁻²)⁻¹b − ½ ln det(1 + T² H),     ∂ln L/∂ln t_j = Σ_r [(μ_rj² + C_rj,rj)/t_j² − 1]

μ = C b, C = (H + T⁻²)⁻¹, the recordings eliminated one by one. To it comes what is known before: instruments of one
engine are all looked after with more care or less, and each is better or worse than its kind,

    ln s_j = ln usual_j + c + e_j,     c ~ N(0, COMMON²),  e_j ~ N(0, OWN²).

A few recordings say little of each instrument, but much of all together. What an input's offset explains, those of the
outputs that it moves explain nearly as well: how far each size may lie from the likeliest is the curvature of the
posterior of all sizes at once (Laplace), never wider than before the data.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COMMON, OWN = 1.0, 1.0
"""Standard deviations of the logarithms: two thirds of the engines, and of the instruments of one, lie within a factor
e of what is usual."""
RANGE = (0.02, 20.0)
"""Sizes as multiples of what is usual, from and to: smaller ones do nothing, larger ones are defects."""
STEP = 0.02
"""Of ln t, for differences of slopes: slopes are exact, and bend over a unit of ln t."""
SLOPE = 1e-3
"""Slope of ln L per ln t at which the search ends, as for sizes of map errors."""


@dataclass(frozen=True)
class ArrowData:
    """What the records say of p parameters and of q offsets of each of R recordings: information blocks and pull."""

    H_xx: np.ndarray  # (p, p)
    H_xz: np.ndarray  # (R, p, q)
    H_zz: np.ndarray  # (R, q, q)
    b_x: np.ndarray  # (p,)
    b_z: np.ndarray  # (R, q)


def log_likelihood(data: ArrowData, t: np.ndarray) -> tuple[float, np.ndarray]:
    """ln L and its slopes ∂ln L/∂ln t (q,) for factors t (q,)."""
    q = len(t)
    A = np.eye(q) + t[:, None] * data.H_zz * t
    cross = data.H_xz * t  # (R, p, q)
    pull = data.b_z * t
    inverse = np.linalg.inv(A)
    gain = cross @ inverse
    flat_gain, flat_cross = (np.swapaxes(part, 0, 1).reshape(len(data.b_x), -1) for part in (gain, cross))
    S = np.eye(len(data.b_x)) + data.H_xx - flat_gain @ flat_cross.T
    left = data.b_x - np.einsum("rpq,rq->p", gain, pull)
    L = np.linalg.cholesky(S)
    W = np.linalg.solve(L, flat_gain).reshape(len(S), -1, q)
    half = np.linalg.solve(L, left)
    mean = np.einsum("rqk,rk->rq", inverse, pull) - np.einsum("prq,p->rq", W, half)
    variance = np.diagonal(inverse, axis1=1, axis2=2) + np.einsum("prq,prq->rq", W, W)
    own = np.einsum("rq,rqk,rk->", pull, inverse, pull)
    value = 0.5 * float(half @ half + own)
    value -= float(np.sum(np.log(np.diag(L)))) + 0.5 * float(np.sum(np.linalg.slogdet(A)[1]))
    return value, np.sum(mean**2 + variance - 1.0, axis=0)


def likeliest_offsets(data: ArrowData, present: np.ndarray, usual: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Factors t (q,) on the present sizes (q,), 1 where not `free` (q,); usual (q,): sizes of instruments of a kind."""
    from scipy.optimize import minimize

    if not free.any():
        return np.ones(len(present))
    centre = np.log(usual / present)[free]
    precision = _precision(free)

    def lost(log_t: np.ndarray) -> tuple[float, np.ndarray]:
        t = np.ones(len(present))
        t[free] = np.exp(log_t)
        value, slope = log_likelihood(data, t)
        away = log_t - centre
        held = precision @ away
        return 0.5 * float(away @ held) - value, held - slope[free]

    bounds = list(zip(centre + np.log(RANGE[0]), centre + np.log(RANGE[1]), strict=True))
    start = np.clip(np.zeros(len(centre)), *np.transpose(bounds))
    found = minimize(lost, start, jac=True, method="L-BFGS-B", bounds=bounds, options={"ftol": 0.0, "gtol": SLOPE})
    t = np.ones(len(present))
    t[free] = np.exp(found.x)
    return t


def spread_of_sizes(data: ArrowData, free: np.ndarray) -> np.ndarray:
    """Standard deviations (q,) of ln s about the likeliest sizes, in whose units `data` are; 0 where not `free`."""
    q, at = len(free), np.flatnonzero(free)
    found = np.zeros(q)
    if not len(at):
        return found
    slopes = []
    for j in at:
        up, down = (log_likelihood(data, np.exp(sign * STEP * (np.arange(q) == j)))[1][at] for sign in (1.0, -1.0))
        slopes.append((down - up) / (2.0 * STEP))
    information = np.asarray(slopes)
    # prior standard deviations as units: what the data say is added to 1, and never negative
    L = np.linalg.cholesky(_precision(free))
    inner = np.linalg.inv(L)
    curved, vectors = np.linalg.eigh(inner @ (information + information.T) @ inner.T / 2.0)
    root = inner.T @ vectors / np.sqrt(1.0 + np.maximum(curved, 0.0))
    found[at] = np.sqrt(np.sum(root**2, axis=1))
    return found


def _precision(free: np.ndarray) -> np.ndarray:
    """Inverse covariance (k, k) of the logarithms of the k free sizes before the data."""
    k = int(free.sum())
    return np.asarray(np.linalg.inv(OWN**2 * np.eye(k) + COMMON**2))
