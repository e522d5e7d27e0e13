"""Re-estimation of all parameters, and its kinship with the local approach."""

from __future__ import annotations

import numpy as np
import pytest
from family_windows import NOISE, A, B, linear_monitor, linear_windows, toy_windows, within_binomial
from scipy.stats import chi2
from toy_engine import toy_monitor

from enginediag_cli.isolation.methods import single_minmax
from enginediag_cli.methods.estimation import (
    ParameterEstimation,
    holm,
    scored_windows,
    wald_statistics,
)
from enginediag_cli.methods.registry import METHODS


def test_wald_tests_of_a_linear_engine_are_those_of_least_squares():
    windows = linear_windows(np.random.default_rng(1), 5, 30, change=(0.3, 0, 0))
    result = ParameterEstimation(width=1e4).train(linear_monitor()).diagnose(windows)
    for w in range(5):
        G = ((A + windows.inputs["u"][w][:, None, None] * B) / NOISE[:, None]).reshape(-1, 3)
        z = (windows.y[w] / NOISE).ravel()
        estimate = np.linalg.lstsq(G, z)[0]
        covariance = np.linalg.inv(G.T @ G)
        np.testing.assert_allclose(result.change[w], estimate, rtol=1e-9)
        np.testing.assert_allclose(result.standard_error[w], np.sqrt(np.diag(covariance)), rtol=1e-9)
        np.testing.assert_allclose(result.evidence[w], estimate**2 / np.diag(covariance), rtol=1e-8)
        assert result.tests[0].statistic[w] == pytest.approx(estimate @ G.T @ G @ estimate, rel=1e-6)


@pytest.mark.parametrize(("rho", "uncertain"), [(0.0, 0.0), (0.8, 0.0), (0.0, 0.3)])
def test_false_alarms_of_the_joint_test_are_nominal_within_four_binomial_errors(rho, uncertain):
    windows = linear_windows(np.random.default_rng(2), 3000, 25, rho=rho, uncertain=uncertain)
    result = ParameterEstimation().train(linear_monitor(rho=rho, uncertain=uncertain)).diagnose(windows, 0.05)
    assert within_binomial(result.alarm, 0.05)


def test_false_alarms_on_a_curved_engine_are_nominal_although_all_parameters_are_re_estimated():
    windows = toy_windows(np.random.default_rng(3), 1500, 25)
    result = ParameterEstimation().train(toy_monitor()).diagnose(windows, 0.05)
    assert result.converged.all()
    assert within_binomial(result.alarm, 0.05)


def test_the_known_change_is_estimated_and_named():
    windows = toy_windows(np.random.default_rng(4), 200, 60, {1: -0.01, 3: -0.01})
    result = ParameterEstimation().train(toy_monitor()).diagnose(windows)
    error = (result.change - np.array([0, -0.01, 0, -0.01])) / result.standard_error
    assert np.all(np.abs(error.mean(axis=0)) < 0.3) and np.all(np.abs(error.std(axis=0) - 1) < 0.2)
    assert np.mean([result.isolated_names(w) == ("hpc.efficiency", "hpt.efficiency") for w in range(200)]) > 0.9


def test_estimation_and_local_approach_agree_for_many_records():
    monitor = toy_monitor()
    windows = toy_windows(np.random.default_rng(5), 10, 2000, {2: -0.004})
    estimation = ParameterEstimation().train(monitor).diagnose(windows)
    local = METHODS["local"].train(monitor).diagnose(windows)
    np.testing.assert_allclose(estimation.tests[0].statistic, local.tests[0].statistic, rtol=0.01)
    scores, _ = scored_windows(monitor, windows).scores("estimate")
    minmax = np.array([single_minmax(s)[0] for s in scores])
    np.testing.assert_allclose(estimation.evidence, minmax, rtol=0.02, atol=0.02)


def test_an_undetermined_parameter_has_an_infinite_error_and_is_never_named():
    F = np.diag([4.0, 0.0, 1.0])[None]
    wald = wald_statistics(np.array([[4.0, 0.0, 3.0]]), F, np.ones(3))
    np.testing.assert_allclose(wald.estimate[0], [1, 0, 3])
    np.testing.assert_allclose(wald.variance[0], [0.25, np.inf, 1])
    np.testing.assert_allclose(wald.wald[0], [4, 0, 9])
    assert wald.rank[0] == 2 and wald.joint[0] == pytest.approx(13)


def test_holm_names_a_true_null_no_more_often_than_stated():
    rng = np.random.default_rng(6)
    t = rng.standard_normal((20_000, 5)) ** 2
    t[:, 0] += 30  # one parameter has changed
    named = holm(chi2.sf(t, 1), 0.05)
    assert named[:, 0].mean() > 0.99
    assert np.mean(named[:, 1:].any(axis=1)) < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 20_000)


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_false_alarms_of_the_local_approach_are_nominal_within_four_binomial_errors(rho):
    windows = linear_windows(np.random.default_rng(7), 1500, 25, rho=rho, uncertain=0.2)
    result = (
        METHODS["local"]
        .configure({"linearise": "nominal"})
        .train(linear_monitor(rho=rho, uncertain=0.2))
        .diagnose(windows, 0.05)
    )
    assert within_binomial(result.alarm, 0.05)
