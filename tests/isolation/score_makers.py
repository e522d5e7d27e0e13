"""Scores of linear Gaussian problems, for the isolation tests."""

from __future__ import annotations

import numpy as np
from white_statistics import local_statistics, white_noise

from enginediag_cli.residuals.score import Score, fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame


def linear_score(rng, J, change, sigma=0.02) -> Score:
    """Score of records with sensitivities J (N, m, p), unit noise and a change of the parameters (p,)."""
    N, m, p = J.shape
    e = rng.standard_normal((N, m)) + J @ np.asarray(change, float)
    return fisher_score(
        local_statistics(
            e,
            J,
            white_noise(np.ones(m)),
            ParameterFrame(tuple(f"p{i}" for i in range(p)), np.ones(p), np.full(p, sigma)),
        )
    )


def sensitivities(rng, N=60, m=4, p=6, size=30.0, common=0.5) -> np.ndarray:
    """Random (N, m, p) with columns that resemble each other."""
    mixed = np.eye(p) + common * rng.standard_normal((p, p))
    return size * rng.standard_normal((N, m, p)) @ mixed
