"""Kalman filters with parameters as states."""

from __future__ import annotations

import numpy as np
import pytest
from family_windows import NOISE, A, B, linear_monitor, linear_windows, toy_windows, within_binomial
from toy_engine import toy_monitor

from enginediag_cli.methods.base import RecordWindows
from enginediag_cli.methods.filters import ExtendedKalman, UnscentedKalman


def batch_least_squares(windows, w, prior):
    """Estimate and covariance of θ from all records of a window, with θ ~ N(0, prior²)."""
    G = ((A + windows.inputs["u"][w][:, None, None] * B) / NOISE[:, None]).reshape(-1, 3)
    z = (windows.y[w] / NOISE).ravel()
    used = np.isfinite(z)
    P = np.linalg.inv(G[used].T @ G[used] + np.eye(3) / prior**2)
    return P @ G[used].T @ z[used], P


@pytest.mark.parametrize("filter_", [ExtendedKalman, UnscentedKalman])
def test_without_a_walk_a_filter_of_a_linear_engine_is_batch_least_squares(filter_):
    windows = linear_windows(np.random.default_rng(1), 4, 40, change=(0.5, -0.3, 0.2))
    windows.y[1, 5:20, 2] = np.nan
    windows.y[2, 11] = np.nan
    result = filter_(walk=0.0, initial=2.0).train(linear_monitor()).diagnose(windows)
    for w in range(4):
        estimate, P = batch_least_squares(windows, w, 2.0)
        np.testing.assert_allclose(result.trajectory[w, -1], estimate, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(result.deviation[w, -1], np.sqrt(np.diag(P)), rtol=1e-6)


@pytest.mark.parametrize("rho", [0.0, 0.6])
def test_the_unscented_filter_of_a_linear_engine_is_the_kalman_filter(rho):
    windows = linear_windows(np.random.default_rng(2), 5, 30, change=(0.5, 0, 0), since=10, rho=rho)
    windows.y[0, 4:9, 1] = np.nan
    ekf, ukf = (
        f(walk=0.5, initial=0.3).train(linear_monitor(rho=rho)).diagnose(windows)
        for f in (ExtendedKalman, UnscentedKalman)
    )
    for name in ("trajectory", "deviation", "nis", "evidence"):
        np.testing.assert_allclose(getattr(ukf, name), getattr(ekf, name), rtol=1e-5, atol=1e-8)
    for a, b in zip(ekf.tests, ukf.tests, strict=True):
        np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-5)


@pytest.mark.parametrize(("rho", "uncertain"), [(0.0, 0.0), (0.0, 0.3), (0.7, 0.0)])
def test_each_test_of_the_observer_has_its_share_of_false_alarms_within_four_binomial_errors(rho, uncertain):
    windows = linear_windows(np.random.default_rng(3), 2000, 40, rho=rho, uncertain=uncertain)
    fitted = ExtendedKalman().train(linear_monitor(rho=rho, uncertain=uncertain))
    result = fitted.diagnose(windows, 0.06)
    for test in result.tests:
        assert test.level == pytest.approx(0.02)
        assert within_binomial(test.alarm, 0.02), test.name
    assert result.alarm.mean() < 0.06 + 4 * np.sqrt(0.06 / 2000)


def test_innovations_are_white_when_healthy_and_not_after_a_jump():
    rng = np.random.default_rng(4)
    fitted = ExtendedKalman(walk=0.03, tests=("whiteness",)).train(linear_monitor())
    healthy = fitted.diagnose(linear_windows(rng, 300, 100))
    jumped = fitted.diagnose(linear_windows(rng, 300, 100, change=(1.0, 0, 0.5), since=50))
    assert healthy.alarm.mean() < 0.01 + 4 * np.sqrt(0.01 / 300)
    assert jumped.alarm.mean() > 0.9


def test_the_trajectory_follows_a_jump_and_the_final_state_names_the_parameter():
    windows = linear_windows(np.random.default_rng(5), 200, 150, change=(0, 1.0, 0), since=75)
    result = ExtendedKalman(walk=1.0).train(linear_monitor()).diagnose(windows)
    mean = result.trajectory.mean(axis=0)
    assert np.all(np.abs(mean[74]) < 0.05)
    assert abs(mean[-1, 1] - 1.0) < 0.1 and np.all(np.abs(mean[-1, [0, 2]]) < 0.1)
    assert np.mean([result.isolated_names(w) == ("b",) for w in range(200)]) > 0.9


def test_the_variance_of_the_filter_is_that_of_its_estimate():
    rng = np.random.default_rng(6)
    windows = linear_windows(rng, 2000, 30, uncertain=0.5)
    result = ExtendedKalman(walk=0.0, initial=0.5).train(linear_monitor()).diagnose(windows)
    truth_spread = 0.25 - result.deviation[:, -1].mean(axis=0) ** 2
    np.testing.assert_allclose(result.trajectory[:, -1].var(axis=0), truth_spread, rtol=0.15)


def test_both_filters_agree_on_a_curved_engine_and_find_the_change():
    windows = toy_windows(np.random.default_rng(7), 100, 60, {1: -0.005})
    results = [f().train(toy_monitor()).diagnose(windows) for f in (ExtendedKalman, UnscentedKalman)]
    for result in results:
        assert result.alarm.all()
        assert np.mean([result.isolated_names(w) == ("hpc.efficiency",) for w in range(100)]) > 0.9
    np.testing.assert_allclose(results[0].trajectory, results[1].trajectory, atol=2e-4)


def test_a_record_that_the_engine_cannot_compute_counts_as_missing():
    windows = toy_windows(np.random.default_rng(8), 3, 20)
    high = RecordWindows({c: v.copy() for c, v in windows.inputs.items()}, windows.y.copy())
    high.inputs["altitude_m"][:, 7] = 14e3
    windows.y[:, 7] = np.nan
    for filter_ in (ExtendedKalman, UnscentedKalman):
        fitted = filter_().train(toy_monitor())
        one, other = fitted.diagnose(windows), fitted.diagnose(high)
        np.testing.assert_allclose(one.trajectory, other.trajectory, rtol=1e-12)
        np.testing.assert_allclose(one.tests[0].statistic, other.tests[0].statistic, rtol=1e-10)


def test_a_filter_that_cannot_move_is_refused():
    with pytest.raises(ValueError, match="one of them must be positive"):
        ExtendedKalman(walk=0.0).train(linear_monitor())
    with pytest.raises(ValueError, match="nis"):
        ExtendedKalman(tests=("spectrum",)).train(linear_monitor())
