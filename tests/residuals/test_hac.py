"""The kernel estimate of the long-run covariance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from enginediag_cli.residuals.hac import hac_covariance, newey_west_bandwidth


def test_with_no_lags_it_is_the_covariance_of_independent_records():
    K = np.random.default_rng(1).standard_normal((200, 3))
    np.testing.assert_allclose(hac_covariance(K, 0), 200 * np.cov(K.T, bias=True))


def test_it_finds_the_long_run_variance_of_autoregressive_noise():
    rng = np.random.default_rng(2)
    rho, found = 0.6, []
    for _ in range(40):
        x = lfilter([1], [1, -rho], rng.standard_normal(4100))[100:]
        found.append(hac_covariance(x[:, None])[0, 0] / 4000)
    truth = 1 / (1 - rho) ** 2
    # the Bartlett kernel is biased low by a few per cent at this length
    assert np.mean(found) == pytest.approx(truth, rel=0.15)


def test_the_bandwidth_grows_with_correlation_in_time():
    rng = np.random.default_rng(3)
    white = rng.standard_normal((2000, 1))
    slow = lfilter([1], [1, -0.9], white, axis=0)
    assert newey_west_bandwidth(white) < newey_west_bandwidth(slow)
