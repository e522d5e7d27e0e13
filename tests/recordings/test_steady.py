from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.recordings.masking import (
    SteadySettings,
    TrailingWindows,
    average_windows,
    count_first_reasons,
    find_failures,
)
from enginediag_cli.recordings.table import Recording


def step_flight() -> Recording:
    """200 s at 1 Hz: N1 holds 9000 rpm, steps to 12000 at t = 100."""
    time = np.arange(200.0)
    return Recording({"time_s": time, "N1_rpm": np.where(time < 100, 9000.0, 12000.0), "T3_K": time.copy()})


def test_spread_and_slope_agree_with_a_loop_over_records_at_irregular_times():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.2, 2.0, 400))
    time[200:] += 60.0
    x = rng.normal(size=400)
    x[rng.random(400) < 0.1] = np.nan
    window = TrailingWindows(time, 10.0, gap_s=5.0)
    spread, slope = window.spread(x), window.slope(x)
    for k in range(400):
        rows = [j for j in range(k + 1) if time[j] > time[k] - 10.0 and (j >= 200) == (k >= 200)]
        known = [j for j in rows if np.isfinite(x[j])]
        if known:
            assert spread[k] == pytest.approx(np.ptp(x[known]))
        if len(known) > 1:
            assert slope[k] == pytest.approx(np.polyfit(time[known], x[known], 1)[0], abs=1e-8)


def steady(recording, settings):
    return count_first_reasons(find_failures(recording, settings), np.ones(len(recording), dtype=bool))


def test_a_step_takes_out_the_records_until_the_dwell_is_over():
    settings = SteadySettings(window_s=10, spread={"N1_rpm": 100}, dwell_s=30, dwell={"N1_rpm": 500})
    keep, reasons = steady(step_flight(), settings)
    assert np.flatnonzero(~keep).tolist() == [*range(29), *range(100, 129)]
    assert reasons["spread of N1_rpm"] == 9 and reasons["dwell of N1_rpm"] == 20
    assert keep.sum() + sum(reasons.values()) == 200


def test_minimum_maximum_slope_and_missing_values_are_reasons():
    r = step_flight()
    r.columns["T3_K"][150] = np.nan
    settings = SteadySettings(window_s=5, slope={"T3_K": 0.5}, minimum={"N1_rpm": 10000}, maximum={"T3_K": 180})
    keep, reasons = steady(r, settings)
    assert not keep.any()
    assert reasons["missing T3_K"] == 1 and reasons["N1_rpm < 10000"] == 100
    assert reasons["T3_K > 180"] == 19 and reasons["slope of T3_K"] == 80


def test_rows_without_time_are_steady_when_both_neighbours_are_near():
    x = np.array([0.0, 1.0, 2.0, 10.0, 11.0, 12.0, 30.0])
    keep, _ = steady(Recording({"power_W": x}), SteadySettings(neighbours={"power_W": 3.0}))
    assert keep.tolist() == [True, True, False, False, True, False, False]


def test_averages_are_the_means_of_whole_steady_windows():
    rng = np.random.default_rng(2)
    r = step_flight().with_columns({"T3_K": 700.0 + rng.normal(size=200)})
    r = Recording(r.columns, {"e": ["a"] * 200})
    settings = SteadySettings(window_s=10, spread={"N1_rpm": 100})
    averages, report = average_windows(r, 10.0, find_failures(r, settings))
    assert report.kept == 20 and report.total == 20
    np.testing.assert_allclose(averages["T3_K"], r["T3_K"].reshape(20, 10).mean(axis=1))
    assert averages["time_s"].tolist() == [10 * k + 4.5 for k in range(20)]
    assert averages.text["e"] == ["a"] * 20


def test_a_window_across_a_step_or_with_too_few_records_is_left_out():
    r = step_flight()
    r = r.with_columns({"N1_rpm": np.where(r["time_s"] < 105, 9000.0, 12000.0)})
    r = r.select(np.r_[0:151, 158:200])
    averages, report = average_windows(r, 10.0, find_failures(r, SteadySettings(window_s=10, spread={"N1_rpm": 100})))
    times = averages["time_s"].tolist()
    assert 104.5 not in times and len(times) == report.kept == 18
    assert report.reasons["incomplete window"] == 1 and report.reasons["spread of N1_rpm"] == 1


def test_missing_values_are_left_out_of_the_mean():
    r = step_flight()
    r.columns["T3_K"][:10] = [np.nan] * 5 + [1.0] * 5
    r.columns["T3_K"][10:20] = np.nan
    averages, _ = average_windows(r, 10.0, {})
    assert averages["T3_K"][0] == 1.0 and np.isnan(averages["T3_K"][1])
