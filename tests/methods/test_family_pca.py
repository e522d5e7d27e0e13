"""Principal component analysis as residual."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from family_windows import linear_monitor, linear_windows, toy_windows, within_binomial
from toy_engine import toy_monitor

from enginediag_cli.errors import DataError
from enginediag_cli.methods.base import RecordWindows
from enginediag_cli.methods.residual_tests import PrincipalComponents, _spe_test


@pytest.fixture(scope="module")
def fitted():
    """Raw data of the linear engine with a common factor, so that a principal subspace exists."""
    return PrincipalComponents(components=2).train(linear_monitor(), common_factor(np.random.default_rng(1), 2000))


def common_factor(rng, W, n=20):
    windows = linear_windows(rng, W, n)
    load = rng.standard_normal((W, n, 1))
    return RecordWindows({"u": windows.inputs["u"]}, windows.y + load * np.array([3.0, -2.0, 5.0, 1.0]))


@pytest.mark.parametrize("limit", ["jackson_mudholkar", "box"])
def test_false_alarms_of_both_statistics_are_nominal_within_four_binomial_errors(fitted, limit):
    chosen = replace(fitted, method=replace(fitted.method, spe_limit=limit))
    result = chosen.diagnose(common_factor(np.random.default_rng(2), 4000), 0.1)
    for test in result.tests:
        assert within_binomial(test.alarm, 0.05), test.name


def test_spe_ignores_changes_within_the_principal_subspace_and_t2_sees_them(fitted):
    windows = common_factor(np.random.default_rng(3), 50)
    step = fitted.scale * (fitted.loadings @ np.array([1.0, -2.0]))
    moved = RecordWindows({"u": windows.inputs["u"] + step[0]}, windows.y + step[1:])
    before, after = fitted.diagnose(windows), fitted.diagnose(moved)
    np.testing.assert_allclose(after.tests[1].statistic, before.tests[1].statistic, rtol=1e-9)
    assert np.all(after.tests[0].statistic > 5 * np.median(before.tests[0].statistic))


def test_a_change_within_the_residual_subspace_leaves_t2_alone(fitted):
    windows = common_factor(np.random.default_rng(4), 50)
    away = np.linalg.qr(np.column_stack([fitted.loadings, np.eye(5)]))[0][:, 3]
    step = fitted.scale * away
    moved = RecordWindows({"u": windows.inputs["u"] + step[0]}, windows.y + step[1:])
    before, after = fitted.diagnose(windows), fitted.diagnose(moved)
    np.testing.assert_allclose(after.tests[0].statistic, before.tests[0].statistic, rtol=1e-8)
    assert np.all(after.tests[1].alarm)


def test_contributions_sum_to_the_statistics(fitted):
    v = np.random.default_rng(5).standard_normal((30, 5))
    t_squared, spe = fitted.distances(v)
    t_parts, spe_parts = fitted.contributions(v)
    np.testing.assert_allclose(t_parts.sum(axis=1), t_squared)
    np.testing.assert_allclose(spe_parts.sum(axis=1), spe)


@pytest.mark.parametrize("limit", ["jackson_mudholkar", "box"])
def test_spe_limits_are_quantiles_of_the_weighted_chi_square_to_six_per_cent(limit):
    spectrum = np.array([2.0, 1.0, 0.7, 0.2, 0.0])
    sample = np.random.default_rng(6).standard_normal((400_000, 5)) ** 2 @ spectrum
    for level in (0.05, 0.01):
        test = _spe_test(np.array([np.quantile(sample, 1 - level)]), spectrum, limit, level)
        assert test.threshold[0] == pytest.approx(np.quantile(sample, 1 - level), rel=0.06)
        assert test.p_value[0] == pytest.approx(level, rel=0.35)


def test_it_names_the_sensor_that_is_wrong_after_the_model_has_removed_the_operating_condition():
    rng = np.random.default_rng(7)
    fitted = PrincipalComponents(data="corrected").train(toy_monitor(), toy_windows(rng, 200, 30))
    windows = toy_windows(rng, 100, 30)
    windows.y[:, :, 2] += 4.0  # T5_K: two standard deviations
    result = fitted.diagnose(windows)
    assert result.kind == "sensors"
    assert np.mean([result.isolated_names(w) == ("T5_K",) for w in range(100)]) > 0.95


def test_raw_data_hide_in_the_operating_condition_what_corrected_data_show():
    rng = np.random.default_rng(8)
    healthy, faulty = toy_windows(rng, 200, 30), toy_windows(rng, 200, 30, {1: -0.003})
    raw, corrected = (
        PrincipalComponents(data=d).train(toy_monitor(), healthy).diagnose(faulty).alarm.mean()
        for d in ("raw", "corrected")
    )
    assert raw < 0.3 and corrected > 0.9


def test_too_little_healthy_data_is_refused():
    rng = np.random.default_rng(9)
    with pytest.raises(DataError, match="none were given"):
        PrincipalComponents().train(linear_monitor())
    with pytest.raises(DataError, match="more than 10 complete healthy records, not 8"):
        PrincipalComponents().train(linear_monitor(), linear_windows(rng, 2, 4))
    with pytest.raises(DataError, match="more than 5 healthy windows, not 4"):
        PrincipalComponents().train(linear_monitor(), linear_windows(rng, 4, 19))


def test_an_input_that_never_changes_is_silent():
    rng = np.random.default_rng(10)

    def with_constant(windows):
        return RecordWindows({**windows.inputs, "humidity": np.full(windows.y.shape[:2], 0.01)}, windows.y)

    healthy, other = common_factor(rng, 300), common_factor(rng, 20)
    plain = PrincipalComponents(components=2).train(linear_monitor(), healthy).diagnose(other)
    extra = (
        PrincipalComponents(components=2).train(linear_monitor(), with_constant(healthy)).diagnose(with_constant(other))
    )
    for a, b in zip(plain.tests, extra.tests, strict=True):
        np.testing.assert_allclose(a.statistic, b.statistic, rtol=1e-8)
        np.testing.assert_allclose(a.threshold, b.threshold, rtol=1e-8)
    with pytest.raises(ValueError, match="vary in 5 directions"):
        PrincipalComponents(components=5).train(linear_monitor(), with_constant(healthy))


def test_two_long_healthy_windows_are_as_good_as_many_short_ones():
    rng = np.random.default_rng(11)
    fitted = PrincipalComponents(components=2).train(linear_monitor(), common_factor(rng, 2, 4000))
    assert fitted.windows == 20
    result = fitted.diagnose(common_factor(rng, 500, 20), 0.05)
    assert result.alarm.mean() < 0.15
