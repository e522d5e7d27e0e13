from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from enginediag_cli.faults.catalogue import STEP, SensorFault, SensorFaultState, clocks_from_columns, sensor_truth

N = 300
CLOCKS = clocks_from_columns({}, N)
READING = 700.0 + np.arange(N) * 0.1
LAW = {**STEP, "onset": 101.0}


def read(effect, law=LAW, chunks=1):
    state = SensorFaultState(SensorFault("f", "T3_K", effect, law))
    edges = np.linspace(0, N, chunks + 1).astype(int)
    return np.concatenate([state.apply(READING[a:b], CLOCKS.slice(a, b)) for a, b in pairwise(edges)])


def test_bias_adds_from_the_onset_on():
    np.testing.assert_allclose(read({"type": "bias", "size": 5.0}) - READING, 5.0 * (np.arange(N) >= 100))


def test_scale_multiplies():
    np.testing.assert_allclose(read({"type": "scale", "change": 0.01})[100:] / READING[100:], 1.01)


@pytest.mark.parametrize("chunks", [1, 2, 7])
def test_stuck_sensor_repeats_its_last_good_reading_across_chunks(chunks):
    x = read({"type": "stuck", "value": None}, chunks=chunks)
    assert set(x[100:]) == {READING[99]}
    np.testing.assert_array_equal(x[:100], READING[:100])


def test_stuck_sensor_can_hold_a_given_value():
    assert set(read({"type": "stuck", "value": 273.15})[100:]) == {273.15}


def test_sensor_stuck_from_the_start_repeats_its_first_reading():
    assert set(read({"type": "stuck", "value": None}, STEP)) == {READING[0]}


def test_intermittently_stuck_sensor_holds_what_it_read_before_each_time():
    law = {**STEP, "type": "intermittent", "onset": 11.0, "period": 20.0, "present": 0.5}
    x = read({"type": "stuck", "value": None}, law)
    assert set(x[10:20]) == {READING[9]} and set(x[30:40]) == {READING[29]} and x[25] == READING[25]


def test_dropped_sensor_gives_no_reading():
    np.testing.assert_array_equal(np.isnan(read({"type": "dropped"})), np.arange(N) >= 100)


def test_truth_adds_biases_and_multiplies_factors_of_one_column():
    effects = [
        {"type": "bias", "size": 2.0},
        {"type": "bias", "size": 3.0},
        {"type": "scale", "change": 0.1},
        {"type": "scale", "change": 0.2},
    ]
    hidden = sensor_truth([SensorFault(f"f{k}", "T3_K", e) for k, e in enumerate(effects)], CLOCKS)
    assert hidden["sensor.T3_K.bias"][0] == 5.0
    assert hidden["sensor.T3_K.scale"][0] == pytest.approx(1.1 * 1.2)


@pytest.mark.parametrize("chunks", [1, 3])
def test_a_noisy_sensor_scatters_by_its_size_from_the_onset_on_whatever_the_chunks(chunks):
    x = read({"type": "noise", "size": 4.0}, chunks=chunks) - READING
    assert not x[:100].any()
    assert np.std(x[100:]) == pytest.approx(4.0, rel=4 / np.sqrt(2 * 200))
    np.testing.assert_array_equal(x, read({"type": "noise", "size": 4.0}) - READING)
