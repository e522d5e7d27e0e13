"""Noise, its correlation in time, and outliers."""

from __future__ import annotations

import numpy as np
import pytest
from identification_toy import noise as ar1

from enginediag_cli.identification.noise import MAX_RHO, estimate_noise, starting_noise

NONE, FLOOR = np.zeros(1), np.array([1e-9])


def test_rho_and_sigma_of_an_ar1_series_are_found():
    rng = np.random.default_rng(1)
    for rho in (0.0, 0.5, 0.9):
        e = ar1(5000, 3.0, rho, rng)[:, None]
        n = estimate_noise(e, np.zeros(5000, int), NONE, FLOOR)
        assert n.rho1[0] == pytest.approx(rho, abs=4 * np.sqrt((1 - rho**2) / 5000) + 1e-3)
        # the variance of the mean square of an AR(1) series is inflated by (1 + ρ²)/(1 − ρ²)
        spread = np.sqrt((1 + rho**2) / (1 - rho**2) / (2 * 5000))
        assert n.sigma[0] == pytest.approx(3.0, rel=4 * spread)
        assert n.n_effective[0] == pytest.approx(5000 * (1 - n.rho1[0]) / (1 + n.rho1[0]))


def test_outliers_are_counted_and_hardly_change_size_and_correlation():
    rng = np.random.default_rng(2)
    e = ar1(4000, 1.0, 0.8, rng)
    hit = rng.random(4000) < 0.05
    n = estimate_noise(np.where(hit, 50.0, e)[:, None], np.zeros(4000, int), NONE, FLOOR)
    assert n.outliers[0] == hit.sum()
    assert n.rho1[0] == pytest.approx(0.8, abs=0.04)
    # 5 % at the clip solve 0.95·0.9775/σ² + 0.05·2.5² = 0.9775: σ = 1.18, however gross they are
    assert n.sigma[0] == pytest.approx(1.18, rel=0.08)


def test_records_of_different_recordings_are_not_neighbours():
    e = np.repeat(np.random.default_rng(3).standard_normal(400), 2)[:, None]
    pairs = estimate_noise(e, np.repeat(np.arange(400), 2), NONE, FLOOR).rho1[0]
    one = estimate_noise(e, np.zeros(800, int), NONE, FLOOR).rho1[0]
    assert pairs == MAX_RHO  # both records of a recording are the same reading
    assert one == pytest.approx(0.5, abs=0.1)


def test_sigma_does_not_fall_below_its_floor():
    assert estimate_noise(np.zeros((50, 1)), np.zeros(50, int), NONE, np.array([0.2])).sigma[0] == 0.2


def test_correlation_between_sensors_is_found_over_common_records():
    rng = np.random.default_rng(4)
    e = rng.multivariate_normal([0, 0], [[1, 0.6], [0.6, 1]], 3000)
    e[::4, 1] = np.nan
    c = estimate_noise(e, np.zeros(3000, int), np.zeros(2), np.full(2, 1e-9)).correlation
    assert c[0, 1] == pytest.approx(0.6, abs=0.05)
    assert np.diag(c).tolist() == [1.0, 1.0]


def test_the_starting_noise_ignores_an_offset_of_a_whole_recording():
    rng = np.random.default_rng(5)
    recording = np.repeat([0, 1], 500)
    e = rng.standard_normal((1000, 1)) + np.where(recording == 0, -40.0, 40.0)[:, None]
    assert starting_noise(e, recording, FLOOR).sigma[0] == pytest.approx(1.0, rel=0.1)
