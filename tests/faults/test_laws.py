from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.errors import DataError
from enginediag_cli.faults.catalogue import activity, clocks_from_columns

N = 1000
RECORD = np.arange(1.0, N + 1.0)
CLOCKS = clocks_from_columns({"flight": np.repeat(["b", "a"], N // 2), "time_s": 100.0 + 10.0 * np.arange(N)}, N)


def law(kind, **more):
    return {"type": kind, "clock": "record", "onset": 101.0, "end": None, **more}


def test_step_is_one_from_the_onset_on():
    np.testing.assert_array_equal(activity(law("step"), CLOCKS), RECORD >= 101)


def test_ramp_is_linear_then_full():
    g = activity(law("ramp", duration=200.0), CLOCKS)
    np.testing.assert_allclose(g, np.clip((RECORD - 101) / 200, 0, 1), atol=1e-15)


def test_drift_grows_at_its_rate_without_end():
    g = activity(law("drift", rate=0.01), CLOCKS)
    assert g[-1] == pytest.approx(0.01 * (N - 101)) and g[50] == 0.0


def test_saturating_fault_has_63_percent_after_one_time_constant():
    g = activity(law("saturating", time_constant=100.0), CLOCKS)
    assert g[200] == pytest.approx(1 - np.exp(-1)) and np.all(np.diff(g[100:]) > 0)


def test_intermittent_fault_is_there_in_its_share_of_each_period():
    g = activity(law("intermittent", period=50.0, present=0.2), CLOCKS)
    assert g[100:].sum() == N * 0.9 * 0.2 and g[:100].sum() == 0
    np.testing.assert_array_equal(g[100:150], g[150:200])


def test_fault_is_gone_from_its_end_on():
    g = activity({**law("step"), "end": 201.0}, CLOCKS)
    assert g[199] == 1.0 and g[200] == 0.0


def test_without_onset_the_fault_is_there_from_the_first_record_in_every_clock():
    for clock in ("record", "flight", "hours"):
        assert activity({**law("step"), "clock": clock, "onset": None}, CLOCKS).all()


def test_flights_count_in_order_of_appearance_whatever_they_are_called():
    np.testing.assert_array_equal(CLOCKS["flight"], np.repeat([1.0, 2.0], N // 2))


def test_hours_count_from_the_first_record():
    assert CLOCKS["hours"][0] == 0.0 and CLOCKS["hours"][360] == pytest.approx(1.0)


def test_a_clock_without_its_column_is_refused_by_name():
    with pytest.raises(DataError, match="no column 'flight'"):
        activity({**law("step"), "clock": "flight"}, clocks_from_columns({}, 10))
