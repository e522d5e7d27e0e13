"""Flights to choose from: inside the envelope, and the same as the mission file that says them."""

from __future__ import annotations

from copy import copy
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.config.document import dump
from enginediag_cli.config.validate import load_checked
from enginediag_cli.isolation.planned_flights import (
    AIRLINER,
    BEYOND,
    CLIMB,
    DESCENT,
    DURATION_S,
    LEVELS,
    MANOEUVRES,
    RECORDS,
    SPEEDS,
    SWEEP,
    WEATHER,
    flights,
    is_inside_flown,
    manoeuvres,
)
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.simulation.flights import generate_flights

CONFIGS = Path(__file__).parents[2] / "configs"
FLYING = ("turbofan", "turboprop", "turboshaft", "citation_jt15d", "afterburning_turbofan")
STAYING = ("power_plant", "micro_gas_turbine", "naval_gas_generator", "amt_olympus")


@cache
def engine(name):
    return load_engine(CONFIGS / f"{name}.yaml")


@pytest.mark.parametrize("name", (*FLYING, *STAYING))
def test_every_flight_lies_in_the_envelope_and_can_be_computed(name):
    e = engine(name)
    found = flights(e, {})
    assert len(found) == len({f.words for f in found}) >= 5
    inputs = [f.inputs(e, 24) for f in found]
    together = {c: np.concatenate([u[c] for u in inputs]) for c in e.inputs}
    assert e.predict(together).ok.all()
    for f, u in zip(found, inputs, strict=True):
        outside = [(u[c] < low - 1e-9) | (u[c] > high + 1e-9) for c, (low, high) in e.envelope.items() if c in u]
        assert np.mean(np.any(outside, axis=0)) <= BEYOND, f.words


def test_what_flies_has_profiles_and_sweeps_and_what_stays_has_loads_and_weather():
    assert {f.kind for f in flights(engine("turbofan"), {})} == {AIRLINER, CLIMB, DESCENT, SWEEP, SPEEDS, LEVELS}
    assert {f.kind for f in flights(engine("power_plant"), {})} == {SWEEP, WEATHER}


@pytest.mark.parametrize("name", ["turbofan", "turboshaft", "power_plant", "naval_gas_generator"])
def test_the_flight_file_of_a_plan_is_the_same_flight(name, tmp_path):
    e = engine(name)
    for k, flight in enumerate([*flights(e, {})[::5], *manoeuvres(e, {})[:1]]):
        path = tmp_path / f"{k}.yaml"
        path.write_text(dump(flight.flight_file(e)), encoding="utf-8")
        flown = generate_flights(load_checked(path, "flight").values, e, np.random.default_rng(0))
        wanted = flight.inputs(e, flight.records)
        assert len(flown) == flight.records
        for c in e.inputs:
            assert np.allclose(np.asarray(flown.columns[c], float), wanted[c], rtol=2e-3, atol=1e-6), (flight.words, c)


def test_inputs_that_no_flight_is_about_are_held_at_what_was_flown_and_swept_to_both_ends():
    e = engine("turboshaft")
    flown = {"N2_rpm": np.array([20900.0, 20950.0, 21000.0])}
    values = sorted({f.constants["N2_rpm"] for f in flights(e, flown)})
    low, high = e.envelope["N2_rpm"]
    room = 0.1 * (high - low)
    assert values == pytest.approx([low + room, 20950.0, high - room])


def test_an_engine_without_an_envelope_has_no_flights():
    e = engine("turbofan")
    other = copy(e)
    other.envelope = {}
    assert flights(other, {}) == []


def test_a_manoeuvre_is_recorded_once_a_second_where_most_was_flown():
    e = engine("turbofan")
    found = manoeuvres(e, {"altitude_m": np.array([9000.0, 9000.0]), "mach": np.array([0.7, 0.7])})
    assert [m.words for m in found] == list(MANOEUVRES)
    u = found[0].inputs(e, DURATION_S)
    assert np.all(u["altitude_m"] == 9000.0) and found[0].time(DURATION_S)[1] == 1.0
    share = (u["Wf_kg_s"] - e.power_from_fraction(0.1, u)) / (
        e.power_from_fraction(0.9, u) - e.power_from_fraction(0.1, u)
    )
    assert np.allclose(share[:30], 0.0) and np.allclose(share[32:], 1.0)


def test_a_flight_above_what_was_flown_is_told_to_go_beyond_it():
    flown = {"altitude_m": np.linspace(0.0, 9000.0, 50)}
    assert is_inside_flown(flown, {"altitude_m": np.linspace(0.0, 9500.0, RECORDS)})
    assert not is_inside_flown(flown, {"altitude_m": np.linspace(0.0, 12000.0, RECORDS)})
