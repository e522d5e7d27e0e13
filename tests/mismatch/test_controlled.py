"""A control that the model lacks is found by a reading that stands still, and written as the file will say it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.config.document import parse_document
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.identification.problem import TrainingRecording
from enginediag_cli.mismatch.controlled.actuators import free_actuators
from enginediag_cli.mismatch.controlled.find import ControlSearchResult, find_law
from enginediag_cli.mismatch.controlled.still import still_readings
from enginediag_cli.mismatch.refine.controlled import refine_control
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.report.plotting.discrepancy import control_picture as picture

CONFIGS = Path(__file__).parents[2] / "configs"
PLANT = CONFIGS / "power_plant.yaml"
VANES = "    vanes: {flow_per_deg: 0.012, loss_per_deg2: 1.0e-4, closed_stop_deg: 80}\n"
SET_POINT_K, FULL_K = 811.0, 1373.2


@cache
def plant() -> tuple[EngineDescription, Engine]:
    engine = load_engine(PLANT)
    return EngineDescription.from_engine_file(PLANT, engine.declared), engine


def truth(control: str) -> Engine:
    text = PLANT.read_text(encoding="utf-8").replace("    name: compressor\n", "    name: compressor\n" + VANES, 1)
    return load_engine(EngineDescription("truth.yaml", text + control, {}))


def held(high: float, more: str = "") -> str:
    return (
        f"\ncontrols:\n  - {{name: v, actuator: compressor.vane_closing_deg, hold: T5_K, set_point: {SET_POINT_K}, "
        f"low: 0, high: {high}{more}}}\n"
    )


def hours(engine: Engine, n: int, seed: int) -> TrainingRecording:
    """Of another machine of the class: its maps and health are not the file's."""
    r = np.random.default_rng(seed)
    columns = {
        "ambient_pressure_Pa": r.normal(101_300, 700, n),
        "ambient_temperature_K": r.uniform(272, 305, n),
        "dP_inlet_Pa": r.uniform(300, 600, n),
        "T4_K": np.where(r.random(n) < 0.35, FULL_K + r.normal(0, 0.2, n), r.uniform(1200, 1366, n)),
    }
    machine = {
        "compressor.efficiency": 1.012,
        "compressor.flow_capacity": 0.985,
        "turbine.efficiency": 0.99,
        "compressor.map.work_slope": 6.2,
        "compressor.map.flow_speed_exponent": 1.25,
    }
    p = engine.predict(columns, machine)
    for j, (column, sensor) in enumerate(engine.sensors.items()):
        columns[column] = p.y[:, j] + r.normal(0, sensor.noise_sigma, n)
    return TrainingRecording(f"hours {seed}", {c: v[p.ok] for c, v in columns.items()})


@cache
def found() -> ControlSearchResult:
    released = ", acts_while: {column: T4_K, side: at_most, value: 1370}"
    law = find_law(*plant(), [hours(truth(held(30, released)), 700, 1)])
    assert law is not None
    return law


@pytest.mark.slow
def test_vanes_that_hold_the_exhaust_temperature_are_named_with_set_point_stop_and_release() -> None:
    law = found().best.law
    assert (law.actuator.name, law.hold) == ("compressor.vane_closing_deg", "T5_K")
    assert law.set_point == pytest.approx(SET_POINT_K, abs=0.3)
    assert law.low == 0.0 < law.high
    assert law.enabled is not None and law.enabled.column == "T4_K" and 1350.0 < law.enabled.value < FULL_K


def test_it_says_in_which_share_of_the_records_it_acts() -> None:
    f = found()
    assert f.released == pytest.approx(0.35, abs=0.06)
    assert f.at_limit["high"] == pytest.approx(0.28, abs=0.03)  # as the vanes of the truth are at their stop
    assert f.held + f.released + sum(f.at_limit.values()) == pytest.approx(1.0)


@pytest.mark.slow
def test_a_control_that_is_always_on_has_no_release() -> None:
    law = find_law(*plant(), [hours(truth(held(30)), 700, 2)])
    assert law is not None and law.best.law.enabled is None
    assert law.best.law.hold == "T5_K"


def test_without_a_control_nothing_is_named() -> None:
    assert find_law(*plant(), [hours(truth(""), 700, 3)]) is None


@pytest.mark.slow
def test_unseen_hours_judge_the_control() -> None:
    description, engine = plant()
    released = ", acts_while: {column: T4_K, side: at_most, value: 1370}"
    machine = truth(held(30, released))
    r = refine_control(found(), description, engine, [hours(machine, 700, 1)], [hours(machine, 400, 4)])
    assert r.accepted
    after = {(q.sensor, q.regime): q.rms for q in r.after}
    assert after["T5_K", "held"] < 1.3  # the sensor's noise is 1 K
    assert after["P3_Pa", "held"] < 1.0 and after["power_W", "held"] < 1.0  # per cent
    drawn = picture(r)
    assert "P3_Pa" in drawn and "compressor guide vanes" in drawn.replace("&#160;", " ").lower()
    other = refine_control(found(), description, engine, [hours(machine, 700, 1)], [hours(truth(""), 400, 5)])
    assert not other.accepted  # a machine without it


def test_the_file_says_what_was_fitted() -> None:
    description, engine = plant()
    law = found().best.law
    text = law.written(description.text, description.file, "where it comes from", {"high": 1.0})
    root = parse_document(text, "plant.yaml")
    [entry] = root.value["controls"].value
    assert entry.value["source"].value == "where it comes from"
    assert "compressor_control.high" in [n.value for n in root.value["identification"].value["parameters"].value]
    again = load_engine(EngineDescription("plant.yaml", text, {}))
    assert again.parameters["compressor_control.set_point"].nominal == pytest.approx(law.set_point)
    assert set(engine.parameters) < set(again.parameters)


def test_text_is_put_into_both_styles_of_yaml() -> None:
    turbojet = load_engine(CONFIGS / "turbojet.yaml")
    described = EngineDescription.from_engine_file(turbojet.path, turbojet.declared)
    [nozzle] = [f for f in free_actuators(turbojet) if f.component == "nozzle"]
    from enginediag_cli.mismatch.controlled.law import ControlLaw

    law = ControlLaw(nozzle.actuator, "nozzle", "T5_K", 800.0, 0.8, 1.3, key=nozzle.key)
    engine = law.engine(described, turbojet.power_setting)
    inputs = {"altitude_m": np.zeros(1), "mach": np.zeros(1), "dT_isa_K": np.zeros(1)}
    inputs[engine.power_setting] = engine.power_from_fraction(0.8, inputs)
    p = engine.predict(inputs, sensors=("T5_K",))
    assert p.y[0, 0] == pytest.approx(800.0) or p.active_limit[0]


def test_a_reading_that_the_model_says_stands_still_is_no_mark_of_a_control() -> None:
    r = np.random.default_rng(0)
    y = np.concatenate([np.full(300, 800.0), r.uniform(700, 900, 300)]) + r.normal(0, 1, 600)
    moving, standing = r.uniform(700, 900, 600), np.concatenate([np.full(300, 800.0), r.uniform(700, 900, 300)])
    [one] = still_readings(["T5_K"], {"T5_K": 1.0}, y[:, None], moving[:, None])
    assert one.value == pytest.approx(800.0, abs=0.2)
    assert still_readings(["T5_K"], {"T5_K": 1.0}, y[:, None], standing[:, None]) == []


def test_a_reading_that_moves_smoothly_is_not_still() -> None:
    r = np.random.default_rng(1)
    y = r.normal(800.0, 20.0, 2000)
    assert still_readings(["T5_K"], {"T5_K": 1.0}, y[:, None], r.permutation(y)[:, None]) == []
