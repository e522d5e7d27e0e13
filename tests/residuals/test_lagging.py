"""What a moving engine's readings lag by, unknown to its model: found by identification, uncertain for the monitor."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.detection.verdict import judge
from enginediag_cli.engine.filters import FilterClock, Lag
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.engine.wrapped import LAGS_S, LagModel
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.nominal_file import read_nominal, write_nominal
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect
from enginediag_cli.recordings.table import Recording
from enginediag_cli.residuals.monitor import monitor_from_nominal
from enginediag_cli.residuals.pipeline import window_statistics
from enginediag_cli.residuals.reduced import add_sensor_lags, reduce_monitor
from enginediag_cli.residuals.windows import plan_windows
from enginediag_cli.validation.trial_flights import draw_moving_flights

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
LAG_S = 6.0


def engine_of():
    return load_engine(CONFIGS / "recuperated_micro_gas_turbine.yaml")


def flown(lag_s, seed, count):
    """An engine that knows of no lag, and flights of one whose exhaust probe lags, on the tapes of the first."""
    engine, rng = engine_of(), np.random.default_rng(seed)
    truth = engine.replace_effects([effect(engine, "probe_lag", "T6", {"time_constant": lag_s})] if lag_s else [])
    flights = []
    while len(flights) < count:
        flights += draw_moving_flights(engine, rng)[0]
    found = []
    for flight in flights[:count]:
        columns = {c: flight[c] for c in ("time_s", *engine.inputs)}
        columns[MOMENT] = engine.tapes.add(columns)
        p = truth.predict({c: columns[c] for c in (*engine.inputs, MOMENT)}, {})
        sigma = np.array([s.noise_sigma for s in engine.sensors.values()])
        y = p.y + sigma * rng.standard_normal(p.y.shape)
        columns |= dict(zip(engine.sensors, y.T, strict=True))
        found.append({c: v[p.ok] for c, v in columns.items()})
    return engine, found


@cache
def identified(lag_s):
    engine, flights = flown(lag_s, 5, 10)
    training = [TrainingRecording(f"flight {k + 1}", f, None) for k, f in enumerate(flights[:6])]
    return engine, identify(engine, training, cross_validation=False), flights[6:]


def judged(monitor, flights):
    """Verdicts of windows of a minute."""
    recordings = [Recording(dict(f), source=f"{k}") for k, f in enumerate(flights)]
    return [judge(w) for w in window_statistics(monitor, recordings, plan_windows("60"))]


def test_a_reading_at_rest_is_not_ahead_of_its_lags():
    engine = engine_of()
    columns = {c: np.full(50, 0.5 * sum(engine.envelope[c])) for c in engine.inputs}
    moment = engine.tapes.add({"time_s": np.arange(50.0), **columns})
    at = LagModel(engine, {})
    assert not at.deviations({MOMENT: moment}, tuple(engine.sensors), 50).any()
    assert not at.deviations({}, tuple(engine.sensors), 50).any()  # of records without a past nothing is known


def test_a_probe_that_lags_is_behind_by_the_deviation_of_its_lag():
    engine, [flight] = flown(0.0, 3, 1)
    at = {c: flight[c] for c in engine.inputs}
    i = list(engine.sensors).index("T6_K")
    lag = Lag()
    true = engine.predict(at, {}).y[:, i]
    first = np.arange(len(true)) == 0
    expected = lag(FilterClock(flight["time_s"], first), true, np.zeros((0, len(true))), (LAGS_S[1],)).value
    found = LagModel(engine, {}).deviations(flight, tuple(engine.sensors), len(true))
    assert found[:, i, 1] == pytest.approx(expected, abs=1e-6)


def test_a_lag_that_the_model_lacks_is_found_and_is_no_noise():
    _, result, _ = identified(LAG_S)
    reading = {r.sensor: r for r in result.sensor_lags}["T6_K"]
    assert reading.amounts == pytest.approx((0.0, 1.0, 0.0, 0.0), abs=4 * max(reading.spread))
    assert reading.moved > 1.5 * reading.left
    noise = dict(zip(result.problem.sensors, result.monitoring_noise.sigma, strict=True))
    assert noise["T6_K"] == pytest.approx(1.5, rel=0.1)


def test_an_engine_without_memory_lags_behind_nothing():
    _, result, _ = identified(0.0)
    assert result.sensor_lags == ()


def test_recordings_without_time_know_of_no_lag():
    engine, flights = flown(LAG_S, 6, 6)
    training = [
        TrainingRecording(f"{k}", {c: v for c, v in f.items() if c not in ("time_s", MOMENT)}, None)
        for k, f in enumerate(flights)
    ]
    assert identify(engine, training, cross_validation=False).sensor_lags == ()


def test_recordings_behind_a_gate_know_of_no_lag():
    engine, flights = flown(LAG_S, 6, 6)
    kept = [np.arange(len(f["time_s"])) % 60 < 40 for f in flights]
    training = [
        TrainingRecording(f"{k}", {c: v[keep] for c, v in f.items()}, None)
        for k, (f, keep) in enumerate(zip(flights, kept, strict=True))
    ]
    assert identify(engine, training, cross_validation=False).sensor_lags == ()


def test_a_healthy_engine_raises_no_alarm_for_the_lag_that_its_model_lacks():
    engine, result, later = identified(LAG_S)
    nominal = result.nominal("engine.yaml", "0" * 64, {})
    known = add_sensor_lags(reduce_monitor(monitor_from_nominal(engine, nominal)))
    assert not any(v.test.alarm for v in judged(known, later) if v.test)
    certain = reduce_monitor(monitor_from_nominal(engine, replace(nominal, sensor_lags=())))
    # offsets that a few recordings leave wide take some of it, as an error that this recording has throughout
    statistics = [[v.test.statistic for v in judged(m, later) if v.test] for m in (known, certain)]
    assert np.mean(statistics[1]) > 1.5 * np.mean(statistics[0])


def test_a_worn_engine_still_raises_it():
    engine, result, later = identified(LAG_S)
    nominal = result.nominal("engine.yaml", "0" * 64, {})
    before = engine.predict({c: later[0][c] for c in engine.inputs}, {}).y
    after = engine.predict({c: later[0][c] for c in engine.inputs}, {"compressor.efficiency": 0.97}).y
    worn = {**later[0]}
    for i, c in enumerate(engine.sensors):
        worn[c] = worn[c] + (after - before)[:, i]
    monitor = add_sensor_lags(reduce_monitor(monitor_from_nominal(engine, nominal)))
    assert all(v.test.alarm for v in judged(monitor, [worn]) if v.test and v.window.statistics.n > 30)


def test_what_readings_lag_by_survives_the_nominal_file(tmp_path):
    engine, result, _ = identified(LAG_S)
    nominal = result.nominal("engine.yaml", "0" * 64, {})
    write_nominal(nominal, str(tmp_path / "nominal.yaml"))
    found = read_nominal(tmp_path / "nominal.yaml").sensor_lags
    assert [r.sensor for r in found] == list(engine.sensors)
    for a, b in zip(found, nominal.sensor_lags, strict=True):
        assert a.amounts == pytest.approx(b.amounts, rel=1e-6)
