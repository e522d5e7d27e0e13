"""What is asked of a refinement: errors by stretches of correlated records, and verdicts of the criteria."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.mismatch.fit.stretches import by_stretches, correlation_time, cut
from enginediag_cli.mismatch.refine.criteria import Prediction, Records, Significance, Verdict, verdict


def drifting(rng, rho, flights=40, records=100):
    """Scores (N, 1) of unit variance, correlated from record to record within flights (N,)."""
    e = rng.standard_normal((flights, records))
    for k in range(1, records):
        e[:, k] = rho * e[:, k - 1] + np.sqrt(1 - rho**2) * e[:, k]
    return e.reshape(-1, 1), np.repeat(np.arange(flights), records)


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_a_sum_of_correlated_records_is_known_as_well_as_their_correlation_time_says(rho):
    scores, flight = drifting(np.random.default_rng(3), rho)
    N = len(scores)
    found = by_stretches(scores, np.ones((N, 1, 1)), np.array([[float(N)]]), flight)
    truth = np.sqrt((1 + rho) / (1 - rho) / N)
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(truth, rel=0.2)
    assert correlation_time(scores, np.eye(1), flight) == pytest.approx((1 + rho) / (1 - rho), rel=0.3)


def test_what_lasts_for_a_whole_flight_counts_once_per_flight():
    rng = np.random.default_rng(4)
    flight = np.repeat(np.arange(30), 50)
    scores = rng.standard_normal(30)[flight][:, None]
    found = by_stretches(scores, np.ones((1500, 1, 1)), np.array([[1500.0]]), flight)
    assert found.count == 30 and found.length >= 50
    assert np.sqrt(found.covariance[0, 0]) == pytest.approx(30**-0.5, rel=0.3)


def test_stretches_do_not_reach_over_the_end_of_a_flight():
    assert cut(np.array([0] * 5 + [1] * 7 + [2] * 2), 3).tolist() == [0] * 5 + [1] * 4 + [2] * 3 + [3] * 2


def prediction(share=1.0, information=400.0, dispersion=1.0, by_stretches=0.0, effective=50.0):
    return Prediction(Records.ALL, share, information, dispersion, by_stretches, effective, 3, 100)


def test_the_fall_of_chi2_is_that_of_the_point_prediction():
    rng = np.random.default_rng(5)
    d = rng.standard_normal(200)
    e = 0.8 * d + rng.standard_normal(200)
    c = prediction(float(d @ e / (d @ d)), float(d @ d))
    assert c.fall == pytest.approx(e @ e - (e - d) @ (e - d))


def test_unseen_flights_must_ask_for_more_than_half_of_the_predicted_change():
    assert prediction(1.0).met is True
    assert prediction(0.52).met is False
    assert prediction(1.0, by_stretches=0.4).met is None  # this error would not show a right change either
    assert prediction(1.0, information=2.0).met is None
    assert prediction(1.0, information=0.0).met is None
    assert prediction(1.0, information=40.0, dispersion=9.0).met is None  # noise nine times what is stated
    assert prediction(1.0, by_stretches=0.4, effective=2.0).met is True  # two stretches tell nothing of an error


def test_a_coefficient_that_is_not_different_from_nothing_is_refused():
    assert Significance("x", 1, 0.2, 1.0, 0.2, 50.0).met is False
    assert Significance("x", 1, 30.0, 1.0, 30.0, 50.0).met is True
    assert Significance("x", 1, 30.0, 1.0, 2.0, 50.0).met is False  # its records are not independent
    assert Significance("x", 1, 30.0, 20.0, 30.0, 50.0).met is False  # the noise is larger than stated


def test_what_is_not_met_refuses_and_what_cannot_be_told_leaves_it_open():
    good, bad, open_ = prediction(1.0), prediction(0.2), prediction(1.0, information=1.0)
    assert verdict([good, good]) is Verdict.ACCEPTED
    assert verdict([good, open_]) is Verdict.NOT_JUDGED
    assert verdict([bad, open_]) is Verdict.REFUSED
    assert verdict([]) is Verdict.NOT_JUDGED
