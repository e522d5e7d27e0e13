"""Filters along time: closed forms, and derivatives that are those of differences."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.filters import (
    Backlash,
    Delay,
    FilterClock,
    FullScaleFilter,
    Hysteresis,
    Lag,
    RateLimit,
    RateOfChange,
    ScaledFilter,
    ScaledIntegratedFilter,
    SecondOrder,
)

NO_DIRECTIONS = np.zeros((0, 0))


def clock_of(time, *starts):
    first = np.zeros(len(time), bool)
    first[[0, *starts]] = True
    return FilterClock(np.asarray(time, float), first)


def alone(filter, clock, u, *coefficients):
    return filter(clock, u, np.zeros((0, len(u))), coefficients)


def uneven(n=400, seed=0):
    """A clock with two stretches, and a signal of ramps, holds and noise with two directions."""
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.3, 1.7, n))
    levels = np.repeat(rng.uniform(0.0, 50.0, n // 20), 20)
    u = np.convolve(levels, np.ones(4) / 4, mode="same") + 0.3 * rng.normal(size=n)
    along = np.stack([np.cos(time / 30.0), np.sin(time / 7.0) ** 2])
    return clock_of(time, n // 3), u, along


FILTERS = {
    "lag": (Lag(), (6.0,)),
    "short lag": (Lag(), (0.2,)),
    "second order": (SecondOrder(), (13.0, 0.4)),
    "delay": (Delay(), (3.37,)),
    "clock ahead": (Delay(), (-2.21,)),
    "rate limit": (RateLimit(), (0.7, 0.31)),
    "rate limit upwards only": (RateLimit(), (0.9, 0.0)),
    "rate limit per full scale": (FullScaleFilter(RateLimit(), 40.0), (30.0, 50.0)),
    "backlash": (Backlash(), (3.0,)),
    "heat flow": (ScaledIntegratedFilter(Lag()), (2.5, 12.0)),
    "inertia": (ScaledFilter(RateOfChange()), (0.4,)),
}


@pytest.mark.parametrize("name", FILTERS)
def test_derivatives_are_those_of_differences(name):
    filter, coefficients = FILTERS[name]
    clock, u, along = uneven()
    at = filter(clock, u, along, coefficients)
    h = 1e-6
    for k in range(len(along)):
        difference = (
            alone(filter, clock, u + h * along[k], *coefficients).value
            - alone(filter, clock, u - h * along[k], *coefficients).value
        ) / (2 * h)
        assert np.mean(np.abs(at.input_slopes[k] - difference) > 1e-6 * max(1.0, np.abs(difference).max())) < 0.02
        assert np.median(np.abs(at.input_slopes[k] - difference)) < 1e-7
    assert at.coefficient_slopes.shape == (len(coefficients), len(u))
    for k, c in enumerate(coefficients):
        if c == 0.0:
            continue
        moved = [list(coefficients), list(coefficients)]
        moved[0][k], moved[1][k] = c + h, c - h
        difference = (alone(filter, clock, u, *moved[0]).value - alone(filter, clock, u, *moved[1]).value) / (2 * h)
        scale = max(1.0, np.abs(difference).max())
        # where a ramp ends within a step, or a delay meets a record, there is a kink
        assert np.mean(np.abs(at.coefficient_slopes[k] - difference) > 1e-6 * scale) < 0.02


def test_a_step_through_a_lag_is_an_exponential():
    time = np.array([0.0, 1.0, 1.0 + 1e-9, 1.5, 2.7, 4.0, 9.0, 30.0])
    u = np.array([1.0, 1.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0])
    m = u + alone(Lag(), clock_of(time), u, 2.0).value
    later = time >= 1.0
    later[1] = False  # the step itself
    assert m[later] == pytest.approx(3.0 - 2.0 * np.exp(-(time[later] - 1.0) / 2.0), abs=1e-8)


def test_a_lag_follows_a_ramp_one_time_constant_behind_however_it_is_sampled():
    time = np.cumsum(np.random.default_rng(1).uniform(0.1, 3.0, 200))
    u = 5.0 * (time - time[0])
    v = alone(Lag(), clock_of(time), u, 4.0).value
    assert v == pytest.approx(-20.0 * (1.0 - np.exp(-(time - time[0]) / 4.0)), abs=1e-10)


def test_without_a_time_constant_nothing_lags():
    clock, u, along = uneven()
    found = Lag()(clock, u, along, (0.0,))
    assert not found.value.any() and not found.input_slopes.any()
    assert found.coefficient_slopes[0] == pytest.approx(-clock.rise(u))


def test_two_lags_answer_a_ramp_as_their_transfer_function_does():
    time = np.arange(0.0, 60.0, 0.05)
    v = alone(SecondOrder(), clock_of(time), 2.0 * time, 8.0, 3.0 / 8.0).value
    exact = -2.0 * (8.0 + (9.0 * np.exp(-time / 3.0) - 25.0 * np.exp(-time / 5.0)) / 2.0)
    assert v == pytest.approx(exact, abs=2e-4)


def test_a_step_through_a_rate_limit_is_a_ramp():
    time = np.arange(0.0, 100.0)
    u = np.where(time < 10.0, 0.0, np.where(time < 60.0, 30.0, 5.0))
    m = u + alone(RateLimit(), clock_of(time), u, 1.0, 0.5).value
    assert m[9:39] == pytest.approx(np.arange(30.0))
    assert m[39:60] == pytest.approx(30.0)
    assert m[59:72] == pytest.approx(np.maximum(30.0 - 2.0 * np.arange(13.0), 5.0))
    assert m[73:] == pytest.approx(5.0)


def test_a_ramp_slower_than_the_limit_passes_unchanged():
    clock, u, along = uneven()
    found = RateLimit()(clock, u, along, (1e-6, 1e-6))
    assert not found.value.any() and not found.input_slopes.any() and not found.coefficient_slopes.any()


def test_a_limited_ramp_turns_where_it_meets_a_falling_signal():
    # up at 1/s from 0, met at t = 10 by a signal that falls at 2/s, followed down at 1/s from there
    time = np.array([0.0, 1.0, 4.0, 16.0, 30.0])
    u = np.array([0.0, 22.0, 22.0, -2.0, -2.0])
    m = u + alone(RateLimit(), clock_of(time), u, 1.0, 1.0).value
    assert m == pytest.approx([0.0, 1.0, 4.0, 4.0, -2.0])


@pytest.mark.parametrize(
    "filter, coefficients, expected",
    [
        (Lag(), (5.0,), lambda t: 20.0 - 15.0 * np.exp(-t / 5.0)),
        (RateLimit(), (0.5, 0.5), lambda t: np.minimum(5.0 + 2.0 * t, 20.0)),
        (FullScaleFilter(RateLimit(), 40.0), (20.0, 20.0), lambda t: np.minimum(5.0 + 2.0 * t, 20.0)),
        (Delay(), (4.0,), lambda t: np.where(t < 4.0, 5.0, 20.0)),
        (SecondOrder(), (5.0, 0.0), lambda t: 20.0 - 15.0 * np.exp(-t / 5.0)),
    ],
)
def test_an_output_that_is_known_at_the_beginning_goes_on_from_there(filter, coefficients, expected):
    time = np.arange(0.0, 40.0)
    start = np.append(5.0, np.full(39, np.nan))
    clock = FilterClock(time, time == 0.0, start)
    u, along = np.full(40, 20.0), np.ones((1, 40))
    found = filter(clock, u, along, coefficients)
    assert u + found.value == pytest.approx(expected(time), abs=1e-9)
    h = 1e-6
    moved = [filter(clock, u + side * h, along, coefficients).value for side in (1, -1)]
    assert found.input_slopes[0] == pytest.approx((moved[0] - moved[1]) / (2 * h), abs=1e-5)


def test_a_delayed_ramp_is_lower_by_slope_times_delay():
    time = np.cumsum(np.random.default_rng(2).uniform(0.2, 1.5, 100))
    v = alone(Delay(), clock_of(time), 3.0 * time, 2.0).value
    late = time > time[0] + 2.0
    assert v[late] == pytest.approx(-6.0)
    assert v[~late] == pytest.approx(-3.0 * (time[~late] - time[0]))


def test_the_rate_of_a_parabola_is_exact_on_uneven_records():
    time = np.cumsum(np.random.default_rng(3).uniform(0.2, 1.5, 50))
    found = alone(RateOfChange(), clock_of(time), 2.0 * time**2 - time).value
    assert found[1:-1] == pytest.approx((4.0 * time - 1.0)[1:-1])


@pytest.mark.parametrize("name", FILTERS)
def test_a_gap_parts_a_record_into_two_that_know_nothing_of_each_other(name):
    filter, coefficients = FILTERS[name]
    clock, u, along = uneven()
    k = int(np.flatnonzero(clock.first)[1])
    whole = filter(clock, u, along, coefficients)
    for span in (slice(0, k), slice(k, None)):
        part = filter(clock_of(clock.time[span]), u[span], along[:, span], coefficients)
        assert np.array_equal(whole.value[span], part.value)
        assert np.array_equal(whole.coefficient_slopes[:, span], part.coefficient_slopes)


@pytest.mark.parametrize("name", [n for n in FILTERS if n not in ("clock ahead", "inertia")])
def test_what_comes_later_changes_nothing_that_was(name):
    filter, coefficients = FILTERS[name]
    clock, u, along = uneven()
    known = slice(0, 251)
    part = filter(FilterClock(clock.time[known], clock.first[known]), u[known], along[:, known], coefficients)
    whole = filter(clock, u, along, coefficients)
    assert np.array_equal(whole.value[known], part.value)


def test_constant_signals_leave_nothing_to_remember():
    clock, u, _ = uneven()
    for filter, coefficients in FILTERS.values():
        assert not alone(filter, clock, np.full_like(u, 7.0), *coefficients).value.any()


def test_hysteresis_is_what_a_valve_that_is_watched_record_by_record_does():
    clock, u, along = uneven(seed=3)
    low, band = 20.0, 8.0
    wanted, still_open = np.zeros(len(u)), False
    for k, x in enumerate(u):
        if clock.first[k]:
            still_open = False  # nobody knows
        if x < low or x >= low + band:
            still_open = x < low
        wanted[k] = still_open and x >= low
    found = Hysteresis()(clock, u, along, (low, band))
    assert np.array_equal(found.value, wanted) and 0.0 < wanted.mean() < 0.5
    assert not found.input_slopes.any() and not found.coefficient_slopes.any()


def test_backlash_is_what_goes_record_by_record():
    clock, u, along = uneven(seed=3)
    h, found = 4.0, []
    for k, first in enumerate(clock.first):
        found.append(u[k] if first else min(max(found[-1], u[k] - h), u[k] + h))
    assert np.allclose(u + Backlash()(clock, u, along, (h,)).value, found, atol=1e-12)


def test_what_switches_with_backlash_switches_later_both_ways():
    time = np.arange(0.0, 200.0)
    u = np.interp(time, [0.0, 100.0, 199.0], [0.0, 1.0, 0.0])
    on = u + alone(Backlash(), clock_of(time), u, 0.1).value > 0.5
    assert u[on][0] == pytest.approx(0.6, abs=0.02) and u[on][-1] == pytest.approx(0.4, abs=0.02)
