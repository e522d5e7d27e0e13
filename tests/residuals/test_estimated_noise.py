"""How far noise is to be trusted depends on where it comes from."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from white_statistics import local_statistics

from enginediag_cli.identification.nominal import SensorNoise
from enginediag_cli.residuals.flat import flat_row, read_flat
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.monitor import noise_model
from enginediag_cli.residuals.score import fisher_score, marginalise
from enginediag_cli.residuals.statistics import ParameterFrame, independent_rows
from enginediag_cli.residuals.windows import WindowStatistics

RHO = 0.9


def noise_from(sigma_from, **values):
    sensor = SensorNoise("T3_K", 2.0, RHO, 200, 10.0, 0, sigma_from, 190.0, 0.03, 0.01, -1.0)
    return noise_model(SimpleNamespace(noise=(sensor,)), ("T3_K",))


def statistics(noise, rng):
    return local_statistics(
        np.zeros((30, 1)), rng.standard_normal((30, 1, 2)), noise, ParameterFrame(("a", "b"), np.zeros(2), np.ones(2))
    )


def test_the_variance_that_a_fit_left_is_as_uncertain_as_its_degrees_of_freedom_make_it():
    noise = noise_from("fit")
    errors, _ = noise.doubt(1)
    # of one record, log σ² = log σ_ε² − log(1 − ρ²): variances (2 + κ)/n and (2ρ/(1 − ρ²))² var ρ
    slope = 2 * RHO / (1 - RHO**2)
    assert errors[:, 0] == pytest.approx([np.sqrt(1.0 / 190 + (0.03 * slope) ** 2), 0.01 * slope], rel=1e-4)


def test_the_variance_of_a_sensor_as_stated_is_certain_and_its_correlation_is_not():
    noise = noise_from("stated")
    assert noise.doubt(1)[0] == pytest.approx(0.0, abs=1e-9)  # ρ does not matter for one record
    assert noise.doubt(30)[0][0, 0] > 0


def test_errors_of_prediction_are_a_bound_and_leave_the_chi_square_test():
    noise = noise_from("cross_validation")
    assert noise.doubt(30) is None and noise.kurtosis is None
    assert fisher_score(statistics(noise, np.random.default_rng(1))).doubt == (0.0, 0.0, 0.0)


def test_a_nominal_file_that_does_not_say_has_certain_noise():
    noise = noise_model(SimpleNamespace(noise=(SensorNoise("T3_K", 2.0, RHO, 200, 10.0, 0),)), ("T3_K",))
    assert noise.doubt(30) is None and noise.kurtosis is None


def test_the_bias_of_the_estimated_variance_is_its_curvature_in_rho():
    """10 million draws of ρ̂ would do; the second order does too, within 2 % at so small an error."""
    noise = NoiseModel(np.ones(1), np.full(1, RHO), readings=np.full(1, 1e9), rho_error=np.full(1, 0.01))
    rho = RHO + 0.01 * np.random.default_rng(2).standard_normal(400_000)
    n = 30
    v = ((1 + rho) / (1 - rho) - 2 * rho * (1 - rho**n) / (n * (1 - rho) ** 2)) / (1 - rho**2)
    v0 = ((1 + RHO) / (1 - RHO) - 2 * RHO * (1 - RHO**n) / (n * (1 - RHO) ** 2)) / (1 - RHO**2)
    assert noise.doubt(n)[1][0] == pytest.approx(v.mean() / v0 - 1, rel=0.1)


def test_an_error_that_all_sensors_share_counts_for_more_than_errors_of_their_own():
    rng = np.random.default_rng(3)
    G = rng.standard_normal((30, 6, 2))

    def doubt(own, common):
        noise = NoiseModel(
            np.ones(6),
            np.full(6, RHO),
            readings=np.full(6, 1e9),
            rho_error=np.full(6, own),
            rho_common=np.full(6, common),
        )
        found = local_statistics(np.zeros((30, 6)), G, noise, ParameterFrame(("a", "b"), np.zeros(2), np.ones(2)))
        return fisher_score(found).doubt

    assert doubt(0.0, 0.02)[0] > 3 * doubt(0.02, 0.0)[0]


def test_independent_rows_give_the_covariance_of_correlated_noise():
    rng = np.random.default_rng(4)
    G, lags = rng.standard_normal((12, 2, 3)), np.array([np.inf, 1, 1, 3, 1, np.inf, 1, 2, 1, 1, 1, 1])
    rho = np.array([0.8, -0.1])
    rows = independent_rows(G, rho, lags)
    clock = np.cumsum(np.where(np.isfinite(lags), lags, 1000))
    for j in range(2):
        lag = np.abs(np.subtract.outer(clock, clock))
        expected = G[:, j].T @ np.where(lag < 500, rho[j] ** lag, 0.0) @ G[:, j]
        np.testing.assert_allclose(rows[:, j].T @ rows[:, j], expected, rtol=1e-10, atol=1e-12)


def test_doubt_about_the_noise_survives_the_file_of_statistics():
    found = marginalise(statistics(noise_from("fit"), np.random.default_rng(5)), ("a", "b"), np.zeros((2, 2)))
    assert found.doubt[0] > 0 and found.doubt[2] < 0
    window = WindowStatistics("file", "", "", 1, 30, 0.0, 29.0, 30, 0, 0, 0, found)
    row = {k: repr(float(v)) if isinstance(v, float) else str(v) for k, v in flat_row(window).items()}
    ((again, _),) = read_flat([row], "file", [2])
    assert again.statistics.doubt == found.doubt
    old = {k: v for k, v in row.items() if not k.startswith("noise_")}
    ((again, _),) = read_flat([old], "file", [2])
    assert again.statistics.doubt == (0.0, 0.0, 0.0)
