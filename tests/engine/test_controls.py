"""Controls: an actuator holds a quantity between its stops, follows a schedule or is recorded; limits take over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from engine_makers import CONFIGS

from enginediag_cli.engine.engine import Engine
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

PLANT, TURBOFAN = (CONFIGS / f"{name}.yaml" for name in ("power_plant", "turbofan"))
VANES = "    vanes: {flow_per_deg: 0.01, loss_per_deg2: 5.0e-5, closed_stop_deg: 70}\n"
HELD = (
    "controls:\n  - {name: vanes, actuator: compressor.vane_closing_deg, hold: T5_K, set_point: 823.15, low: 0, "
    "high: 45}\n"
)


AIMED = "{name: v, actuator: compressor.vane_closing_deg, hold: T5_K"


def made(folder: Path, file: Path, *edits: tuple[str, str], more: str = "") -> Engine:
    text = file.read_text(encoding="utf-8")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new, 1)
    place = folder / "engine.yaml"
    place.write_text(text + "\n" + more, encoding="utf-8")
    return load_engine(place)


def plant(folder: Path, more: str = HELD) -> Engine:
    return made(folder, PLANT, ("    name: compressor\n", "    name: compressor\n" + VANES), more=more)


def hours(n: int, seed: int = 0) -> dict[str, np.ndarray]:
    r = np.random.default_rng(seed)
    return {
        "ambient_pressure_Pa": r.uniform(98_000, 103_500, n),
        "ambient_temperature_K": r.uniform(266, 310, n),
        "dP_inlet_Pa": r.uniform(250, 750, n),
        "T4_K": r.uniform(1250, 1390, n),
    }


def test_vanes_hold_the_exhaust_temperature_or_stand_at_a_stop(tmp_path: Path) -> None:
    engine = plant(tmp_path)
    p = engine.predict(hours(3000), sensors=("T5_K",), also=("compressor_vane_closing_deg",))
    T5, angle, limit = p.y[:, 0], p.also[:, 0], p.active_limit
    assert p.ok.all()
    assert set(limit) == {"", "vanes.low", "vanes.high"}
    assert np.abs(T5[limit == ""] - 823.15).max() < 1e-5
    # open vanes cannot cool the exhaust further, closed ones cannot heat it further
    assert (T5[limit == "vanes.low"] > 823.15).all() and (T5[limit == "vanes.high"] < 823.15).all()
    assert np.abs(angle[limit == "vanes.low"]).max() < 1e-4
    assert np.abs(angle[limit == "vanes.high"] - 45.0).max() < 1e-4


def test_at_its_stop_a_controlled_engine_is_the_uncontrolled_one(tmp_path: Path) -> None:
    engine, inputs = plant(tmp_path), hours(500)
    inputs["T4_K"] += 80.0
    p = engine.predict(inputs)
    open_vanes = p.active_limit == "vanes.low"
    free = load_engine(PLANT).predict({c: v[open_vanes] for c, v in inputs.items()})
    assert open_vanes.any()
    assert np.allclose(p.y[open_vanes], free.y, rtol=1e-8)


def test_sensitivities_of_a_controlled_engine_are_those_of_differences(tmp_path: Path) -> None:
    engine, inputs = plant(tmp_path), hours(60)
    names = ("vanes.set_point", "compressor.efficiency", "turbine.flow_capacity", "vanes.high")
    read = ("P3_Pa", "T5_K", "power_W")
    p = engine.predict(inputs, sensors=read, wrt=names)
    for j, name in enumerate(names):
        at, h = engine.parameters[name].nominal, 1e-5 * engine.parameters[name].nominal
        y = {k: engine.predict(inputs, {name: at + k * h}, sensors=read) for k in (-2, -1, 1, 2)}
        same = np.all([q.active_limit == p.active_limit for q in y.values()], axis=0)  # no kink between
        D = (8.0 * (y[1].y - y[-1].y) - (y[2].y - y[-2].y)) / (12.0 * h)
        size = np.abs(p.jacobian[:, :, j]).max(axis=0)
        assert same.sum() > 50
        assert (np.abs(D - p.jacobian[:, :, j])[same] <= 1e-6 * size + 1e-12).all(), name


def test_the_held_quantity_does_not_move_with_the_compressor(tmp_path: Path) -> None:
    engine = plant(tmp_path)
    no_loss = {"compressor.vanes.loss_per_deg2": 0.0}
    p = engine.predict(hours(200), no_loss, sensors=("T5_K", "P3_Pa"), wrt=("compressor.flow_capacity",))
    held = p.active_limit == ""
    # vanes take up what the compressor swallows more: nothing of it reaches the engine
    assert np.abs(p.jacobian[held, 0, 0]).max() < 1e-3
    assert np.abs(p.jacobian[held, 1, 0] / p.y[held, 1]).max() < 1e-3


def test_a_released_control_rests_where_nothing_sets_it(tmp_path: Path) -> None:
    released = HELD.replace("high: 45}", "high: 45, acts_while: {column: T4_K, side: at_most, value: 1300}}")
    p = plant(tmp_path, released).predict(hours(400), also=("compressor_vane_closing_deg",))
    hot = hours(400)["T4_K"] > 1300
    assert np.abs(p.also[hot, 0]).max() < 1e-4
    assert np.abs(p.y[~hot & (p.active_limit == "")][:, 1] - 823.15).max() < 1e-5


def test_a_recorded_position_gives_what_the_control_found(tmp_path: Path) -> None:
    inputs = hours(300)
    one = plant(tmp_path).predict(inputs, also=("compressor_vane_closing_deg",))
    recorded = "controls:\n  - {name: vanes, actuator: compressor.vane_closing_deg, recorded: igv_deg}\n"
    engine = plant(tmp_path, recorded)
    assert "igv_deg" in engine.inputs
    other = engine.predict({**inputs, "igv_deg": one.also[:, 0]})
    assert np.allclose(one.y, other.y, rtol=1e-8)


def test_a_schedule_of_an_input_is_read_along_straight_lines(tmp_path: Path) -> None:
    table = "{against: T4_K, points: [1250, 1300, 1390], values: [40, 10, 0]}"
    more = f"controls:\n  - {{name: vanes, actuator: compressor.vane_closing_deg, schedule: {table}}}\n"
    inputs = hours(100)
    p = plant(tmp_path, more).predict(inputs, also=("compressor_vane_closing_deg",))
    assert np.allclose(p.also[:, 0], np.interp(inputs["T4_K"], [1250, 1300, 1390], [40, 10, 0]), atol=1e-9)


def test_a_schedule_of_a_model_column_is_met_at_the_solution(tmp_path: Path) -> None:
    law = "{against: compressor_corrected_rpm, polynomial: [120, -0.04]}"
    more = f"controls:\n  - {{name: vanes, actuator: compressor.vane_closing_deg, schedule: {law}}}\n"
    p = plant(tmp_path, more).predict(
        hours(100), sensors=("compressor_corrected_rpm",), also=("compressor_vane_closing_deg",)
    )
    assert p.ok.all()
    assert np.allclose(p.also[:, 0], np.clip(120.0 - 0.04 * p.y[:, 0], 0.0, 70.0), atol=1e-7)


def governed(folder: Path, limits: str) -> Engine:
    return made(folder, TURBOFAN, more=f"controls:\n  - {{name: fadec, actuator: fuel, limits: [{limits}]}}\n")


def test_a_limit_of_the_fuel_control_takes_over_where_it_is_met(tmp_path: Path) -> None:
    free = load_engine(TURBOFAN)
    n = 200
    flight = {"altitude_m": np.zeros(n), "mach": np.zeros(n), "dT_isa_K": np.linspace(-30, 30, n)}
    flight[free.power_setting] = free.power_from_fraction(1.0, flight)
    hot = free.predict(flight, sensors=("T4_K",)).y[:, 0]
    top = float(np.median(hot))
    engine = governed(tmp_path, f"{{name: max_T4, column: T4_K, side: at_most, value: {top}}}")
    p = engine.predict(flight, sensors=("T4_K", "Wf_kg_s"))
    assert p.ok.all()
    assert np.allclose(p.y[:, 0], np.minimum(hot, top), rtol=1e-7)
    assert ((p.active_limit == "fadec.max_T4") == (hot > top - 1e-3)).mean() > 0.99


def test_the_later_of_two_limits_wins(tmp_path: Path) -> None:
    flight = {"altitude_m": np.zeros(1), "mach": np.zeros(1), "dT_isa_K": np.zeros(1)}
    free = load_engine(TURBOFAN)
    flight[free.power_setting] = free.power_from_fraction(0.8, flight)
    y = free.predict(flight, sensors=("T4_K", "P3_Pa")).y[0]
    cap = f"{{name: max_T4, column: T4_K, side: at_most, value: {0.97 * y[0]}}}"
    floor = f"{{name: min_P3, column: P3_Pa, side: at_least, value: {y[1]}}}"
    first = governed(tmp_path, f"{cap}, {floor}").predict(flight, sensors=("T4_K", "P3_Pa"))
    second = governed(tmp_path, f"{floor}, {cap}").predict(flight, sensors=("T4_K", "P3_Pa"))
    assert first.y[0, 1] == pytest.approx(y[1], rel=1e-7)
    assert second.y[0, 0] == pytest.approx(0.97 * y[0], rel=1e-7)
    assert (first.active_limit[0], second.active_limit[0]) == ("fadec.min_P3", "fadec.max_T4")


def test_without_limits_met_the_fuel_control_changes_nothing(tmp_path: Path) -> None:
    free = load_engine(TURBOFAN)
    flight = {"altitude_m": np.zeros(5), "mach": np.zeros(5), "dT_isa_K": np.linspace(-10, 10, 5)}
    flight[free.power_setting] = free.power_from_fraction(np.linspace(0.5, 0.9, 5), flight)
    engine = governed(tmp_path, "{name: max_T4, column: T4_K, side: at_most, value: 2400}")
    assert np.allclose(engine.predict(flight).y, free.predict(flight).y, rtol=1e-8)


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ("{name: v, actuator: compressor.vane_closing, hold: T5_K}", "compressor.vane_closing_deg"),
        ("{name: v, actuator: compressor.vane_closing_deg}", "exactly one of hold, schedule and recorded"),
        ("{name: v, actuator: compressor.vane_closing_deg, hold: T55_K}", "the model has no column 'T55_K'"),
        ("{name: v, actuator: compressor.vane_closing_deg, hold: P0_Pa}", "does not move P0_Pa"),
        ("{name: v, actuator: compressor.vane_closing_deg, hold: T5_K, low: 50, high: 10}", "must rise"),
        ("{name: v, actuator: fuel, hold: T4_K, low: 0}", "no schedule, record or stops"),
        (f"{AIMED}, acts_while: {{column: T44_K, side: at_most, value: 900}}}}", "the model has no column 'T44_K'"),
        (
            f"{AIMED}, acts_while: {{column: P3_Pa, side: at_most, value: 1e6, rest_sigma: 1}}}}",
            "rest_sigma needs an input",
        ),
    ],
)
def test_a_control_that_cannot_be_says_where_and_why(tmp_path: Path, more: str, told: str) -> None:
    with pytest.raises(ConfigError) as error:
        plant(tmp_path, f"controls:\n  - {more}\n")
    assert told in str(error.value)
    assert "engine.yaml:" in str(error.value)
