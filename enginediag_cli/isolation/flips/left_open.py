"""How wrong the map of one machine alone may still be where a window was flown, after training.

Of the map quantity q with health parameter θ_q and amounts a_j the relative error at map coordinates ξ is

    θ_q + Σ_j a_j φ_j(ξ)        of variance        (1, φ(ξ)) C_q|o (1, φ(ξ))ᵀ,      C_q|o = C_qq − C_qo C_oo⁺ C_oq,

C the posterior covariance of everything uncertain, o all of it but the block of q: training knows what errors do to
readings together far better than which of them does it, and asked is for an error that is wrong alone. Told is the root
of its mean over operating points of the window.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.residuals.monitor import Monitor


def left_open(monitor: Monitor, flown: Mapping[str, np.ndarray]) -> dict[str, float]:
    """Standard deviation of the error of each map quantity that is monitored, a share, by its health parameter, at
    operating points column -> (k,); empty where the model has no errors of maps or no point can be computed."""
    engine = monitor.engine
    if not isinstance(engine, MapErrorModel) or not flown:
        return {}
    frozen = engine.frozen(dict(flown), ())
    _, curves = engine.factors(frozen, ())
    seen = np.flatnonzero(curves.any(axis=(1, 2)))
    if not seen.size:
        return {}
    place = {name: i for i, name in enumerate(monitor.names)}
    found = {}
    for g, (target, amounts) in enumerate(engine.groups.items()):
        if target not in monitor.monitored or any(name not in place for name in amounts):
            continue
        at = np.array([place[target], *(place[name] for name in amounts)])
        C = _alone(monitor.uncertainty, at)
        row = np.column_stack([np.ones(len(seen)), curves[seen, g]])
        found[target] = float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", row, C, row))))
    return found


def _alone(C: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of the parameters at positions `at` (k,) where all others are known."""
    others = np.setdiff1d(np.flatnonzero(np.diag(C) > 0), at)
    scale = np.sqrt(np.diag(C))
    inner = C[np.ix_(others, others)] / scale[others] / scale[others][:, None]
    eigenvalues, vectors = np.linalg.eigh(inner)
    seen = eigenvalues > 1e-12 * max(float(eigenvalues[-1]), 1e-300) if others.size else np.zeros(0, bool)
    half = (C[np.ix_(at, others)] / scale[others]) @ (vectors[:, seen] / np.sqrt(eigenvalues[seen]))
    return np.asarray(C[np.ix_(at, at)] - half @ half.T)
