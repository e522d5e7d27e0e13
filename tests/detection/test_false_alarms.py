"""Realised false-alarm rates are the stated ones, also with noise and nominal identified from few records."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import f as f_law

from enginediag_cli.detection.glr import critical_value, glr_test, noise_correction, threshold
from enginediag_cli.residuals.local import local_statistics
from enginediag_cli.residuals.noise import NoiseModel
from enginediag_cli.residuals.score import fisher_score

ROOT = Path(__file__).resolve().parents[2]


def score_of(rng, G, sigma, readings):
    noise = NoiseModel(sigma, np.zeros(len(sigma)), readings=readings)
    e = rng.standard_normal(G.shape[:2])
    return fisher_score(
        local_statistics(e, G, noise, parameters=("a", "b"), theta0=np.zeros(2), prior_sigma=np.ones(2))
    )


def test_one_sensor_of_estimated_noise_gives_the_exact_f_test():
    rng = np.random.default_rng(1)
    score = score_of(rng, rng.standard_normal((20, 1, 2)), np.ones(1), np.array([15.0]))
    scale, nu = noise_correction(score.rank, (score.doubt[0], score.doubt[1]))
    # ρ was estimated too, which adds to the doubt about σ: the corrected test is no bolder than F(2, 15)
    assert critical_value(score, 0.01) >= 0.97 * 2 * f_law.isf(0.01, 2, 15)
    assert nu < 20 and 0.8 < scale < 1.1


def test_noise_that_is_known_leaves_the_chi_square_test_as_it_is():
    rng = np.random.default_rng(2)
    score = score_of(rng, rng.standard_normal((20, 1, 2)), np.ones(1), None)
    assert critical_value(score, 0.01) == threshold(2, 0.01)
    assert glr_test(score, 0.01).threshold == threshold(2, 0.01)


def test_estimated_noise_does_not_raise_false_alarms():
    rng, trials, alarms = np.random.default_rng(3), 2000, 0
    G = rng.standard_normal((15, 3, 2))
    for _ in range(trials):
        sigma = np.sqrt(rng.chisquare(12, 3) / 12)
        alarms += bool(glr_test(score_of(rng, G, sigma, np.full(3, 12.0)), 0.01).alarm)
    assert alarms <= binom.ppf(0.999, trials, 0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind, rho, records",
    [
        ("gaussian", 0.0, None),
        ("uniform", 0.0, None),
        ("gaussian", 0.9, None),
        ("gaussian", 0.0, 300),
        ("gaussian", 0.5, 300),
    ],
)
def test_rates_over_a_hundred_thousand_windows_of_real_flight_phases(kind, rho, records):
    spec = importlib.util.spec_from_file_location("false_alarms", ROOT / "tests" / "benchmarks" / "false_alarms.py")
    study = importlib.util.module_from_spec(spec)
    sys.modules["false_alarms"] = study
    spec.loader.exec_module(study)
    flown = study.fly(ROOT / "configs" / "turbofan.yaml")
    for phase in study.PHASES:
        alarms, judged = study.tested(np.random.default_rng(7), flown, phase, kind, rho, records, windows=100_000,
                                      length=30)
        for hits, rate in zip(alarms.T, study.RATES, strict=True):
            # windows judged against one identified nominal share its error, which more windows do not average out
            spread = 1.2 if records else 1.0
            low, high = binom.ppf([1e-3, 1 - 1e-3], judged.sum(), rate)
            assert low / spread <= hits.sum() <= high * spread, (phase, rate, hits.sum() / judged.sum())
