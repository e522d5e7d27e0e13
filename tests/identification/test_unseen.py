"""Noise as later stages must expect it."""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.noise import cross_validated_noise, estimate_noise


def each_step(n):
    """Steps behind the record before, of n records of one recording."""
    return np.r_[np.inf, np.ones(n - 1)]


def test_the_scale_is_the_root_mean_square_with_the_worst_readings_in_it():
    rng = np.random.default_rng(1)
    e = rng.normal(0.0, 1.0, (400, 2))
    e[200:210, 0] = 12.0
    e[5, 1] = np.nan
    found = cross_validated_noise(e, each_step(400), np.array([0.1, 0.1]))
    np.testing.assert_allclose(found.sigma, np.sqrt(np.nanmean(e**2, axis=0)))
    assert found.sigma[0] > 1.5 * estimate_noise(e, each_step(400), np.zeros(2), np.full(2, 0.1)).sigma[0]


def test_prediction_is_never_taken_for_better_than_the_fit():
    e = np.full((50, 1), 0.01)
    assert cross_validated_noise(e, each_step(50), np.array([0.3])).sigma[0] == 0.3


def test_slow_errors_show_as_correlation_from_record_to_record():
    rng = np.random.default_rng(2)
    e = np.zeros((4000, 1))
    for k in range(1, 4000):
        e[k] = 0.8 * e[k - 1] + rng.normal()
    found = cross_validated_noise(e, each_step(4000), np.array([0.1]))
    assert abs(found.rho1[0] - 0.8) < 0.04  # four standard errors, √((1 − ρ²)/n)
