from __future__ import annotations

import numpy as np
import pytest
from simulation_toy import SENSORS, ToyEngine

from enginediag_cli.errors import ConfigError
from enginediag_cli.simulation.flights import KINDS, NONE, ColumnNoise, column_noise, noise_sources


def draw(noise: ColumnNoise, n: int, seed: int = 0, chunks: int = 1) -> np.ndarray:
    source = noise_sources({"T3_K": noise}, np.random.default_rng(seed))["T3_K"]
    return np.concatenate([source.apply(part) for part in np.array_split(np.full(n, 700.0), chunks)]) - 700.0


def test_gaussian_noise_has_the_given_standard_deviation():
    x = draw(ColumnNoise(sigma=2.0), 40_000)
    # standard error of a standard deviation: σ/√(2n) = 0.0071; four of them
    assert x.std() == pytest.approx(2.0, abs=0.03) and abs(x.mean()) < 4 * 2.0 / 200


def test_uniform_noise_fills_its_range_and_has_the_standard_deviation_of_a_uniform():
    x = draw(ColumnNoise("uniform", width=7.0), 40_000)
    assert -3.5 <= x.min() < -3.49 and 3.49 < x.max() <= 3.5
    assert x.std() == pytest.approx(7.0 / np.sqrt(12.0), rel=0.01)


def test_correlated_noise_is_stationary_from_the_first_record_on():
    # variance at record 0, 1, 5 and 50 over 4000 seeds; standard error of a variance: σ²√(2/n) = 0.022
    starts = np.array([draw(ColumnNoise(sigma=1.0, correlation=0.9), 51, seed) for seed in range(4000)])
    np.testing.assert_allclose(starts[:, [0, 1, 5, 50]].var(axis=0), 1.0, atol=4 * 0.0224)


def test_correlated_noise_has_the_autocorrelation_of_its_law():
    x = draw(ColumnNoise(sigma=3.0, correlation=0.8), 100_000)
    measured = [np.mean(x[:-lag] * x[lag:]) / np.mean(x * x) for lag in (1, 2, 3)]
    # Bartlett: standard error of r_1 is √((1 − ρ²)/n) = 0.002, of r_3 at most √((1+ρ²)/(1−ρ²)/n) = 0.007
    np.testing.assert_allclose(measured, [0.8, 0.64, 0.512], atol=0.015)


def test_white_noise_has_no_autocorrelation():
    x = draw(ColumnNoise(sigma=1.0), 40_000)
    assert abs(np.mean(x[1:] * x[:-1])) < 4 / 200


@pytest.mark.parametrize(
    "noise",
    [
        ColumnNoise(sigma=2.0),
        ColumnNoise("uniform", width=2.0),
        ColumnNoise(sigma=2.0, correlation=0.7),
        ColumnNoise(sigma=1.0, outlier_probability=0.1, outlier_size=20.0, quantum=0.5),
    ],
)
def test_same_seed_gives_same_bytes_however_the_recording_is_cut(noise):
    assert draw(noise, 5000).tobytes() == draw(noise, 5000, chunks=7).tobytes()
    assert draw(noise, 5000).tobytes() != draw(noise, 5000, seed=1).tobytes()


def test_adding_a_sensor_leaves_the_noise_of_the_others():
    few = noise_sources({"T3_K": ColumnNoise(sigma=1.0)}, np.random.default_rng(5))
    many = noise_sources({s: ColumnNoise(sigma=1.0) for s in reversed(SENSORS)}, np.random.default_rng(5))
    zero = np.zeros(100)
    noise = {column: source.apply(zero) for column, source in many.items()}
    np.testing.assert_array_equal(few["T3_K"].apply(zero), noise["T3_K"])
    assert len({values.tobytes() for values in noise.values()}) == len(SENSORS)


def test_readings_are_multiples_of_the_quantum():
    source = noise_sources({"x": ColumnNoise(sigma=1.0, quantum=0.25)}, np.random.default_rng(0))["x"]
    x = source.apply(np.linspace(0.0, 10.0, 500))
    np.testing.assert_array_equal(x, 0.25 * np.round(x / 0.25))


def test_quantised_kind_has_the_rounding_error_of_the_sensors_sigma():
    engine = ToyEngine()
    one = column_noise({**KINDS["quantised"]}, engine)["T3_K"]
    source = noise_sources({"T3_K": one}, np.random.default_rng(0))["T3_K"]
    true = np.linspace(400.0, 800.0, 50_000)
    assert (source.apply(true) - true).std() == pytest.approx(engine.sensors["T3_K"].noise_sigma, rel=0.01)


def test_outliers_come_as_often_and_as_large_as_asked():
    x = draw(ColumnNoise(sigma=1e-9, outlier_probability=0.02, outlier_size=50.0), 20_000)
    struck = np.abs(x) > 1.0
    # binomial: mean 400, standard deviation 19.8; four of them
    assert abs(struck.sum() - 400) < 80
    np.testing.assert_allclose(np.abs(x[struck]), 50.0, atol=1e-6)


def test_missing_readings_stay_missing_and_shift_nothing():
    reading = np.full(50, 700.0)
    reading[10] = np.nan
    source = noise_sources({"T3_K": ColumnNoise(sigma=1.0)}, np.random.default_rng(0))["T3_K"]
    x = source.apply(reading) - 700.0
    assert np.isnan(x[10])
    np.testing.assert_array_equal(np.delete(x, 10), np.delete(draw(ColumnNoise(sigma=1.0), 50), 10))


def test_uniform_kind_spans_one_percent_of_the_maximum_reading_as_in_the_paper():
    engine = ToyEngine()
    noise = column_noise(KINDS["uniform"], engine)
    assert noise["P3_Pa"].width == pytest.approx(0.01 * engine.sensors["P3_Pa"].maximum)


def test_noise_on_a_misspelt_column_names_the_near_one():
    with pytest.raises(ConfigError, match="T45_K"):
        column_noise({**NONE, "columns": {"T45_k": _own()}}, ToyEngine())


def test_noise_both_uniform_and_correlated_is_refused():
    with pytest.raises(ConfigError, match="both uniform and correlated"):
        column_noise({**KINDS["uniform"], "correlation": 0.5}, ToyEngine())


def test_an_input_needs_its_own_size_of_noise():
    with pytest.raises(ConfigError, match="Wf_kg_s: the size of its noise is not known"):
        column_noise({**NONE, "columns": {"Wf_kg_s": _own()}}, ToyEngine())
    own = column_noise({**NONE, "columns": {"Wf_kg_s": _own(sigma=0.01)}}, ToyEngine())
    assert own["Wf_kg_s"].sigma == 0.01


def _own(**more):
    return {
        "type": "gaussian",
        "sigma": None,
        "width": None,
        "quantum": 0.0,
        "correlation": 0.0,
        "outlier_probability": 0.0,
        "outlier_sigmas": 20.0,
        **more,
    }
