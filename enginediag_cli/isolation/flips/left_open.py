"""How wrong the map of one machine alone may still be where a window was flown, after training.

Of the map quantity q with health parameter θ_q and amounts a_j the relative error at map coordinates ξ is

    θ_q + Σ_j a_j φ_j(ξ)        of variance        (1, φ(ξ)) C_q|o (1, φ(ξ))ᵀ,      C_q|o = ((C⁻¹)_qq)⁻¹,

C the posterior covariance of everything uncertain, o all of it but the block of q: training knows what errors do to
readings together far better than which of them does it, and asked is for an error that is wrong alone. Told is the root
of its mean over operating points of the window.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from enginediag_cli.error_model.modelled import MapErrorModel
from enginediag_cli.residuals.monitor import Monitor

HELD = 1e-10
"""Of the scaled covariance, so that what is known to rounding alone can be inverted; as in `Monitor.precision`."""


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
    uncertain = np.flatnonzero(np.diag(monitor.uncertainty) > 0)
    place = {monitor.names[i]: k for k, i in enumerate(uncertain)}
    scale = np.sqrt(np.diag(monitor.uncertainty))[uncertain]
    C = monitor.uncertainty[np.ix_(uncertain, uncertain)] / scale / scale[:, None]
    precision = np.linalg.inv(C + HELD * np.eye(len(C)))
    found = {}
    for g, (target, amounts) in enumerate(engine.groups.items()):
        if target not in monitor.monitored or any(name not in place for name in (target, *amounts)):
            continue
        at = np.array([place[target], *(place[name] for name in amounts)])
        alone = np.linalg.inv(precision[np.ix_(at, at)])
        row = scale[at] * np.column_stack([np.ones(len(seen)), curves[seen, g]])
        found[target] = float(np.sqrt(np.mean(np.einsum("ni,ij,nj->n", row, alone, row))))
    return found
