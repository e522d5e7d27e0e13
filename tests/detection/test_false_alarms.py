"""Realised false-alarm rates are the stated ones, also with noise and nominal identified from few records."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom
from scipy.stats import f as f_law
from white_statistics import local_statistics

from enginediag_cli.detection.verdict import (
    HEALTHY,
    NO_VERDICT,
    NOTHING_REQUIRED,
    critical_value,
    effective_rank,
    glr_test,
    is_noise_unknown,
    judge,
    noise_correction,
    p_value,
    threshold,
)
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame
from enginediag_cli.residuals.windows import WindowStatistics

ROOT = Path(__file__).resolve().parents[2]


def statistics_of(e, G, noise):
    return local_statistics(e, G, noise, ParameterFrame(("a", "b"), np.zeros(2), np.ones(2)))


def score_of(rng, G, sigma, readings):
    noise = NoiseModel(sigma, np.zeros(len(sigma)), readings=readings)
    return fisher_score(statistics_of(rng.standard_normal(G.shape[:2]), G, noise))


def test_one_sensor_of_estimated_noise_gives_the_exact_f_test():
    rng = np.random.default_rng(1)
    score = score_of(rng, rng.standard_normal((20, 1, 2)), np.ones(1), np.array([15.0]))
    scale, nu = noise_correction(score.rank, score.doubt)
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


def test_the_threshold_is_where_the_p_value_is_the_false_alarm_rate():
    rng = np.random.default_rng(4)
    G = rng.standard_normal((8, 3, 2))
    for readings in (None, np.full(3, 40.0)):
        noise = NoiseModel(np.ones(3), np.full(3, 0.4), readings=readings, kurtosis=np.array([-1.2, 0.0, 2.0]))
        score = fisher_score(statistics_of(np.zeros((8, 3)), G, noise))
        for rate in (0.05, 0.001):
            assert p_value(critical_value(score, rate), score) == pytest.approx(rate, rel=1e-6)


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_the_statistic_scatters_as_the_kurtosis_of_the_noise_says(rho):
    """var t = 2r + Q; the sample variance of 40,000 has a relative standard error of about 1 %."""
    rng, n, trials = np.random.default_rng(5), 12, 40_000
    G = np.cumsum(rng.standard_normal((n, 2, 2)), axis=0)
    noise = NoiseModel(np.ones(2), np.full(2, rho), kurtosis=np.full(2, -1.2))
    shocks = rng.uniform(-np.sqrt(3), np.sqrt(3), (trials, n, 2))
    e = np.empty_like(shocks)
    e[:, 0] = shocks[:, 0]
    for k in range(1, n):
        e[:, k] = rho * e[:, k - 1] + np.sqrt(1 - rho**2) * shocks[:, k]
    score = fisher_score(statistics_of(np.zeros((n, 2)), G, noise))
    s = np.einsum("tkj,kjp->tp", e / noise.inflation, G)
    V = statistics_of(np.zeros((n, 2)), G, noise).V
    t = np.einsum("tp,pq,tq->t", s, np.linalg.inv(V), s)
    expected = 2 * score.rank + score.doubt[2]
    assert score.doubt[2] < -0.1
    assert np.var(t) == pytest.approx(expected, rel=0.04)
    assert effective_rank(score.rank, score.doubt) == pytest.approx(2 * score.rank**2 / expected)


def test_statistics_of_two_stretches_know_the_law_of_the_noise_of_both():
    rng = np.random.default_rng(6)
    G = rng.standard_normal((20, 3, 2))
    noise = NoiseModel(np.ones(3), np.zeros(3), kurtosis=np.full(3, -1.2))
    e = np.zeros((20, 3))
    whole = statistics_of(e, G, noise)
    parts = statistics_of(e[:9], G[:9], noise) + statistics_of(e[9:], G[9:], noise)
    assert fisher_score(parts).doubt == pytest.approx(fisher_score(whole).doubt)


def test_noise_known_from_too_few_records_gives_no_verdict():
    rng = np.random.default_rng(7)
    G = rng.standard_normal((20, 1, 2))
    for readings, verdict in ((2.0, NO_VERDICT), (200.0, HEALTHY)):
        noise = NoiseModel(np.ones(1), np.zeros(1), readings=np.array([readings]))
        found = statistics_of(0.5 * rng.standard_normal((20, 1)), G, noise)
        assert is_noise_unknown(fisher_score(found)) == (verdict == NO_VERDICT)
        judged = judge(replace(WINDOW, statistics=found), required=NOTHING_REQUIRED)
        assert judged.verdict == verdict
        assert ("too few independent records" in judged.reason) == (verdict == NO_VERDICT)


WINDOW = WindowStatistics("file", "", "", 1, 20, 0.0, 19.0, 20, 0, 0, 0, None)


@pytest.fixture(scope="module")
def study():
    """The benchmark, as a module."""
    sys.path.insert(0, str(ROOT / "tests" / "benchmarks"))
    import false_alarms

    return false_alarms


@pytest.fixture(scope="module")
def flown(study):
    return study.fly(ROOT / "configs" / "turbofan.yaml", flights=5)


@pytest.mark.parametrize(
    "kind, rho", [("gaussian", 0.0), ("uniform", 0.0), ("gaussian", 0.9)], ids=["white", "uniform", "correlated"]
)
def test_a_known_nominal_keeps_its_rate_in_every_phase_of_flight(study, flown, kind, rho):
    """10,000 windows a phase; a right test fails each comparison once in 10,000 runs."""
    tallies = study.tested(np.random.default_rng(8), flown, kind, rho, None, windows=10_000, length=30)
    for phase, tally in tallies.items():
        for hits, rate in zip(np.array(tally.alarms).sum(axis=0), study.RATES, strict=True):
            low, high = binom.ppf([5e-5, 1 - 5e-5], sum(tally.judged), rate)
            assert low <= hits <= high, (phase, rate, hits / sum(tally.judged))


def within(tally, rates, margin):
    """Mean rate over nominals within `margin` standard errors of their scatter, and 15 % of the rate, of the rate."""
    judged = np.array(tally.judged)
    shares = np.array(tally.alarms) / judged[:, None]
    error = shares.std(axis=0, ddof=1) / np.sqrt(len(judged))
    return np.abs(shares.mean(axis=0) - rates) <= margin * error + 0.15 * np.array(rates)


@pytest.mark.slow
def test_an_identified_nominal_keeps_its_rate_on_average(study, flown):
    """64 nominals, whose rates are skew, so that fewer would not do; 3.5 standard errors and 15 % of the rate."""
    tallies = study.tested(
        np.random.default_rng(9), flown, "gaussian", 0.0, 300, windows=64 * 200, length=30, nominals=64
    )
    for phase, tally in tallies.items():
        assert within(tally, study.RATES, 3.5)[:2].all(), phase


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind, rho, records",
    [
        ("gaussian", 0.0, None),
        ("uniform", 0.0, None),
        ("gaussian", 0.9, None),
        ("gaussian", 0.0, 300),
        ("uniform", 0.0, 300),
        ("gaussian", 0.5, 300),
    ],
)
def test_rates_over_a_hundred_thousand_windows_of_real_flight_phases(study, kind, rho, records):
    """Known nominal: binomial, each comparison once in 100,000 runs. Identified: 3.5 standard errors and 15 %."""
    flown = study.fly(ROOT / "configs" / "turbofan.yaml")
    tallies = study.tested(
        np.random.default_rng(7), flown, kind, rho, records, windows=100_000, length=30, nominals=100
    )
    for phase, tally in tallies.items():
        assert sum(tally.judged) > 95_000
        if records is not None:
            assert within(tally, study.RATES, 3.5).all(), phase
            continue
        for hits, rate in zip(np.array(tally.alarms).sum(axis=0), study.RATES, strict=True):
            # two moments describe uniform noise to 3 % of a rate of 5 %, and to 5 % of one of 0.1 %
            spread = 1.05 if kind == "uniform" else 1.0
            low, high = binom.ppf([5e-6, 1 - 5e-6], sum(tally.judged), rate)
            assert low / spread <= hits <= high * spread, (phase, rate, hits / sum(tally.judged))


@pytest.mark.slow
def test_noise_known_from_sixteen_independent_records_gives_no_more_false_alarms_than_stated(study):
    """300 records of ρ = 0.9 are 300 (1 − ρ)/(1 + ρ) ≈ 16: the test is cautious, but not by more than half at 5 %."""
    flown = study.fly(ROOT / "configs" / "turbofan.yaml")
    tallies = study.tested(
        np.random.default_rng(7), flown, "gaussian", 0.9, 300, windows=100_000, length=30, nominals=100
    )
    for phase, tally in tallies.items():
        assert sum(tally.judged) > 95_000
        realised = np.array(tally.alarms).sum(axis=0) / sum(tally.judged)
        assert (realised <= np.array(study.RATES)).all() and realised[0] >= 0.5 * study.RATES[0], phase
