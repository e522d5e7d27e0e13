"""Does an explanation predict a flight better when it was fitted to the others?

Linear at the two fits: for flight r the nuisance and the coefficients are estimated from the rows of the other
flights and the priors, and the flight's χ² is what those estimates leave on its own rows.
"""

from __future__ import annotations

import numpy as np

from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial_fit import Trial


def flights_gained(base: Trial, trial: Trial) -> float:
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
    found, frame = projection.found, projection.frame
    recording = found.problem.recording[frame.record]
    result = []
    for r in range(len(found.problem.labels)):
        rows = np.flatnonzero(recording == r)
        if rows.size:
            Q = projection.Q[rows]
            # (1 − Q Qᵀ)⁻¹ e = e + Q (1 − QᵀQ)⁻¹ Qᵀ e
            e = projection.left[rows]
            inner = np.eye(Q.shape[1]) - Q.T @ Q
            e = e + Q @ np.linalg.solve(inner, Q.T @ e)
            result.append(float(e @ e))
    return np.array(result)
