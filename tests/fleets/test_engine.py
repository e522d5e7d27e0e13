"""The judgement of one engine of a fleet, on flights of the turbofan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from turbofan_fleet import BASELINE, engine_history, geometry, judged, known, lost, scale

from enginediag_cli.fleets.findings import CHANGED, HEALTHY, NO_VERDICT, MaintenanceEvent
from enginediag_cli.history.engines import CHANGED as TREND_CHANGED
from enginediag_cli.history.engines import HistoryOptions, judge_engine_history


def row(finding, name):
    return next(r for r in finding.health if r.parameter == name)


def test_the_margin_is_of_the_hottest_recorded_temperature_at_given_thrust():
    assert scale().column == "T45_K" and scale().fixed_column == "Fn_N" and not scale().reason
    engine = geometry().monitor.engine
    at = {c: np.array([v]) for c, v in scale().reference.items()}
    first = engine.predict(at, {}, sensors=("T45_K", "Fn_N")).y[0]
    # what 1 % of HPT efficiency costs, the fuel raised until thrust is as before
    low, high = 1.0, 1.05
    for _ in range(40):
        factor = (low + high) / 2
        fuel = {**at, "Wf_kg_s": factor * at["Wf_kg_s"]}
        worn = engine.predict(fuel, {"hpt.efficiency": 0.999}, sensors=("T45_K", "Fn_N")).y[0]
        low, high = (low, factor) if worn[1] > first[1] else (factor, high)
    assert -0.001 * scale().slope["hpt.efficiency"] == pytest.approx(worn[0] - first[0], rel=0.02)


def test_a_healthy_engine_is_called_so_and_has_its_margin():
    found = judged(engine_history(np.random.default_rng(1), "A", 80))
    assert found.verdict == HEALTHY and found.since == 0 and found.probability < 0.5
    assert len(found.by_flight) == 80 and found.by_flight[0].verdict == "baseline"
    assert found.severity.low < 0.0 < found.severity.high and found.severity_unit == "K"
    assert found.margin.now_K.value == pytest.approx(1500.0 - scale().nominal_K, abs=25.0)


def test_what_is_worn_is_named_with_its_onset_and_what_it_takes_of_the_margin():
    change = lost(120, {"hpt.efficiency": -1.0, "hpt.flow_capacity": 0.5}, np.arange(120) >= 70)
    found = judged(engine_history(np.random.default_rng(2), "B", 120, change))
    assert found.verdict == CHANGED and found.probability > 0.999
    assert found.since_low <= 71 <= found.since_high and found.since_high - found.since_low < 20
    best = max(found.health, key=lambda r: r.probability)
    assert best.component == "hpt" and best.kind == "step" and best.onset_flight
    expected = -scale().slope["hpt.efficiency"] * 0.02 + scale().slope["hpt.flow_capacity"] * 0.5 * 0.02
    assert found.severity.low - 1 < expected < found.severity.high + 1
    assert found.by_flight[60].verdict == HEALTHY and found.by_flight[-1].verdict == CHANGED


def test_instruments_that_wander_each_by_itself_are_no_change_of_a_component():
    """By six tenths of the offsets that come with each flight, over 5 to 30 flights: what wanders may be named, as the
    instrument that it is."""
    rng = np.random.default_rng(41)
    found = [judged(engine_history(rng, str(k), 60, wander=0.6)) for k in range(12)]
    assert sum(f.verdict == CHANGED for f in found) <= 2
    assert all(r.component.startswith("sensor.") for f in found for r in f.health if r.onset)


def test_an_instrument_that_fails_uses_no_margin():
    change = lost(100, {"sensor.T45.bias": 6.0}, np.arange(100) >= 50)
    found = judged(engine_history(np.random.default_rng(3), "C", 100, change))
    assert found.verdict == CHANGED
    named = max(found.health, key=lambda r: r.probability)
    assert named.parameter == "sensor.T45.bias"
    assert named.change.low < 45.0 < named.change.high and named.change.value > 20.0
    assert abs(found.severity.value) < 6.0 < 6 * 7.5  # K; it reads 45 K too high


def test_a_change_that_no_component_shows_is_named_by_nothing_and_takes_no_margin():
    """As of a column in another unit: an HPC that lost half of its efficiency does not run."""
    change = lost(60, {"hpc.efficiency": -25.0}, np.arange(60) >= 40)
    found = judged(engine_history(np.random.default_rng(9), "I", 60, change))
    assert found.verdict == CHANGED and "check units and engine file" in found.reason
    assert np.isnan(found.severity.value) and np.isnan(found.margin.now_K.value)
    assert not any(r.onset for r in found.health) and all(r.probability < 0.5 for r in found.health)


def test_what_a_wash_brought_is_told_and_is_no_change():
    course = np.where(
        np.arange(140) < 80, np.clip((np.arange(140) - 20) / 60, 0, 1), np.clip((np.arange(140) - 80) / 60, 0, 1)
    )
    change = lost(140, {"hpc.efficiency": -0.8, "hpc.flow_capacity": -0.8}, course)
    wash = MaintenanceEvent("D", "wash", flight="81")
    found = judged(engine_history(np.random.default_rng(4), "D", 140, change, (wash,)))
    (told,) = found.events
    assert told.number == 81 and not told.reason
    assert set(told.gains) == {f"{c}.{q}" for c in ("fan", "booster", "hpc") for q in ("efficiency", "flow_capacity")}
    gain = told.gains["hpc.efficiency"]
    assert gain.value == pytest.approx(0.8 * 0.02, abs=0.75 * (gain.high - gain.low)) and gain.low > 0.005
    assert told.recovered_K.value > 2 * (told.recovered_K.high - told.recovered_K.value) / 1.96


def test_a_renewed_engine_is_judged_by_what_came_after():
    change = lost(120, {"hpc.efficiency": -1.5}, (np.arange(120) >= 30) & (np.arange(120) < 60))
    overhaul = MaintenanceEvent("E", "overhaul", flight="61")
    found = judged(engine_history(np.random.default_rng(5), "E", 120, change, (overhaul,)))
    assert found.verdict == HEALTHY and found.by_flight[0].number == 61
    assert found.events[0].reason == "the engine is another one since"
    kept = judged(replace(engine_history(np.random.default_rng(5), "E", 120, change), events=()))
    assert kept.verdict == CHANGED


def test_an_exchanged_component_is_neither_a_change_nor_one_that_is_told_of_another():
    change = lost(120, {"hpt.efficiency": 1.0}, np.arange(120) >= 70)
    exchange = MaintenanceEvent("F", "exchange", flight="71", component="hpt")
    found = judged(engine_history(np.random.default_rng(6), "F", 120, change, (exchange,)))
    assert found.verdict == HEALTHY
    assert set(found.events[0].gains) == {"hpt.efficiency", "hpt.flow_capacity"}
    gain = found.events[0].gains["hpt.efficiency"]
    assert gain.low < 0.02 < gain.high and gain.low > 0


@pytest.mark.parametrize(("flights", "says"), [(0, "too few"), (2, "too few"), (BASELINE + 2, "too few")])
def test_too_few_flights_are_no_verdict(flights, says):
    found = judged(engine_history(np.random.default_rng(7), "G", flights))
    assert found.verdict == NO_VERDICT and says in found.reason and not found.health


def test_a_step_has_its_kind_onset_and_size():
    change = lost(60, {"hpc.efficiency": -1.5}, np.arange(60) >= 40)
    found = judged(engine_history(np.random.default_rng(8), "H", 60, change))
    told = row(found, "hpc.efficiency")
    assert told.kind == "step" and told.probability > 0.4 and abs(told.onset - 41) <= 2
    assert told.change.low < -0.03 < told.change.high


def test_the_verdict_is_that_of_the_account_which_a_trend_shows():
    """Of engines that did and did not change, by the same function on the same sums."""
    rng = np.random.default_rng(21)
    for k, size in enumerate((0.0, -0.3, -1.0)):
        change = lost(40, {"hpc.efficiency": size, "hpc.flow_capacity": size / 2}, np.arange(40) >= 30)
        history = engine_history(rng, str(k), 40, change)
        found, trend = judged(history), judge_engine_history(history.sums, known().parameters, HistoryOptions(BASELINE))
        assert (found.verdict == CHANGED) == (trend.verdict == TREND_CHANGED)
        assert [r.parameter for r in found.health if r.onset] == [x.name for e in trend.changes for x in e.changes]
        assert found.probability == trend.probability


def test_what_an_engine_showed_from_its_first_flight_on_is_no_change_and_no_health():
    change = lost(40, {"sensor.P3.bias": 30.0}, np.ones(40))
    found = judged(engine_history(np.random.default_rng(22), "J", 40, change))
    assert found.verdict == NO_VERDICT and "from its first flight on (sensor.P3)" in found.reason
    told = row(found, "sensor.P3.bias")
    assert told.kind == "from start" and told.onset == 0 and told.change.value > 0


def test_an_instrument_that_comes_and_goes_has_the_size_that_it_had() -> None:
    wrong = np.isin(np.arange(60), (27, 28, 34, 41, 42, 50))
    found = judged(engine_history(np.random.default_rng(23), "K", 60, lost(60, {"sensor.T45.bias": 8.0}, wrong)))
    told = row(found, "sensor.T45.bias")
    assert found.verdict == CHANGED and told.kind == "intermittent"
    assert told.change.low < 60.0 < told.change.high and told.change.low > 0
