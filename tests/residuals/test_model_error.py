"""What a model with generic maps may get wrong about a change."""

from __future__ import annotations

import numpy as np
import pytest
from toy_engine import SENSORS, SIGMA, ToyEngine, toy_monitor, toy_recording

from enginediag_cli.detection.verdict import judge
from enginediag_cli.residuals.model_error import model_error_covariance, scale_offsets, with_scale_offsets
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reference import windows_against_reference
from enginediag_cli.residuals.windows import WindowPlan


def everything(monitor, recording):
    """Statistics of all parameters of the monitor at nominal."""
    from dataclasses import replace

    found = window_statistics(
        monitor,
        [recording],
        WindowPlan(),
        linearise="nominal",
        condense=lambda window, x: replace(window, statistics=x),
    )
    return next(found).statistics


def test_every_sensor_gets_one_scale_offset_and_those_that_exist_stay():
    monitor = toy_monitor(offset=3.0)  # a bias of T5, no scales
    wide = with_scale_offsets(monitor, 0.01)
    assert wide.names == (*monitor.names, *(f"offset.{c}.scale" for c in SENSORS))
    assert [wide.names[i] for i in scale_offsets(wide)] == [f"offset.{c}.scale" for c in SENSORS]
    np.testing.assert_allclose(np.diag(wide.uncertainty)[scale_offsets(wide)], 1e-4)
    assert with_scale_offsets(wide).names == wide.names


def test_the_allowance_is_the_stated_share_of_the_rms_relative_deviation():
    monitor = with_scale_offsets(toy_monitor())
    recording = toy_recording(np.random.default_rng(1), 50, noise=0.0)
    relative = np.array([0.01, 0.0, -0.02, 0.005, 0.0])
    columns = {c: recording[c] * (1 + d) for c, d in zip(SENSORS, relative, strict=True)}
    C = model_error_covariance(everything(monitor, recording.with_columns(columns)), scale_offsets(monitor), 0.2)
    at = scale_offsets(monitor)
    np.testing.assert_allclose(np.sqrt(np.diag(C)[at]), 0.2 * np.sqrt(np.mean(relative**2)), rtol=1e-9)
    assert np.count_nonzero(C) == len(SENSORS)


def test_a_sensor_without_readings_takes_no_part():
    monitor = with_scale_offsets(toy_monitor())
    recording = toy_recording(np.random.default_rng(2), 50, noise=0.0)
    columns = {"T3_K": recording["T3_K"] * 1.01, "P3_Pa": np.full(50, np.nan)}
    C = model_error_covariance(everything(monitor, recording.with_columns(columns)), scale_offsets(monitor), 0.5)
    allowed = np.diag(C)[scale_offsets(monitor)]
    assert allowed[SENSORS.index("P3_Pa")] == 0.0
    assert np.sqrt(allowed[0]) == pytest.approx(0.5 * 0.01 / 2, rel=1e-9)  # rms over the four others


def test_a_healthy_engine_is_judged_nearly_as_without_allowance():
    recording = toy_recording(np.random.default_rng(3), 100)
    plain, allowed = (
        judge(next(windows_against_reference(toy_monitor(), [recording], WindowPlan(), 0, model_error=f))).test
        for f in (0.0, 0.2)
    )
    assert 0.8 * plain.statistic < allowed.statistic <= plain.statistic


def test_a_change_of_a_slightly_different_engine_is_not_taken_for_a_lack_of_fit():
    rng = np.random.default_rng(4)
    recording = toy_recording(rng, 200)
    clean = ToyEngine().predict({c: recording[c] for c in ToyEngine().inputs}, {"hpc.efficiency": 0.97})
    healthy = ToyEngine().predict({c: recording[c] for c in ToyEngine().inputs})
    # the true engine answers to the fault 15 % more or less than the model, sensor by sensor
    wrong = healthy.y + (clean.y - healthy.y) * (1 + 0.15 * np.array([1, -1, 1, -1, 1]))
    y = wrong + SIGMA * rng.standard_normal(wrong.shape)
    seen = recording.with_columns({c: y[:, j] for j, c in enumerate(SENSORS)})
    plain, allowed = (
        judge(next(windows_against_reference(toy_monitor(), [seen], WindowPlan(), 0, model_error=f)))
        for f in (0.0, 0.2)
    )
    assert plain.verdict == allowed.verdict == "fault"
    assert allowed.fit.ratio < plain.fit.ratio
