"""One object per driver: what a recorded column is, and what a map tells of it."""

from __future__ import annotations

import numpy as np
import pytest
from concealed import flights, turbofan

from enginediag_cli.drivers import (
    CONSTANT,
    DRIVERS,
    HOURS,
    HUMIDITY,
    SWITCH,
    TIME,
    drivers,
    polynomials,
    recorded_driver,
    true_drivers,
)
from enginediag_cli.engine.term import Driver, DriverValues
from enginediag_cli.mismatch.fit.freeform import Cell, Location
from enginediag_cli.mismatch.fit.projection import Score
from enginediag_cli.mismatch.locate.locate import Place
from enginediag_cli.mismatch.locate.verdict_kind import EFFECT, SENSOR_ERROR, _kind
from enginediag_cli.mismatch.locate.verdict_kind import SWITCH as SWITCHES
from enginediag_cli.physics.registry import candidate_effects

FUEL = np.linspace(300.0, 430.0, 40)


def test_a_recorded_temperature_is_a_quantity_in_its_unit_and_no_switch():
    found = recorded_driver("fuel_temperature_K", FUEL)
    assert found != SWITCH and (found.unit, found.words) == ("K", "fuel_temperature_K")


@pytest.mark.parametrize("values", [[0, 1, 1, 0], [0, np.nan, 1], [1.0, 1.0]])
def test_a_column_of_nothing_but_0_1_and_gaps_is_a_switch(values):
    assert recorded_driver("valve_open", np.array(values, float)) == SWITCH


@pytest.mark.parametrize("values", [[0, 1, 2], [0, 0.5, 1], [np.nan, np.nan]])
def test_any_other_column_is_none(values):
    assert recorded_driver("valve_open", np.array(values, float)) != SWITCH


def test_hours_are_known_by_their_unit():
    assert recorded_driver("since_wash_h", np.arange(5.0)) == HOURS
    assert recorded_driver("depth", np.arange(5.0)) != HOURS


def place(driver: DriverValues, location: Location) -> Place:
    score = Score(10.0, 1, 5.0, np.zeros(1), 1.0, 1.0)
    cell = Cell(None, np.zeros((1, 2), int), score, location, driver)  # type: ignore[arg-type]
    return Place(cell, driver.name, (driver.short,), 10.0, 5.0, 0.01, 0.5, 1.0)


def test_an_effect_along_a_recorded_temperature_is_no_effect_that_switches():
    hpc = Location("hpc.efficiency", "hpc.efficiency", "hpc", words="HPC isentropic efficiency")
    fuel = DriverValues(recorded_driver("fuel_K", FUEL), "fuel_K", FUEL, "fuel_K")
    valve = DriverValues(SWITCH, "valve", np.tile([0.0, 1.0], 20), "valve")
    assert _kind(place(fuel, hpc), None) == EFFECT
    assert _kind(place(valve, hpc), None) == SWITCHES
    sensor = Location("sensor.T3", "sensor.T3.scale", "sensor.T3", words="T3 sensor", belongs_to_sensor=True)
    assert _kind(place(fuel, sensor), None) == SENSOR_ERROR


@pytest.fixture(scope="module")
def inputs():
    (flight,) = flights([], np.random.default_rng(1), count=1, records=30)
    return {c: flight.columns[c] for c in turbofan().inputs}


def test_every_driver_that_is_listed_has_words_and_a_word_of_its_own():
    assert len({d.word for d in DRIVERS}) == len(DRIVERS)
    assert all(d.words and d.unit for d in (*DRIVERS, TIME))


def test_a_driver_that_a_term_brings_is_tried_with_the_listed_ones(inputs):
    def values(at):
        yield DriverValues(own, "squared", np.asarray(at.inputs["mach"]) ** 2, "Mach number squared")

    own = Driver("squared", "the square of Mach number", values=values)
    found = drivers(turbofan(), inputs, {}, {"fuel_K": np.linspace(300, 400, 30)}, [own])
    assert [(d.name, d.unit) for d in found[-2:]] == [("squared", "1"), ("fuel_K", "K")]


def test_what_a_driver_truly_is_does_not_hang_on_what_was_recorded(inputs):
    for d in DRIVERS:
        for found in true_drivers(turbofan(), inputs, {}, d):
            assert found.driver == d and found.values.shape == (30,)
    (humidity,) = true_drivers(turbofan(), {c: v for c, v in inputs.items() if c != "humidity_kg_kg"}, {}, HUMIDITY)
    assert np.all(humidity.values > 0)


def test_what_a_term_changes_is_carried_by_the_driver_that_it_states():
    engine = turbofan()
    recorded = flights([], np.random.default_rng(6), count=4, records=40)
    inputs = {c: np.concatenate([f.columns[c] for f in recorded]) for c in engine.inputs}
    along = drivers(engine, inputs, {})
    X = {d.name: np.column_stack([np.ones(len(d.values)), polynomials(d.values, 2)]) for d in along}
    behind = {}
    for e in candidate_effects(engine):
        acts_on = e.site.targets[0]
        own = [d.name for d in along if d.driver == e.term.DRIVER]
        reading = engine.sensors.get(acts_on.removeprefix("reading "))
        # a reading roams by a parameter of its own: an offset, or a factor
        leaf = acts_on if reading is None else next((p.name for p in reading.parameters() if p.roams), "")
        if e.term.DRIVER in (CONSTANT, SWITCH) or not own or leaf not in engine.parameters:
            continue
        with_it = engine.replace_effects((*engine.effects, e))
        J = with_it.predict(inputs, {}, sensors=tuple(engine.sensors), wrt=(e.amplitudes[0], leaf)).jacobian
        J = J / np.array([s.noise_sigma for s in engine.sensors.values()])[:, None]
        if not J[:, :, 1].any(axis=1).all():
            continue
        # how much the leaf must change to move the readings so
        change = (J[:, :, 0] * J[:, :, 1]).sum(axis=1) / (J[:, :, 1] ** 2).sum(axis=1)
        left = {n: np.sum((change - V @ np.linalg.lstsq(V, change, rcond=None)[0]) ** 2) for n, V in X.items()}
        total = np.sum((change - change.mean()) ** 2)
        behind[e.label] = (min(left[n] for n in own) - min(left.values())) / total
    assert len(behind) > 30
    # behind a fan whose nozzle chokes the corrected flow follows the nozzle more than the fan's speed
    behind.pop("duct_pressure_loss@bypass_duct")
    # behind turbines that choke the Mach number stands still, and what varies is the temperature
    behind.pop("thermocouple_recovery@T45"), behind.pop("thermocouple_recovery@T5")
    # what the stated driver leaves beyond the best one: parts of ducts and probes go with two of them
    assert {name: round(share, 2) for name, share in behind.items() if share > 0.2} == {}
