"""A scale offset for every sensor of a monitor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_engine import SENSORS, toy_monitor, toy_recording

from enginediag_cli.detection.verdict import judge
from enginediag_cli.residuals.files import add_scale_offsets
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import WindowPlan


def judged(monitor, recording):
    (window,) = window_statistics(monitor, [recording], WindowPlan(), linearise="nominal")
    return judge(window)


def test_every_sensor_gets_one_scale_offset_and_those_that_exist_stay():
    monitor = toy_monitor(offset=3.0)  # a bias of T5, no scales
    wide = add_scale_offsets(monitor, 0.01)
    k = len(SENSORS)
    assert wide.names == (*monitor.names, *(f"offset.{c}.scale" for c in SENSORS))
    assert wide.offsets == (*monitor.offsets, *wide.offsets[-k:]) and wide.monitored == monitor.monitored
    np.testing.assert_allclose(np.diag(wide.uncertainty)[-k:], 1e-4)
    np.testing.assert_array_equal(wide.uncertainty[:-k, :-k], monitor.uncertainty)
    assert np.count_nonzero(wide.uncertainty[-k:]) == k
    assert add_scale_offsets(wide).names == wide.names


def test_a_scale_offset_that_is_certain_changes_no_statistic():
    recording = toy_recording(np.random.default_rng(3), 100, change={"hpc.efficiency": -0.005})
    plain, wide = (judged(m, recording) for m in (toy_monitor(), add_scale_offsets(toy_monitor())))
    assert wide.test.statistic == pytest.approx(plain.test.statistic, rel=1e-9)


def test_readings_that_a_scale_error_explains_are_no_fault_where_scales_are_uncertain():
    recording = toy_recording(np.random.default_rng(4), 100)
    wrong = recording.with_columns({"T3_K": recording["T3_K"] * 1.005})
    assert judged(add_scale_offsets(toy_monitor()), wrong).verdict == "fault"
    assert judged(add_scale_offsets(toy_monitor(), 0.01), wrong).verdict == "healthy"


def test_a_recordings_own_scale_reaches_the_prediction_and_its_derivative():
    wide = add_scale_offsets(toy_monitor(), 0.01)
    inputs = {c: v for c, v in toy_recording(np.random.default_rng(5), 6).columns.items() if c in wide.engine.inputs}
    theta = wide.theta0 + np.where(np.arange(len(wide.names)) >= len(wide.names) - len(SENSORS), 0.01, 0.0)
    at_nominal, *_ = wide.predict(inputs, wide.theta0)
    y, J, *_ = wide.predict(inputs, theta)
    np.testing.assert_allclose(y, 1.01 * at_nominal)
    np.testing.assert_allclose(J[:, :, -len(SENSORS) :], np.einsum("nm,mk->nmk", at_nominal, np.eye(len(SENSORS))))


def test_scale_offsets_leave_other_fields_alone():
    monitor = toy_monitor(uncertain=5.0)
    wide = add_scale_offsets(monitor, 0.01)
    changed = ("offsets", "uncertainty", "names", "theta0", "prior_sigma", "lower", "upper")
    back = replace(wide, **{name: getattr(monitor, name) for name in changed})
    for name in monitor.__dataclass_fields__:
        assert getattr(back, name) is getattr(monitor, name)
