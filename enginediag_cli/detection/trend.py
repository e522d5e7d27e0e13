"""Health in one flight of many: the changes of each parameter from nominal, from the sums of its windows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from enginediag_cli.residuals.statistics import LocalStatistics


@dataclass(frozen=True)
class FlightChange:
    """Change of each parameter (p,) from nominal in one flight, with standard errors (p,), in parameter units.

    Posterior mean and deviation under a change of prior size: where a flight tells nothing, 0 ± prior.
    """

    parameters: tuple[str, ...]
    records: int
    change: np.ndarray
    standard_error: np.ndarray


def flight_change(statistics: LocalStatistics) -> FlightChange:
    """Changes in the flight(s) that the statistics stand for."""
    D = statistics.prior_sigma
    F, s = _effective(statistics)
    covariance = np.linalg.inv(np.eye(len(D)) + D[:, None] * F * D)
    return FlightChange(
        statistics.parameters, statistics.n, D * (covariance @ (D * s)), D * np.sqrt(np.diag(covariance))
    )


def _effective(statistics: LocalStatistics) -> tuple[np.ndarray, np.ndarray]:
    """Information (p, p) and score (p,) with the true covariance V of s: F V⁻¹ F and F V⁻¹ s."""
    if np.array_equal(statistics.F, statistics.V):
        return statistics.F, statistics.s
    from enginediag_cli.residuals.score import fisher_score

    score = fisher_score(statistics)
    return score.information, score.b
