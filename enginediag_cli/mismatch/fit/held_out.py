"""Does an explanation predict a flight better when it was fitted to the others?

Linear at the two fits: for flight r the nuisance and the coefficients are estimated from the rows of the other
flights and the priors, and the flight's χ² is what those estimates leave on its own rows.
"""

from __future__ import annotations

from itertools import groupby

import numpy as np

from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit


def flights_gained(base: HypothesisFit, trial: HypothesisFit) -> float:
    """Share of the flights whose held-out χ² falls with the trial's options; 1 with a single flight."""
    before, after = held_out_objectives(base.projection), held_out_objectives(trial.projection)
    if len(before) < 2:
        return 1.0
    return float(np.mean(after < before))


def held_out_objectives(projection: Projection) -> np.ndarray:
    """Held-out χ² of every recording (R,).

    With all rows A (priors included) and residual e, leaving out the rows A_r changes the estimate so that the
    residual on them is (1 − H_rr)⁻¹ e_r,left with H = A (AᵀA)⁻¹ Aᵀ = Q Qᵀ: the block form of the PRESS residual.
    Source: D. M. Allen, Technometrics 16 (1974) 125–127.
    """
    R, p = projection.R, len(projection.R)
    result = []
    for r, rows in groupby(projection.stream(), key=lambda rows: rows.recording):
        k = p + projection.found.fit.z.shape[1]
        G, pull, square, offsets = np.zeros((k, k)), np.zeros(k), 0.0, projection.offset_step(r)
        for part in rows:
            X = np.concatenate([part.A, part.Z], axis=2).reshape(-1, k)
            e = (part.e - part.A @ projection.step - part.Z @ offsets).ravel()
            G, pull, square = G + X.T @ X, pull + X.T @ e, square + float(e @ e)
        # columns of Q over the recording's rows: those of A with its own offsets eliminated, and of the offsets
        own = projection.offsets[r]
        inverse = np.linalg.inv(np.block([[R, np.zeros((p, k - p))], [own.along, own.R]]))
        QQ, Qe = inverse.T @ G @ inverse, inverse.T @ pull
        # |(1 − Q Qᵀ)⁻¹ e|² with (1 − Q Qᵀ)⁻¹ e = e + Q (1 − QᵀQ)⁻¹ Qᵀ e
        step = np.linalg.solve(np.eye(k) - QQ, Qe)
        result.append(square + 2.0 * float(step @ Qe) + float(step @ QQ @ step))
    return np.array(result)
