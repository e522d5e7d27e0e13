"""How alike the errors of two records are: by elapsed time and by how far apart they operate."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.mismatch.fit.neighbours import LEAST, NEXT, REACH, SHORTEST, neighbours, operating

RHO = np.array([0.8, 0.3, -0.5, 0.0])


def steady(n, time=None, recording=None, points=None):
    """Records of one operating point, 10 s apart unless said."""
    time = 10.0 * np.arange(n) if time is None else np.asarray(time, float)
    recording = np.zeros(n, int) if recording is None else np.asarray(recording)
    return neighbours(time, np.arange(n), recording, np.zeros((n, 1)) if points is None else points)


def test_records_as_they_usually_follow_have_the_correlation_itself_and_the_first_none():
    near = steady(6)
    assert near.step_s == 10.0
    np.testing.assert_allclose(near.correlation(RHO)[1:], np.tile(RHO, (5, 1)))
    assert not near.correlation(RHO)[0].any()
    assert near.consecutive.tolist() == [False] + [True] * 5


def test_correlation_falls_as_a_power_of_the_elapsed_time_down_to_nothing():
    r = steady(9, time=[0, 10, 20, 30, 50, 80, 90, 100, 500]).correlation(RHO)
    np.testing.assert_allclose(r[4], [0.8**2, 0.3**2, 0.0, 0.0])
    np.testing.assert_allclose(r[5], [0.8**3, 0.0, 0.0, 0.0])  # 0.3³ is less than LEAST
    assert 0.3**3 < LEAST and not r[8].any()  # 40 steps: the record begins anew
    # a negative correlation is known of the next record alone
    assert (r[[1, 2, 3, 6, 7], 2] == -0.5).all() and not r[[4, 5, 8], 2].any()


def test_correlation_falls_with_the_distance_of_operating_points_beyond_the_usual_one():
    rng = np.random.default_rng(1)
    points = np.cumsum(0.1 * rng.uniform(0.5, 1, (40, 1)), axis=0)
    points[20:] += 2.0  # one jump of two REACHes
    near = steady(40, points=points)
    r = near.correlation(RHO)[:, 0]
    assert r[20] == pytest.approx(0.8 * np.exp(-2.0), rel=0.05)
    assert np.all(r[[k for k in range(1, 40) if k != 20]] > 0.79)
    assert not near.consecutive[20] and near.consecutive[19]


def test_where_the_operating_point_always_jumps_jumps_are_usual():
    rng = np.random.default_rng(2)
    r = steady(200, points=rng.uniform(0, 10, (200, 2))).correlation(RHO)[1:, 0]
    assert np.mean(r == 0.8) >= 0.89 and r.min() > 0.5


def test_flights_may_come_in_any_order():
    rng = np.random.default_rng(3)
    time = [np.cumsum(rng.uniform(5, 15, n)) for n in (30, 20, 25)]
    points = [rng.uniform(0, 1, (n, 2)) for n in (30, 20, 25)]

    def of(order):
        recording = np.repeat(np.arange(3), [len(time[k]) for k in order])
        r = steady(75, np.concatenate([time[k] for k in order]), recording, np.concatenate([points[k] for k in order]))
        parts = np.split(r.correlation(RHO), np.flatnonzero(np.diff(recording)) + 1)
        return {k: part for k, part in zip(order, parts, strict=True)}

    one, two = of((0, 1, 2)), of((2, 0, 1))
    for k in range(3):
        np.testing.assert_allclose(one[k], two[k])


def test_without_a_time_records_are_counted_and_those_that_were_dropped_are_gaps():
    number = np.array([0, 1, 2, 5, 6])
    near = neighbours(np.full(5, np.nan), number, np.zeros(5, int), np.zeros((5, 0)))
    np.testing.assert_array_equal(near.gap, [0, 1, 1, 3, 1])
    assert np.isnan(near.step_s)
    np.testing.assert_allclose(near.correlation(RHO)[3], [0.8**3, 0.0, 0.0, 0.0])
    # and with evenly spaced times it is the same
    timed = neighbours(10.0 * number, number, np.zeros(5, int), np.zeros((5, 0)))
    np.testing.assert_allclose(timed.correlation(RHO), near.correlation(RHO))


def test_stamps_that_nearly_coincide_or_go_back_leave_no_perfect_correlation():
    near = steady(6, time=[0, 10, 10.001, 20, 15, 25])
    r = near.correlation(np.array([0.8]))[:, 0]
    assert near.gap[2] == SHORTEST and r[2] == pytest.approx(0.8**SHORTEST) and r[2] < 1
    assert near.gap[4] == 1.0  # counted, where the clock goes back
    assert near.gap[near.consecutive].max() <= NEXT


def test_an_operating_point_is_measured_in_the_envelope_or_in_the_recordings_own_range():
    u = {"altitude_m": np.linspace(0, 1000, 101), "mach": np.full(101, 0.5)}
    of_envelope = operating(u, {"altitude_m": 10_000.0, "mach": 0.8})
    np.testing.assert_allclose(of_envelope[:, 0], u["altitude_m"] / (REACH * 10_000.0))
    own = operating(u, {})
    assert own.shape == (101, 1)  # Mach number never changed
    assert np.ptp(own[:, 0]) == pytest.approx(1 / (0.9 * REACH))
    assert operating({"mach": np.full(4, 0.5)}, {}).shape == (4, 0)


def test_one_record_or_none_has_no_neighbour():
    for n in (0, 1):
        near = steady(n)
        assert near.correlation(RHO).shape == (n, 4) and not near.correlation(RHO).any()
