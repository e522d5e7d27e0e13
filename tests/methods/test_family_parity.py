"""Parity equations: the prediction error and its projections."""

from __future__ import annotations

import numpy as np
import pytest
from family_windows import NOISE, A, B, linear_monitor, linear_windows, toy_windows, within_binomial
from toy_engine import toy_monitor

from enginediag_cli.methods.residual_tests import PredictionError, StructuredParity, decoupled, reduced_sums


@pytest.mark.parametrize("reduction", ["mean", "records"])
@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_false_alarms_of_the_prediction_error_are_nominal_within_four_binomial_errors(reduction, rho):
    rng = np.random.default_rng(1)
    windows = linear_windows(rng, 4000, 20, rho=rho, uncertain=0.3)
    monitor = linear_monitor(rho=rho, uncertain=0.3)
    result = PredictionError(reduction).train(monitor).diagnose(windows, 0.05)
    assert within_binomial(result.alarm, 0.05)
    assert result.isolated is None


def test_the_mean_sees_a_small_lasting_change_that_all_records_together_hardly_see():
    windows = linear_windows(np.random.default_rng(2), 300, 100, change=(0.2, 0, 0))
    mean, records = (
        PredictionError(r).train(linear_monitor()).diagnose(windows).alarm.mean() for r in ("mean", "records")
    )
    assert mean > 0.8 > 0.5 > records


def test_all_records_see_a_scatter_that_the_mean_does_not():
    rng = np.random.default_rng(3)
    windows = linear_windows(rng, 300, 100)
    windows.y[...] += 0.7 * NOISE * rng.standard_normal(windows.y.shape)
    windows.y[...] -= windows.y.mean(axis=1, keepdims=True)
    mean, records = (
        PredictionError(r).train(linear_monitor()).diagnose(windows).alarm.mean() for r in ("mean", "records")
    )
    assert records == 1 and mean < 0.05


@pytest.mark.parametrize("reduction", ["mean", "records"])
def test_a_decoupled_residual_does_not_notice_its_own_parameters(reduction):
    monitor = linear_monitor(uncertain=0.1)
    windows = linear_windows(np.random.default_rng(4), 20, 30, uncertain=0.1)
    J = A + windows.inputs["u"][:, :, None, None] * B
    moved = linear_windows(np.random.default_rng(4), 20, 30, uncertain=0.1)
    moved.y[...] += J @ np.array([5.0, 0.0, -3.0])
    before, after = (reduced_sums(monitor, w, reduction) for w in (windows, moved))
    np.testing.assert_allclose(
        decoupled(after, (0, 2), np.ones(3))[0], decoupled(before, (0, 2), np.ones(3))[0], rtol=1e-8
    )
    assert np.all(decoupled(after, (0,), np.ones(3))[0] > 2 * decoupled(before, (0,), np.ones(3))[0])


def test_a_decoupled_residual_is_the_residual_of_least_squares():
    windows = linear_windows(np.random.default_rng(5), 3, 25)
    sums = reduced_sums(linear_monitor(), windows, "records")
    value, dof = decoupled(sums, (0, 1), np.ones(3))
    for w in range(3):
        G = ((A + windows.inputs["u"][w][:, None, None] * B) / NOISE[:, None]).reshape(-1, 3)
        z = (windows.y[w] / NOISE).ravel()
        assert value[w] == pytest.approx(np.linalg.lstsq(G[:, :2], z)[1][0])
    assert np.all(dof == 25 * 4 - 2)


def test_the_fault_signature_names_one_and_two_changed_parameters():
    rng = np.random.default_rng(6)
    fitted = StructuredParity(reduction="records").train(toy_monitor())
    one = fitted.diagnose(toy_windows(rng, 200, 60, {1: -0.01}))
    two = fitted.diagnose(toy_windows(rng, 200, 60, {0: -0.01, 2: -0.01}))
    assert np.mean([one.isolated_names(w) == ("hpc.efficiency",) for w in range(200)]) > 0.9
    assert np.mean([two.isolated_names(w) == ("fan.efficiency", "hpc.flow_capacity") for w in range(200)]) > 0.9
