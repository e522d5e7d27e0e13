"""Masks: what is found, and what must not be."""

from __future__ import annotations

import numpy as np
import pytest
from shared_recordings import flight

from enginediag_cli.recordings.masking import (
    MaskingRules,
    QualitySettings,
    find_spikes,
    mask_recording,
    physical_limits,
)
from enginediag_cli.recordings.repeated import find_stuck
from enginediag_cli.recordings.table import Recording


def masked(columns, limits=None, settings=None):
    """The recording with unusable readings of sensors masked, and the counts."""
    judged = MaskingRules(tuple(columns), limits=limits or {}, settings=settings or QualitySettings(), frozen=False)
    return mask_recording(Recording(columns), judged)


def test_clean_flights_lose_no_more_than_one_value_in_ten_thousand():
    lost = total = 0
    for seed in range(5):
        _, report = masked(flight(seed=seed))
        lost, total = lost + report.total, total + 5 * 20_000
    assert lost <= 1e-4 * total


def test_spikes_far_from_both_sides_are_found_and_nothing_else():
    columns = flight()
    rng = np.random.default_rng(5)
    where = rng.choice(np.arange(20, 19_980, 20), 60, replace=False)
    columns["ITT_K"][where] += 400.0 * rng.choice([-1, 1], 60)
    found = {name: find_spikes(x) for name, x in columns.items()}
    beyond = np.abs(columns["ITT_K"] - np.median(columns["ITT_K"])) > 0.8 * np.ptp(flight()["ITT_K"])
    assert found["ITT_K"][where[beyond[where]]].mean() >= 0.95
    assert found["ITT_K"].sum() - found["ITT_K"][where].sum() <= 2
    assert sum(mask.sum() for name, mask in found.items() if name != "ITT_K") <= 2


def test_what_lies_within_the_usual_range_is_left_to_the_model():
    columns = flight(seed=2)
    for name in columns:
        columns[name][300] = columns[name].mean()
    assert not any(find_spikes(x)[300] for x in columns.values())


def test_a_valve_that_is_mostly_shut_has_no_outliers():
    valve = np.zeros(5000)
    valve[[100, 101, 1500, 3000]] = 1.0
    assert not find_spikes(valve).any()


def test_a_quantised_sensor_in_steady_flight_is_not_stuck():
    rng = np.random.default_rng(4)
    slow = np.cumsum(rng.normal(0, 0.02, 5000))
    columns = {"sat_degC": np.round(slow / 0.25) * 0.25} | {
        name: values[:5000] for name, values in flight(seed=4).items()
    }
    _, report = masked(columns)
    assert report.columns["sat_degC"]["stuck"] == 0


def test_a_frozen_sensor_is_found_whole_and_only_it():
    columns = flight(seed=6)
    columns["T3_K"][5000:5200] = columns["T3_K"][5000]
    clean, report = masked(columns)
    assert report.columns["T3_K"]["stuck"] == 200 and np.isnan(clean["T3_K"][5000:5200]).all()
    assert all(count["stuck"] == 0 for name, count in report.columns.items() if name != "T3_K")


def test_a_coarse_sensor_is_stuck_when_the_others_say_that_it_should_have_moved():
    columns = flight(seed=7)
    coarse = np.round(columns["T3_K"] / 10.0) * 10.0
    coarse[2000:4000] = coarse[2000]
    others = {name: values for name, values in columns.items() if name != "T3_K"}
    mask = find_stuck(coarse, others)
    assert mask[2000:4000].all() and mask.sum() <= 2050


def test_a_constant_column_and_an_indicator_at_its_stop_are_not_stuck():
    others = flight(seed=8)
    assert not find_stuck(np.full(20_000, 3.0), others).any()
    speed = np.maximum(others["N1_rpm"] - 9000.0, 0.0)
    assert not find_stuck(speed, others).any()


def test_limits_missing_and_dropped_values_are_counted_by_reason():
    columns = {"T3_K": np.linspace(600.0, 700.0, 100), "N1_rpm": np.linspace(1.0, 2.0, 100)}
    columns["T3_K"][[3, 50]] = np.nan
    columns["T3_K"][60:80] = np.nan
    columns["T3_K"][90] = -9999.0
    columns["T3_K"][91] = 690.5
    clean, report = masked(columns, {"T3_K": (600.0, 690.0)})
    assert dict(report.columns["T3_K"]) == {
        "missing": 2,
        "dropped": 20,
        "out of limits": 10,
        "stuck": 0,
        "outlier": 0,
    }
    assert np.isnan(clean["T3_K"]).sum() == report.total == 32
    line = "T3_K: 32 of 100 values masked (missing 2, dropped 20, out of limits 10)"
    assert report.report_lines() == [line]


def test_codes_for_no_value_lie_outside_the_physical_limits_in_any_unit():
    for column, code in (("T3_K", -9999.0), ("itt_degC", -9999.0), ("P3_psia", -99.0), ("N2_rpm", -1.0)):
        low, high = physical_limits(column)
        assert code < low < high
    low, high = physical_limits("T3_degC")
    assert (low, high) == pytest.approx((100.0 - 273.15, 3500.0 - 273.15))


def test_a_reading_too_large_to_compute_with_is_out_of_limits_whatever_it_is_of():
    torque = np.linspace(1e3, 2e3, 100)
    torque[[7, 9]] = 1e308, -1e308
    clean, report = masked({"torque_Nm": torque})
    assert report.columns["torque_Nm"]["out of limits"] == 2 and np.isfinite(clean["torque_Nm"]).sum() == 98


def test_searches_can_be_turned_off():
    columns = flight(seed=6)
    columns["T3_K"][5000:5200] = columns["T3_K"][5000]
    off = QualitySettings(stuck_records=0, outlier_sigma=0.0)
    _, report = masked(columns, settings=off)
    assert report.total == 0
