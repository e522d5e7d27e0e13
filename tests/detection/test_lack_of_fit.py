"""Lack of fit is told apart from a change of parameters."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom
from white_statistics import local_statistics, white_noise

from enginediag_cli.detection.verdict import glr_test, lack_of_fit
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame


def statistics(e, J):
    return local_statistics(
        e, J, white_noise(np.ones(e.shape[1])), ParameterFrame(("a", "b"), np.ones(2), np.full(2, 0.02))
    )


def test_the_rest_is_the_residual_sum_of_squares_of_least_squares():
    rng = np.random.default_rng(1)
    e, J = rng.standard_normal((30, 3)), rng.standard_normal((30, 3, 2))
    rest = np.linalg.lstsq(J.reshape(-1, 2), e.ravel(), rcond=None)[1][0]
    found = lack_of_fit(statistics(e, J))
    assert found.statistic == pytest.approx(rest)
    assert found.dof == 88
    assert found.ratio == pytest.approx(rest / 88)


def test_a_change_of_parameters_is_no_lack_of_fit_and_missing_physics_is():
    rng = np.random.default_rng(2)
    J = rng.standard_normal((100, 3, 2))
    changed = statistics(rng.standard_normal((100, 3)) + J @ [1.0, -1.0], J)
    assert lack_of_fit(changed).p_value > 0.001 and glr_test(fisher_score(changed)).alarm
    wavy = statistics(rng.standard_normal((100, 3)) + 2 * np.sin(np.arange(100))[:, None], J)
    assert lack_of_fit(wavy).p_value < 1e-6


def test_a_right_model_is_rejected_as_often_as_stated():
    rng = np.random.default_rng(3)
    J = rng.standard_normal((20, 3, 2))
    rejected = sum(lack_of_fit(statistics(rng.standard_normal((20, 3)), J)).p_value < 0.05 for _ in range(600))
    low, high = binom.ppf([0.001, 0.999], 600, 0.05)
    assert low <= rejected <= high


def test_with_no_measurement_to_spare_there_is_no_verdict():
    e, J = np.ones((1, 2)), np.eye(2)[None]
    assert np.isnan(lack_of_fit(statistics(e, J)).p_value)
