"""Faults of another simulator's engine, by default options: every instrument a suspect, noise of our own."""

from __future__ import annotations

import pycycle_isolation
import pycycle_runs
import pytest
import shared_data

pytestmark = [pytest.mark.shared_data, pytest.mark.slow]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    if not shared_data.available("pycycle_hbtf"):
        pytest.skip(shared_data.reason("pycycle_hbtf"))
    folder = tmp_path_factory.mktemp("pycycle")
    pycycle_runs.write(folder, ["nominal", "fault_1", "fault_2", "fault_3", "faults_random"], 2)
    found = pycycle_isolation.judged(1, folder)
    assert found["identify"] == 0, found["told"]
    return {**found, "off": pycycle_isolation.sensor_off(1, 0, folder, every=4)}


def test_of_80_records_exactly_what_changed_is_named(found):
    for name, truth, rows in found["whole"]:
        assert pycycle_isolation.answer(rows) == set(truth), name


def test_of_single_records_no_instrument_is_named_and_intervals_hold_nine_of_ten(found):
    held = []
    for truth, rows in found["single"]:
        named = pycycle_isolation.answer(rows)
        assert not any(n.startswith(("sensor.", "input.")) for n in named) or float(rows[0]["probability"]) < 0.7
        held += [
            float(r["lower"]) <= truth.get(r["parameter"], 0.0) <= float(r["upper"]) for r in rows if r["parameter"]
        ]
    assert len(held) > 50 and sum(held) > 0.9 * len(held)


def test_a_sensor_that_is_off_by_three_standard_deviations_is_named_and_nothing_else(found):
    for sensor, rows in found["off"]:
        assert pycycle_isolation.answer(rows) == {sensor}
        assert float(rows[0]["probability"]) > 0.7
