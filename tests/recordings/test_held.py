"""Held readings: a reading that was written several times counts once, and one that was rounded is not held."""

import numpy as np
import pytest

from enginediag_cli.recordings.masking import LiveMasker, MaskingRules, mask_recording
from enginediag_cli.recordings.repeated import RepeatWatch, hold_length
from enginediag_cli.recordings.table import Recording

N = 600


def one_flight(n=N):
    return np.zeros(n, int)


def wander(rng, n):
    return np.cumsum(rng.standard_normal(n)) + rng.standard_normal(n)


@pytest.mark.parametrize("k", [1, 2, 3, 4, 10, 20])
def test_the_length_of_the_hold_is_found(k):
    x = np.repeat(wander(np.random.default_rng(k), N // k), k)
    assert hold_length(x, one_flight(len(x))) == k


def test_a_rate_that_is_no_multiple_is_found():
    x = wander(np.random.default_rng(1), N)[np.arange(N) * 2 // 5]
    assert hold_length(x, one_flight()) in (2, 3)


@pytest.mark.parametrize("step", [0.3, 1.0, 3.0, 10.0])
@pytest.mark.parametrize("slope", [0.0, 0.01, 0.2, 0.33, 0.5])
def test_rounded_readings_are_not_held(step, slope):
    rng = np.random.default_rng(2)
    x = 500 + slope * np.arange(N) + rng.standard_normal(N)
    assert hold_length(np.round(x / step) * step, one_flight()) == 1


def test_a_slow_climb_in_steps_and_a_fixed_value_are_not_held():
    assert hold_length(25.0 * (np.arange(N) // 3), one_flight()) == 1
    assert hold_length(np.full(N, 7.0), one_flight()) == 1
    lever = np.repeat([0.3, 0.9, 0.7, 0.75, 0.4], N // 5)
    assert hold_length(lever, one_flight()) == 1


def recording(rng, k_rows=1, k_sensor=1, k_input=1, n=N):
    def channel(k):
        return np.repeat(np.repeat(wander(rng, n // k), k)[:n], k_rows)

    columns = {
        "time_s": np.arange(n * k_rows) * 1.0,
        "altitude_m": 900 + channel(1),
        "Wf_kg_s": 5 + channel(k_input) / 100,
    }
    columns |= {"T3_K": 700 + channel(1), "T45_K": 900 + channel(k_sensor), "N2_rpm": 9000 + channel(1)}
    return Recording(columns)


JUDGED = MaskingRules(("T3_K", "T45_K", "N2_rpm"), ("altitude_m", "Wf_kg_s"))


def readings(clean, column):
    return int(np.isfinite(clean[column]).sum())


@pytest.mark.parametrize("k", [2, 4, 10])
def test_rows_written_several_times_count_once(k):
    clean, report = mask_recording(recording(np.random.default_rng(k), k_rows=k, n=200), JUDGED)
    assert [readings(clean, c) for c in JUDGED.sensors] == [200] * 3
    assert report.columns["T3_K"]["held"] == 200 * (k - 1)


def test_one_slow_sensor_loses_its_repeats_alone():
    clean, _ = mask_recording(recording(np.random.default_rng(5), k_sensor=5), JUDGED)
    assert [readings(clean, c) for c in JUDGED.sensors] == [N, N // 5, N]


def test_a_slow_input_leaves_a_record_for_each_of_its_readings():
    clean, _ = mask_recording(recording(np.random.default_rng(6), k_input=4), JUDGED)
    assert [readings(clean, c) for c in JUDGED.sensors] == [N // 4] * 3
    assert np.isfinite(clean["Wf_kg_s"]).all()


@pytest.mark.parametrize("chunk", [1, 20, N])
def test_a_slow_sensor_is_seen_while_it_is_written(chunk):
    whole = recording(np.random.default_rng(7), k_sensor=5)
    masker = LiveMasker(JUDGED)
    parts = [p for i in range(0, N, chunk) for p in masker.add(whole.select(slice(i, i + chunk)))]
    assert sum(readings(p, "T45_K") for p in parts) == N // 5
    assert sum(readings(p, "T3_K") for p in parts) == N


@pytest.mark.parametrize("value", [None, 0.0, 999.0])
def test_a_sensor_that_dies_is_seen_while_it_is_written(value):
    whole = recording(np.random.default_rng(8))
    dead = whole["T45_K"].copy()
    dead[300:] = dead[299] if value is None else value
    masker = LiveMasker(JUDGED)
    parts = [
        p for i in range(0, N, 20) for p in masker.add(whole.with_columns({"T45_K": dead}).select(slice(i, i + 20)))
    ]
    assert sum(readings(p, "T45_K") for p in parts) <= 301
    clean, _ = mask_recording(whole.with_columns({"T45_K": dead}), JUDGED)
    assert readings(clean, "T45_K") <= 301


@pytest.mark.parametrize("block", [1, 7, 400])
def test_a_live_channel_that_was_stuck_several_times_is_not_rounded(block):
    rng = np.random.default_rng(5)
    x, other = rng.standard_normal((2, 400))
    stuck = np.zeros(400, bool)
    for first in (50, 150, 250, 350):
        x[first : first + 40] = x[first - 1]
        stuck[first : first + 40] = True
    watch, masks = RepeatWatch(), []
    for i in range(0, 400, block):
        found = watch.add({"x": x[i : i + block], "other": other[i : i + block]}, np.arange(i, min(i + block, 400)))
        assert "other" not in found
        masks.append(found.get("x", np.zeros(len(x[i : i + block]), bool)))
    assert np.array_equal(np.concatenate(masks), stuck)
    runs = [(run.column, run.first_line, run.last_line, run.records, run.value) for run in watch.stuck]
    assert runs == [("x", k - 1, k + 39, 41, x[k - 1]) for k in (50, 150, 250, 350)]
