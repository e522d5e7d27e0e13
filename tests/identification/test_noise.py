"""Noise, its correlation in time, and outliers."""

from __future__ import annotations

import numpy as np
import pytest
from identification_toy import noise as ar1

from enginediag_cli.identification.noise import (
    MAX_RHO,
    estimate_noise,
    excess_kurtosis,
    initial_noise,
    record_gaps,
)

NONE, FLOOR = np.zeros(1), np.array([1e-9])


def each_step(n):
    """Steps behind the record before, of n records of one recording."""
    return np.r_[np.inf, np.ones(n - 1)]


def test_rho_and_sigma_of_an_ar1_series_are_found():
    rng = np.random.default_rng(1)
    for rho in (0.0, 0.5, 0.9):
        e = ar1(5000, 3.0, rho, rng)[:, None]
        n = estimate_noise(e, each_step(5000), NONE, FLOOR)
        assert n.rho1[0] == pytest.approx(rho, abs=4 * np.sqrt((1 - rho**2) / 5000) + 1e-3)
        # the variance of the mean square of an AR(1) series is inflated by (1 + ρ²)/(1 − ρ²)
        spread = np.sqrt((1 + rho**2) / (1 - rho**2) / (2 * 5000))
        assert n.sigma[0] == pytest.approx(3.0, rel=4 * spread)
        assert n.n_effective[0] == pytest.approx(5000 * (1 - n.rho1[0]) / (1 + n.rho1[0]))


def test_outliers_are_counted_and_hardly_change_size_and_correlation():
    rng = np.random.default_rng(2)
    e = ar1(4000, 1.0, 0.8, rng)
    hit = rng.random(4000) < 0.05
    n = estimate_noise(np.where(hit, 50.0, e)[:, None], each_step(4000), NONE, FLOOR)
    assert n.outliers[0] == hit.sum()
    assert n.rho1[0] == pytest.approx(0.8, abs=0.04)
    # 5 % at the clip solve 0.95·0.9775/σ² + 0.05·2.5² = 0.9775: σ = 1.18, however gross they are
    assert n.sigma[0] == pytest.approx(1.18, rel=0.08)


def test_records_of_different_recordings_are_not_neighbours():
    e = np.repeat(np.random.default_rng(3).standard_normal(400), 2)[:, None]
    pairs = estimate_noise(e, record_gaps(np.tile([0.0, 1.0], 400), np.repeat(np.arange(400), 2)), NONE, FLOOR).rho1[0]
    one = estimate_noise(e, each_step(800), NONE, FLOOR).rho1[0]
    assert pairs == MAX_RHO  # both records of a recording are the same reading
    assert one == pytest.approx(0.5, abs=0.1)


def test_sigma_does_not_fall_below_its_floor():
    assert estimate_noise(np.zeros((50, 1)), each_step(50), NONE, np.array([0.2])).sigma[0] == 0.2


def test_correlation_between_sensors_is_found_over_common_records():
    rng = np.random.default_rng(4)
    e = rng.multivariate_normal([0, 0], [[1, 0.6], [0.6, 1]], 3000)
    e[::4, 1] = np.nan
    c = estimate_noise(e, each_step(3000), np.zeros(2), np.full(2, 1e-9)).correlation
    assert c[0, 1] == pytest.approx(0.6, abs=0.05)
    assert np.diag(c).tolist() == [1.0, 1.0]


def test_the_starting_noise_ignores_an_offset_of_a_whole_recording():
    rng = np.random.default_rng(5)
    recording = np.repeat([0, 1], 500)
    e = rng.standard_normal((1000, 1)) + np.where(recording == 0, -40.0, 40.0)[:, None]
    assert initial_noise(e, record_gaps(np.tile(np.arange(500.0), 2), recording), FLOOR).sigma[0] == pytest.approx(
        1.0, rel=0.1
    )


def test_the_size_of_uniform_noise_is_its_standard_deviation():
    """Four standard errors, √((2 + κ)/4n) with the excess kurtosis κ = −1.2 of the uniform law."""
    e = np.random.default_rng(6).uniform(-np.sqrt(3), np.sqrt(3), (20_000, 1))
    n = estimate_noise(e, each_step(20_000), NONE, FLOOR)
    assert n.sigma[0] == pytest.approx(1.0, abs=4 * np.sqrt(0.8 / 80_000))
    assert n.kurtosis[0] == pytest.approx(-1.2, abs=0.05)


def test_the_law_of_what_is_new_in_a_reading_is_found_in_correlated_noise_too():
    rng = np.random.default_rng(7)
    shocks = rng.uniform(-1, 1, (5000, 4))
    e = np.zeros_like(shocks)
    for k in range(1, 5000):
        e[k] = 0.8 * e[k - 1] + shocks[k]
    found = estimate_noise(e, each_step(5000), np.zeros(4), np.full(4, 1e-9))
    assert found.kurtosis == pytest.approx(np.full(4, -1.2), abs=0.15)


def test_kurtosis_that_may_be_chance_is_drawn_to_that_of_gaussian_noise():
    rng = np.random.default_rng(8)
    found = np.array([excess_kurtosis(rng.standard_normal((100, 6))) for _ in range(100)])
    # the sample's own scatters by √(24/100) = 0.49
    assert np.median(np.abs(found)) < 0.1
    assert excess_kurtosis(np.full((5, 2), np.nan)).tolist() == [0.0, 0.0]


def test_few_correlated_records_leave_correlation_and_its_error_as_they_are_over_many_tries():
    """Four sensors of the same ρ: the mean is right within four standard errors, and scatters as is stated."""
    rng, n, rho, tries = np.random.default_rng(9), 300, 0.9, 60
    means, stated = [], []
    for _ in range(tries):
        e = np.column_stack([ar1(n, 1.0, rho, rng) for _ in range(4)])
        found = estimate_noise(e, each_step(n), np.zeros(4), np.full(4, 1e-9))
        means.append(found.rho1.mean())
        stated.append(np.sqrt(np.mean(found.rho1_error**2) / 4 + np.mean(found.rho1_common) ** 2))
    assert abs(np.mean(means) - rho) < 4 * np.std(means) / np.sqrt(tries)
    assert np.std(means) == pytest.approx(np.mean(stated), rel=0.4)


def test_what_is_new_in_a_reading_has_its_variance_over_many_tries():
    """σ² (1 − ρ²), which the sums give without bias: a ratio of them that is corrected for its own must not enter."""
    rng, rho, tries, m = np.random.default_rng(12), 0.9, 60, 12
    for n in (100, 400):
        found = []
        for _ in range(tries):
            e = np.column_stack([ar1(n, 1.0, rho, rng) for _ in range(m)])
            noise = estimate_noise(e, each_step(n), np.zeros(m), np.full(m, 1e-9))
            found.append(np.mean(noise.sigma**2 * (1 - noise.rho1**2)) / (1 - rho**2))
        # one degree of freedom at most goes to ρ
        assert abs(np.mean(found) - 1.0) < 4 * np.std(found) / np.sqrt(tries) + 1 / n


def test_what_the_fit_took_out_of_the_sums_is_put_back():
    """A mean of AR(1) noise takes (1 + ρ)/(1 − ρ) variances out of the sum of squares and of neighbours' products."""
    rng, n, rho, tries = np.random.default_rng(10), 200, 0.8, 200
    sizes = []
    for _ in range(tries):
        e = ar1(n, 1.0, rho, rng)
        kappa = (1 + rho) / (1 - rho)
        found = estimate_noise((e - e.mean())[:, None], each_step(n), np.full(1, kappa), FLOOR)
        sizes.append([found.sigma[0] ** 2, found.rho1[0]])
    mean, error = np.mean(sizes, axis=0), np.std(sizes, axis=0) / np.sqrt(tries)
    assert np.all(np.abs(mean - [1.0, rho]) < 4 * error + [0.0, 0.005])


def test_correlation_scatters_as_stated_where_few_records_have_a_neighbour():
    rng, rho, n = np.random.default_rng(31), 0.65, 250
    found = []
    for _ in range(300):
        e = ar1(n, 1.0, rho, rng)
        gap = np.where(rng.random(n) < 0.25, 1.0, 8.0)
        gap[0] = np.inf
        estimate = estimate_noise(e[:, None], gap, NONE, FLOOR)
        found.append((estimate.rho1[0], estimate.rho1_error[0]))
    values, errors = np.array(found).T
    assert values.mean() == pytest.approx(rho, abs=0.02)
    assert values.std() == pytest.approx(errors.mean(), rel=0.2)
