"""The GLR test keeps its false-alarm rate and its power."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom, ncx2
from white_statistics import local_statistics, white_noise

from enginediag_cli.detection.verdict import glr_test, threshold
from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame

N, M, P, TRIALS = 80, 4, 6, 1500
SIGMA = np.array([0.5, 1.0, 2.0, 10.0])


def operating_points(rng):
    """Sensitivities that vary slowly along a flight."""
    u = np.cumsum(rng.standard_normal((N, 3)), axis=0) / np.sqrt(N)
    return SIGMA[:, None] * (rng.standard_normal((M, P)) + np.einsum("ku,ujp->kjp", u, rng.standard_normal((3, M, P))))


def scores(rng, noise, change, trials=TRIALS):
    J = operating_points(rng)
    for _ in range(trials):
        e = np.empty((N, M))
        for j, rho in enumerate(noise.rho):
            w = rng.standard_normal(N + 200) * np.sqrt(1 - rho**2)
            e[:, j] = noise.sigma[j] * lfilter([1], [1, -rho], w)[200:]
        yield fisher_score(
            local_statistics(e + J @ change, J, noise, ParameterFrame(tuple("abcdef"), np.ones(P), np.full(P, 0.02)))
        )


@pytest.mark.parametrize("rho", [np.zeros(M), np.array([0.9, 0.5, 0.0, 0.8])], ids=["white", "correlated"])
def test_the_realised_false_alarm_rate_is_the_chosen_one(rho):
    statistics = np.array(
        [score.glr for score in scores(np.random.default_rng(1), NoiseModel(SIGMA, rho), np.zeros(P))]
    )
    for false_alarm in (0.05, 0.01):
        alarms = int(np.sum(statistics > threshold(P, false_alarm)))
        low, high = binom.ppf([0.001, 0.999], TRIALS, false_alarm)  # a right test fails this once in 500 runs
        assert low <= alarms <= high


def test_the_realised_power_is_that_of_the_noncentral_chi2():
    rng = np.random.default_rng(2)
    change = np.array([0.06, 0, 0, 0.09, 0, 0])
    found = list(scores(rng, white_noise(SIGMA), change, 600))
    noncentrality = float(change @ found[0].information @ change)
    expected = ncx2.sf(threshold(found[0].rank, 0.05), found[0].rank, noncentrality)
    assert expected == pytest.approx(ncx2.sf(threshold(P, 0.05), P, change @ found[0].information @ change))
    assert 0.1 < expected < 0.9
    alarms = sum(bool(glr_test(score, 0.05).alarm) for score in found)
    low, high = binom.ppf([0.001, 0.999], 600, expected)
    assert low <= alarms <= high


def test_nothing_excited_gives_no_verdict():
    found = fisher_score(
        local_statistics(
            np.zeros((5, 1)),
            np.zeros((5, 1, 2)),
            white_noise(np.ones(1)),
            ParameterFrame(("a", "b"), np.ones(2), np.ones(2)),
        )
    )
    test = glr_test(found)
    assert test.alarm is None and test.dof == 0 and np.isnan(test.p_value)


def test_a_false_alarm_rate_must_be_a_probability():
    with pytest.raises(ValueError, match="between 0 and 1"):
        threshold(3, 5.0)
