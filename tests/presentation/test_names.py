"""Parameter names in words."""

from __future__ import annotations

import pytest

from enginediag_cli.presentation.names import in_words, listed


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("hpc.efficiency", "HPC isentropic efficiency"),
        ("fan.efficiency", "fan isentropic efficiency"),
        ("hpt.flow_capacity", "HPT flow capacity"),
        ("core_nozzle.area", "core nozzle area"),
        ("burner.efficiency", "burner combustion efficiency"),
        ("hp_shaft.efficiency", "HP shaft mechanical efficiency"),
        ("burner.pressure_loss", "burner pressure loss"),
        ("sensor.T3.bias", "T3 sensor bias"),
        ("sensor.Wf.scale", "Wf sensor scale factor"),
        ("hpc.map.work_slope", "HPC map work slope"),
        ("something_new.odd_thing", "something new odd thing"),
    ],
)
def test_a_parameter_is_named_as_an_engineer_says_it(name, words):
    assert in_words(name) == words


def test_a_list_ends_with_its_conjunction():
    assert listed(["a"]) == "a"
    assert listed(["a", "b"]) == "a and b"
    assert listed(["a", "b", "c"], "or") == "a, b or c"
