"""Whether what was fitted differs from nothing, by the flights that it was fitted to.

With the covariance C of everything identified together (priors, map errors and offsets among it), a record's whitened
columns A and residual e⊥ at the optimum tell of coefficients h by their efficient scores

    u_r = (A_r C_·h C_hh⁻¹)ᵀ e⊥_r      Σ_r (A_r C_·h C_hh⁻¹)ᵀ (A_r C_·h C_hh⁻¹) ≤ C_hh⁻¹

which are summed by stretches.

Source: A. W. van der Vaart, "Asymptotic Statistics" (1998), section 25.4 (efficient scores).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.engine.term import Effect
from enginediag_cli.mismatch.fit.spread import spread_of
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.refine.criteria import Significance


def significance(effects: Sequence[Effect], trial: HypothesisFit) -> tuple[Significance, ...]:
    """Of each of the effects that the trial has fitted, none at a bound."""
    return tuple(_of_one(e, trial) for e in effects)


def _of_one(e: Effect, trial: HypothesisFit) -> Significance:
    problem, projection = trial.found.problem, trial.projection
    index = [problem.names.index(n) for n in e.sizes]
    absent = np.array([c.absent for c in e.term.amplitudes() if not c.free])
    value = (np.array([trial.coefficients[n][0] for n in e.sizes]) - absent) / problem.prior_sigma[index]
    inner, found = spread_of(projection, e.sizes)
    return Significance(
        e.label,
        len(index),
        float(value @ inner @ value),
        projection.objective / projection.dof,
        float(value @ np.linalg.pinv(found.covariance) @ value),
        found.effective,
    )
