"""From recordings to the statistics of windows, with a toy engine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_engine import HEALTH, SENSORS, SIGMA, toy_monitor, toy_recording
from white_statistics import local_statistics

from enginediag_cli.detection.verdict import judge, lack_of_fit
from enginediag_cli.errors import DataError
from enginediag_cli.isolation.methods import isolate
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame
from enginediag_cli.residuals.windows import plan_windows


def cut(recording, size):
    """The recording in chunks of `size` records."""
    return [recording.select(slice(i, i + size)) for i in range(0, len(recording), size)]


def found(monitor, recordings, window=None, step=None, **options):
    recordings = recordings if isinstance(recordings, list) else [recordings]
    return list(window_statistics(monitor, recordings, plan_windows(window, step), **options))


def test_statistics_at_nominal_are_those_of_all_records_at_once():
    monitor, recording = toy_monitor(rho=0.6), toy_recording(np.random.default_rng(1))
    (window,) = found(monitor, recording, linearise="nominal")
    y, J, _, _ = monitor.predict({c: recording[c] for c in monitor.engine.inputs}, monitor.theta0)
    e = np.column_stack([recording[c] for c in SENSORS]) - y
    direct = fisher_score(
        local_statistics(e, J, monitor.noise, ParameterFrame(HEALTH, monitor.theta0, monitor.prior_sigma))
    )
    np.testing.assert_allclose(window.statistics.s, direct.b, rtol=1e-8)
    np.testing.assert_allclose(window.statistics.F, direct.information, rtol=1e-8)
    assert (window.first_line, window.last_line, window.records) == (2, 201, 200)


@pytest.mark.parametrize("linearise", ["nominal", "estimate"])
def test_moving_windows_from_a_stream_equal_windows_cut_from_the_file(linearise):
    monitor, recording = toy_monitor(rho=0.8, offset=3.0), toy_recording(np.random.default_rng(2), 130)
    streamed = found(monitor, cut(recording, 17), "60", "20", linearise=linearise)
    assert [(w.first_line - 2, w.last_line - 1) for w in streamed] == [
        (i, min(i + 60, 130)) for i in (0, 20, 40, 60, 80)
    ]
    for window, first in zip(streamed, (0, 20, 40, 60, 80), strict=True):
        (alone,) = found(monitor, recording.select(slice(first, first + 60)), linearise=linearise)
        np.testing.assert_allclose(window.statistics.F, alone.statistics.F, rtol=1e-6)
        np.testing.assert_allclose(window.statistics.s, alone.statistics.s, rtol=1e-6, atol=1e-6)
        assert window.statistics.chi2 == pytest.approx(alone.statistics.chi2)


def test_windows_never_reach_across_flights_or_files():
    monitor = toy_monitor()
    rng = np.random.default_rng(3)
    one, two = toy_recording(rng, 50, flights=2), toy_recording(rng, 50, source="other.csv")
    windows = found(monitor, [one, two], "40")
    assert [(w.source, w.flight, w.records) for w in windows] == [
        ("toy.csv", "0", 40),
        ("toy.csv", "1", 40),
        ("toy.csv", "0", 10),
        ("toy.csv", "1", 10),
        ("other.csv", "0", 40),
        ("other.csv", "0", 10),
    ]


def test_two_engines_in_one_file_are_told_apart():
    rng = np.random.default_rng(4)
    healthy, faulty = toy_recording(rng, 100), toy_recording(rng, 100, change={"hpc.efficiency": -0.03})
    columns = {c: np.ravel(np.column_stack([healthy[c], faulty[c]])) for c in healthy.columns}
    both = replace(healthy, columns=columns, text={"engine": ["left", "right"] * 100}, order=(), line=np.arange(200))
    verdicts = {w.engine: judge(w).verdict for w in found(toy_monitor(), both)}
    assert verdicts == {"left": "healthy", "right": "fault"}


def test_records_outside_the_envelope_or_incomplete_are_counted_and_not_judged():
    recording = toy_recording(np.random.default_rng(5), 100)
    altitude, fuel, T3 = recording["altitude_m"].copy(), recording["Wf_kg_s"].copy(), recording["T3_K"].copy()
    altitude[:7], fuel[10:13], T3[20:30] = 60e3, np.nan, np.nan
    (window,) = found(toy_monitor(), recording.with_columns({"altitude_m": altitude, "Wf_kg_s": fuel, "T3_K": T3}))
    assert (window.outside, window.incomplete, window.failed, window.statistics.n) == (7, 3, 0, 90)
    assert window.statistics.dof == 90 * 5 - 10


def test_records_that_the_engine_cannot_compute_are_counted():
    recording = toy_recording(np.random.default_rng(6), 100)
    altitude = recording["altitude_m"].copy()
    altitude[:4] = 14e3
    for linearise in ("nominal", "estimate"):
        (window,) = found(toy_monitor(), recording.with_columns({"altitude_m": altitude}), linearise=linearise)
        assert (window.failed, window.statistics.n) == (4, 96)


def test_a_window_without_a_judged_record_gives_no_verdict_and_the_reason():
    recording = toy_recording(np.random.default_rng(7), 30)
    far = recording.with_columns({"altitude_m": np.full(30, 60e3)})
    for linearise in ("nominal", "estimate"):
        verdict = judge(found(toy_monitor(), far, linearise=linearise)[0])
        assert verdict.verdict == "no verdict"
        assert verdict.reason == "no record could be judged: 30 outside the operating points identified"


def test_a_fault_that_is_not_small_is_isolated_when_relinearised_and_its_size_is_right():
    recording = toy_recording(
        np.random.default_rng(8), 400, change={"hpc.efficiency": -0.04, "hpc.flow_capacity": -0.05}
    )
    (window,) = found(toy_monitor(), recording)
    result = isolate(judge(window).score)
    assert result.isolated == ("hpc.efficiency", "hpc.flow_capacity")
    for size, truth in zip(result.sizes, (-0.04, -0.05), strict=True):
        assert abs(size.change - truth) < 4 * size.standard_error
    assert 0.8 < lack_of_fit(window.statistics).ratio < 1.2
    (linear,) = found(toy_monitor(), recording, linearise="nominal")
    assert set(isolate(judge(linear).score).isolated) != {"hpc.efficiency", "hpc.flow_capacity"}


def test_an_offset_that_recordings_may_have_raises_no_alarm():
    recording = toy_recording(np.random.default_rng(9), 200, shift=[0, 0, 8.0, 0, 0])
    (with_offset,) = found(toy_monitor(offset=5.0), recording)
    assert judge(with_offset).verdict == "healthy"
    (without,) = found(toy_monitor(), recording)
    assert judge(without).verdict == "fault"


def test_a_parameter_that_identification_left_uncertain_raises_no_alarm():
    recording = toy_recording(np.random.default_rng(10), 200, shift=[6.0, 0, 0, 0, 0])
    assert judge(found(toy_monitor(uncertain=5.0), recording)[0]).verdict == "healthy"
    assert judge(found(toy_monitor(), recording)[0]).verdict == "fault"


@pytest.mark.parametrize("linearise", ["nominal", "estimate"])
def test_healthy_windows_alarm_as_often_as_stated(linearise):
    recording = toy_recording(np.random.default_rng(11), 30, flights=300)
    alarms = sum(
        judge(w, 0.05).verdict == "fault" for w in found(toy_monitor(offset=2.0), recording, linearise=linearise)
    )
    assert 4 <= alarms <= 28  # 0.1 % and 99.9 % points of the binomial law for 300 windows at 5 %


def test_a_recording_without_an_input_is_refused_with_a_near_match():
    recording = toy_recording(np.random.default_rng(12), 10)
    columns = {("Wf_kgs" if c == "Wf_kg_s" else c): v for c, v in recording.columns.items()}
    with pytest.raises(DataError, match=r"toy\.csv: no column Wf_kg_s \(did you mean 'Wf_kgs'"):
        found(toy_monitor(), replace(recording, columns=columns, order=()))


def test_windows_in_time_need_time_that_runs_forward():
    recording = toy_recording(np.random.default_rng(13), 10, flights=2)
    one_flight = replace(recording, text={}, order=())
    with pytest.raises(DataError, match="backwards"):
        found(toy_monitor(), one_flight, "60s")
    assert [w.records for w in found(toy_monitor(), recording, "60s")] == [6, 6, 4, 4]


def test_a_sensor_that_is_not_recorded_is_left_out():
    recording = toy_recording(np.random.default_rng(14), 100)
    columns = {c: v for c, v in recording.columns.items() if c != "P3_Pa"}
    (window,) = found(toy_monitor(), replace(recording, columns=columns, order=()))
    assert window.statistics.dof == 400
    assert len(SIGMA) == 5
