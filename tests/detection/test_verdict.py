"""Who cannot be judged is neither healthy nor faulty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from toy_engine import SENSORS, ToyEngine, toy_monitor, toy_recording

from enginediag_cli.detection.lack_of_fit import LackOfFit
from enginediag_cli.detection.verdict import FAULT, HEALTHY, NO_VERDICT, judge, lifeless
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.windows import plan_windows


def judged(recording, monitor=None):
    (window,) = window_statistics(monitor or toy_monitor(), [recording], plan_windows(None))
    return judge(window)


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
    assert lifeless(LackOfFit(3e-5, 1.0, 1.0, 3e-5)) is False
    assert lifeless(LackOfFit(3e-3, 100.0, 1.0, 3e-5)) is True
    assert lifeless(LackOfFit(30.0, 100.0, 1.0, 0.3)) is False


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
