"""How well coefficients of a fit are known where its readings are not independent: by stretches of the records."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.stretches import Stretches, by_stretches


def spread_of(projection: Projection, names: Sequence[str]) -> tuple[np.ndarray, Stretches]:
    """Information (k, k) of parameters that are free in the fit, all others integrated out, and how their estimates
    spread over stretches; both in prior standard deviations."""
    problem = projection.found.problem
    place = np.cumsum(projection.free[: len(problem.names)]) - 1
    h = place[[problem.names.index(n) for n in names]]
    C = projection.covariance()
    inner = np.linalg.inv(C[np.ix_(h, h)])
    along = C[:, h] @ inner  # (p, k)
    left = projection.residual
    scores, information = np.zeros((len(left), len(h))), np.zeros((len(left), len(h), len(h)))
    for rows in projection.stream():
        own = projection.offsets[rows.recording]
        columns = (rows.A - rows.Z @ np.linalg.solve(own.R, own.along)) @ along  # (n, m, k)
        scores[rows.span] = np.einsum("nmk,nm->nk", columns, left[rows.span])
        information[rows.span] = np.einsum("nmk,nml->nkl", columns, columns)
    return inner, by_stretches(scores, information, inner, problem.recording)
