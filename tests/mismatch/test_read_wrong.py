"""Sensors of which an engine file identifies no error read a little wrong all the same, which is nothing missing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.engine import Engine
from enginediag_cli.mismatch.fit.evidence import Dataset, Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.load import MismatchQuery, build_dataset
from enginediag_cli.mismatch.fit.nuisance import read_wrong
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.validation.trial_flights import draw_flights

CONFIGS = Path(__file__).resolve().parents[2] / "configs"
WRONG = {"sensor.T3.scale": 1.002, "sensor.T35.scale": 0.999, "sensor.T6.scale": 1.001}
"""Thermocouples on both sides of a recuperator, whose heat balance ties them together."""


@pytest.fixture(scope="module")
def engine() -> Engine:
    return load_engine(CONFIGS / "recuperated_micro_gas_turbine.yaml")


def evidence(engine: Engine, theta: dict[str, float], accuracy: float) -> Dataset:
    """Two recordings without noise."""
    flights = []
    for k, columns in enumerate(draw_flights(engine, np.random.default_rng(3))[0][:2]):
        y = engine.predict({c: columns[c] for c in engine.inputs}, theta).y
        flights.append(Flight(f"{k}.csv", "", {**columns, **dict(zip(engine.sensors, y.T, strict=True))}))
    return build_dataset(engine, flights, MismatchQuery(model_error=accuracy))


@pytest.mark.parametrize("accuracy", [0.0, 0.003])
def test_thermocouples_that_read_a_thousandth_wrong_leave_nothing_to_explain(engine: Engine, accuracy: float) -> None:
    given = evidence(engine, WRONG, accuracy)
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    assert found.converged and Projection(found).objective < 2.0
    exact = {n: s for n, s in nuisance(given).sigma.items() if n not in WRONG}
    left = identify_with(given, NULL_HYPOTHESIS, replace(nuisance(given), sigma=exact))
    assert Projection(left).objective > 10.0


def test_only_sensors_that_are_recorded_and_of_which_nothing_else_is_known_are_asked_for(engine: Engine) -> None:
    every = read_wrong(engine, engine.sensors, {})
    assert set(every) == {f"sensor.{s.quantity}.scale" for s in engine.sensors.values()}
    assert all(sigma == engine.parameters[n].prior_sigma for n, sigma in every.items())
    assert set(read_wrong(engine, ["T3_K", "T6_K"], {"sensor.T6.scale": 0.01})) == {"sensor.T3.scale"}
    assert not read_wrong(engine, ["T3_K"], {"sensor.T3.bias": 1.0})


def test_what_is_stated_of_recordings_offsets_is_all_that_their_sensors_are_wrong_by() -> None:
    plant = load_engine(CONFIGS / "power_plant.yaml")
    flights = [Flight("0.csv", "", dict(draw_flights(plant, np.random.default_rng(3))[0][0]))]
    y = plant.predict({c: flights[0].columns[c] for c in plant.inputs}).y
    read = {**flights[0].columns, **dict(zip(plant.sensors, y.T, strict=True))}
    given = build_dataset(plant, [replace(flights[0], columns=read)], MismatchQuery())
    assert given.settings.offsets and not any(n.startswith("sensor.") for n in nuisance(given).sigma)


def test_instruments_of_each_engine_are_its_own(engine: Engine) -> None:
    given = evidence(engine, {}, 0.0)
    fleet = replace(given, flights=[replace(f, engine=name) for f, name in zip(given.flights, "ab", strict=True)])
    found = nuisance(fleet)
    assert {f"{n}|engine b" for n in WRONG} <= {d.name for d in found.discrepancies}
