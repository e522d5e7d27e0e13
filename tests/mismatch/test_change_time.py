"""When a state changed, by unsteady records: invariants, and coverage where errors are and are not what is assumed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from enginediag_cli.mismatch.unrecorded.change_time import (
    LEAST_STRETCHES,
    Errors,
    Stretch,
    interval,
    measured,
    responses,
)

C = np.array([0.6, 6.5, 4.0])


def stretch(rng, *, scale=1.0, memory=0.95, length=50, at=None, smooth=False):
    """Of AR(1) errors of a scale, or of one hump of it; with a step along C at a time, where one is given."""
    t = np.arange(length + 1.0)
    u = np.zeros((length + 1, 3))
    for k in range(1, length + 1):
        u[k] = memory * u[k - 1] + np.sqrt(1 - memory**2) * scale * rng.standard_normal(3)
    if smooth:
        u = scale * rng.standard_normal(3) * np.exp(-(((t - rng.uniform(0, length)) / 8.0) ** 2))[:, None]
    u = u + 0.1 * rng.standard_normal(u.shape)
    c = np.tile(C, (length + 1, 1))
    on = 0.0 if at is None else responses(t, np.array([at]), 1.0)[0]
    after = 0.0 if at is None else 1.0
    ends = np.zeros((2, 3))
    return Stretch(t, u + c * np.reshape(on, (-1, 1)) * np.ones(3), c, 0.0, after, 0.0, float(length), ends)


def test_a_response_has_come_nowhere_before_the_change_and_by_1_minus_1_over_e_after_its_lag():
    share = responses(np.array([9.0, 10.0, 14.0, 1000.0]), np.array([10.0]), 4.0)[0]
    assert share == pytest.approx([0.0, 0.0, 1 - np.exp(-1.0), 1.0])
    assert responses(np.array([9.0, 10.5]), np.array([10.0]), 0.0)[0].tolist() == [0.0, 1.0]


def test_readings_without_an_effect_tell_nothing_of_the_time():
    s = stretch(np.random.default_rng(1))
    none = replace(s, c=np.zeros_like(s.c), after=1.0)
    low, high = interval(none, Errors(np.eye(3), 0.0, 0.9, 4.0))
    assert high - low == pytest.approx(0.95 * 50.0 + 2.0)


def test_the_interval_lies_between_the_steady_records_and_narrows_with_the_effect():
    rng = np.random.default_rng(2)
    s = stretch(rng, scale=2.0, at=20.0)
    errors = Errors(np.eye(3), 0.0, 0.9, 4.0)
    small = replace(s, e=s.e - 0.9 * (s.e - stretch(np.random.default_rng(2), scale=2.0).e), c=0.1 * s.c)
    (a, b), (c, d) = interval(s, errors), interval(small, errors)
    assert 0.0 <= a < b <= 50.0 and 0.0 <= c < d <= 50.0
    assert b - a < d - c


def test_a_time_does_not_depend_on_which_state_is_called_on():
    s = stretch(np.random.default_rng(3), at=30.0)
    errors = Errors(np.eye(3), 0.0, 0.9, 4.0)
    turned = replace(s, c=-s.c, before=0.0, after=-1.0)
    assert interval(turned, errors) == pytest.approx(interval(s, errors))


def test_too_few_stretches_of_a_known_state_measure_nothing():
    rng = np.random.default_rng(4)
    assert measured([stretch(rng) for _ in range(LEAST_STRETCHES - 1)]) is None


@pytest.mark.parametrize("smooth", [False, True])
def test_95_of_100_intervals_hold_the_change_whether_errors_are_as_assumed_or_humps(smooth):
    rng = np.random.default_rng(5)
    known = [stretch(rng, scale=np.exp(rng.normal(0.5, 0.7)), smooth=smooth) for _ in range(20)]
    errors = measured(known)
    assert errors is not None
    held, widths = 0, []
    for _ in range(60):
        at = rng.uniform(2.0, 48.0)
        low, high = interval(stretch(rng, scale=np.exp(rng.normal(0.5, 0.7)), at=at, smooth=smooth), errors)
        held += low <= at <= high
        widths.append(high - low)
    assert held >= 55
    assert np.median(widths) < 10.0


def test_what_is_assumed_less_well_is_believed_less():
    """Errors that no autoregression describes: a likelihood that holds what is put in needs a smaller power."""
    rng = np.random.default_rng(6)
    usual = measured([stretch(rng, scale=4.0) for _ in range(16)])
    humps = measured([stretch(rng, scale=20.0, smooth=True) for _ in range(16)])
    assert usual is not None
    assert humps is None or humps.power <= usual.power
