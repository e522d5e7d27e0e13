"""Who cannot be judged is neither healthy nor faulty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from toy_engine import SENSORS, SIGMA, ToyEngine, toy_monitor, toy_recording

from enginediag_cli.detection.verdict import FAULT, HEALTHY, NO_VERDICT, LackOfFit, is_lifeless, judge
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.gross_gate import GrossErrorGate
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows


def judged(recording, monitor=None):
    (window,) = window_statistics(monitor or toy_monitor(), [recording], plan_windows(None))
    return judge(window)


def checked(recording):
    """The verdict on each flight of a recording, gross errors rejected first."""
    monitor = toy_monitor()
    gate = GrossErrorGate(monitor)
    windows = list(window_statistics(monitor, gate.clean([recording]), plan_windows(None)))
    return [judge(gate.annotate(window), monitor=monitor) for window in windows]


def recording(seed=1, **options):
    return toy_recording(np.random.default_rng(seed), 60, **options)


def without(there, *columns):
    return there.with_columns({c: np.full(len(there), np.nan) for c in columns})


def test_a_healthy_and_a_faulty_engine_are_told_apart():
    assert judged(recording()).verdict == HEALTHY
    assert judged(recording(change={"hpc.efficiency": -0.05})).verdict == FAULT


def test_readings_that_do_not_scatter_are_no_verdict():
    found = judged(recording(noise=1e-6, change={"hpc.efficiency": -0.05}))
    assert found.verdict == NO_VERDICT and "scatter impossibly little" in found.reason


def test_few_readings_that_happen_to_agree_are_not_lifeless():
    assert is_lifeless(LackOfFit(3e-5, 1.0, 1.0, 3e-5)) is False
    assert is_lifeless(LackOfFit(3e-3, 100.0, 1.0, 3e-5)) is True
    assert is_lifeless(LackOfFit(30.0, 100.0, 1.0, 0.3)) is False


def test_one_sensor_alone_tells_nothing():
    found = judged(without(recording(change={"hpc.efficiency": -0.2}), *SENSORS[1:]))
    assert found.verdict == NO_VERDICT and "1 of 5 sensors" in found.reason
    assert judged(without(recording(), *SENSORS[2:])).verdict == HEALTHY


def with_bias_monitored():
    """The toy monitor that watches the bias of T3, too."""
    monitor = toy_monitor(uncertain=5.0)
    engine = ToyEngine()
    bias = Parameter("sensor.T3.bias", "sensor", 0.0, -50.0, 50.0, 5.0)
    object.__setattr__(engine, "parameters", {**engine.parameters, "sensor.T3.bias": bias})
    return replace(monitor, engine=engine, monitored=monitor.names, uncertainty=np.zeros((5, 5)))


def test_a_sensor_without_a_reading_is_no_suspect():
    monitor = with_bias_monitored()
    every = judged(recording(), monitor)
    assert "sensor.T3.bias" in every.score.parameters and every.window.silent == ()
    missing = judged(without(recording(), "T3_K"), monitor)
    assert missing.window.silent == ("sensor.T3.bias",)
    assert missing.score.parameters == monitor.names[:4] == missing.window.statistics.parameters
    assert (missing.window.sensors, missing.window.sensors_of) == (4, 5)


def test_leaving_out_what_tells_nothing_changes_no_test():
    monitor, there = with_bias_monitored(), without(recording(), "T3_K")
    (window,) = window_statistics(monitor, [there], plan_windows(None))
    kept = judge(replace(window, silent=()))
    assert abs(judge(window).test.statistic - kept.test.statistic) < 1e-9


def spoilt(n, row, column, factor, **options):
    """n records of which one cell is wrong by a factor."""
    found = toy_recording(np.random.default_rng(2), n, **options)
    values = found.columns[column].copy()
    values[row] *= factor
    return found.with_columns({column: values})


@pytest.mark.parametrize("column", [SENSORS[0], SENSORS[3], "Wf_kg_s"])
@pytest.mark.parametrize("n", [1, 3])
def test_one_gross_reading_makes_no_alarm_of_records_that_have_no_neighbours(column, n):
    recording = spoilt(n, 0, column, 1.1)
    (window,) = window_statistics(toy_monitor(), [recording], plan_windows(None))
    assert judge(window).verdict == FAULT  # as it is read
    (found,) = checked(recording)
    assert found.verdict == NO_VERDICT
    assert "one channel decides: without " in found.reason
    assert n > 1 or column in found.reason  # of which, several records may leave open


def test_a_fault_that_several_sensors_show_is_one_in_a_single_record_too():
    (found,) = checked(toy_recording(np.random.default_rng(3), 1, change={"hpc.efficiency": -0.08}))
    assert found.verdict == FAULT


def test_flights_of_one_record_are_each_others_neighbours():
    shift = np.zeros(5)
    shift[1] = 12 * SIGMA[1]
    found = checked(toy_recording(np.random.default_rng(4), 1, flights=8, shift=shift))
    assert {v.verdict for v in found} == {FAULT}  # what is so in every flight is no gross error
