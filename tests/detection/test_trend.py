"""Trends over flights from their statistics."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.detection.trend import fit_trends, flight_change
from enginediag_cli.intervals import NORMAL_95
from enginediag_cli.residuals.statistics import LocalStatistics

NAMES, SIGMA = ("fan.efficiency", "hpc.efficiency", "hpt.efficiency"), np.array([0.02, 0.02, 0.02])


def flights(rng, changes):
    """Statistics of flights in which the parameters have the changes (n, 3)."""
    found = []
    for change in changes:
        A = rng.standard_normal((30, 3)) * 200
        F = A.T @ A
        s = F @ change + A.T @ rng.standard_normal(30)
        found.append(
            LocalStatistics(
                parameters=NAMES, theta0=np.ones(3), prior_sigma=SIGMA, s=s, F=F, V=F, n=30, chi2=30.0, dof=30.0
            )
        )
    return found


def test_summed_flights_are_estimated_as_generalised_least_squares_does():
    rng = np.random.default_rng(1)
    one, two = flights(rng, [[0.0, -0.01, 0.0]] * 2)
    prior = np.diag(SIGMA**-2.0)
    expected = np.linalg.solve(one.F + two.F + prior, one.s + two.s)
    found = flight_change(one + two)
    np.testing.assert_allclose(found.change, expected)
    np.testing.assert_allclose(found.standard_error, np.sqrt(np.diag(np.linalg.inv(one.F + two.F + prior))))


def test_deterioration_and_step_are_found_with_onset_and_rate():
    changes = np.zeros((25, 3))
    changes[:, 1] = -0.001 * np.maximum(np.arange(25) - 9, 0)
    changes[14:, 2] = 0.01
    changes[:, 0] = 0.004  # an engine may lie off nominal all the time
    fit = fit_trends(flights(np.random.default_rng(2), changes))
    fan, hpc, hpt = fit.trends
    assert fit.converged and [t.kind for t in fit.trends] == ["steady", "deterioration", "step"]
    assert hpc.onset_low <= 10 <= hpc.onset_high and abs(hpc.rate + 0.001) < 3 * hpc.rate_error
    assert hpt.onset == 15 and abs(hpt.change - 0.01) < 3 * hpt.change_error
    assert fan.probability < 0.2


def test_intervals_of_the_rate_cover_as_often_as_stated():
    covered, trials = 0, 60
    for seed in range(trials):
        changes = np.zeros((15, 3))
        changes[:, 0] = -0.001 * np.maximum(np.arange(15) - 5, 0)
        trend = fit_trends(flights(np.random.default_rng(100 + seed), changes)).trends[0]
        covered += abs(trend.rate + 0.001) < NORMAL_95 * trend.rate_error
    assert covered >= 50  # 0.1 % point of the binomial law for 60 intervals at 95 % is 51


def test_healthy_flights_have_no_trend():
    changed = sum(
        t.kind != "steady"
        for seed in range(20)
        for t in fit_trends(flights(np.random.default_rng(seed), np.zeros((12, 3)))).trends
    )
    assert changed <= 3


def test_two_flights_are_no_trend():
    with pytest.raises(ValueError, match="three flights"):
        fit_trends(flights(np.random.default_rng(3), np.zeros((2, 3))))
