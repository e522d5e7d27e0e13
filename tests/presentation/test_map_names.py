"""Places and drivers of a map, in words."""

from __future__ import annotations

import pytest

from enginediag_cli.mismatch.fit.freeform import locations_of
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.presentation.map_names import driver_in_words, group_in_words, location_words
from enginediag_cli.shipped import shipped


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("hpc.efficiency", "HPC isentropic efficiency"),
        ("sensor.T3", "T3 sensor"),
        ("customer_bleed@hpc", "customer bleed at HPC"),
        ("tat_probe_heating@ambient", "heating of the air-temperature probe"),
    ],
)
def test_a_place_is_told_as_an_engineer_says_it(name, words):
    assert location_words(name) == words


def test_every_place_of_an_engine_has_words_of_its_own():
    engine = load_engine(str(shipped("turbofan.yaml")))
    names = [place.name for place in locations_of(engine, list(engine.sensors))]
    assert len({location_words(name) for name in names}) == len(names)
    assert not any("_" in location_words(name) or "@" in location_words(name) for name in names)


def test_drivers_that_cannot_be_told_apart_are_told_one_by_one():
    group = "ambient_pressure = reynolds_index = core_nozzle = N1"
    assert group_in_words(group) == ["ambient pressure", "inlet Reynolds index", "core nozzle pressure ratio", "N1"]


def test_a_recorded_column_keeps_its_name():
    assert driver_in_words("valve_open") == "valve_open"
    assert driver_in_words("hours_h") == "hours_h"
