"""Shafts that turn together at a ratio: speeds, powers, whichever of them sets the power, and wrong files."""

from __future__ import annotations

import numpy as np
import pytest
from driven_engines import GEARED_FAN, turboprop

from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

N = 200


def loaded(tmp_path, text, power_setting=None):
    path = tmp_path / "engine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path, power_setting=power_setting)


def flight(engine, n=N, seed=3, power=(0.3, 1.0)):
    rng = np.random.default_rng(seed)
    U = {c: rng.uniform(*engine.envelope[c], n) for c in ("altitude_m", "mach", "dT_isa_K")}
    return {**U, engine.power_setting: engine.power_from_fraction(rng.uniform(*power, n), U)}


def message(tmp_path, text):
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, text)
    return "; ".join(f"{p.message} ({p.hint})" for p in caught.value.problems)


@pytest.mark.parametrize("text", [GEARED_FAN, turboprop()], ids=["geared fan", "turboprop"])
def test_every_point_of_the_envelope_solves(tmp_path, text):
    engine = loaded(tmp_path, text)
    p = engine.predict(flight(engine, 1000))
    assert p.status.max() == 0, {p.reason(k) for k in np.flatnonzero(p.status)}


def test_geared_shafts_turn_at_the_ratio_and_one_power_balance_closes(tmp_path):
    engine = loaded(tmp_path, GEARED_FAN)
    assert not {"fan.corrected_speed"} & {u.name for u in engine.unknowns}
    columns = ["N1_rpm", "N3_rpm", "fan_power_W", "booster_power_W", "lpt_power_W", "fan_gear_power_W"]
    N1, N3, fan, booster, lpt, gear = engine.predict(flight(engine), sensors=columns).y.T
    assert N3 / N1 == pytest.approx(3.0, rel=1e-14)
    assert gear == pytest.approx(fan / 0.999, rel=1e-12)
    assert lpt == pytest.approx(booster + gear / 0.993, rel=1e-9)


def test_torque_behind_a_gearbox_is_that_before_it_times_ratio_and_efficiency(tmp_path):
    engine = loaded(tmp_path, turboprop())
    columns = ["reduction_torque_N_m", "lpt_power_W", "N2_rpm"]
    torque, power, N2 = engine.predict(flight(engine), sensors=columns).y.T
    assert torque == pytest.approx(15.0 * 0.985 * power / (N2 * np.pi / 30.0), rel=1e-9)


@pytest.mark.parametrize("setting", ["N1_rpm", "N3_rpm", "N2_rpm", "Fn_N", "T45_K", "EPR"])
def test_a_speed_of_either_shaft_may_set_the_power(tmp_path, setting):
    engine = loaded(tmp_path, GEARED_FAN)
    points = flight(engine, power=(0.4, 1.0))
    answers = engine.predict(
        points, sensors=[setting, "Wf_kg_s", "N1_rpm", "T3_K"][: None if setting != "N1_rpm" else 2]
    )
    other = loaded(tmp_path, GEARED_FAN, setting)
    given = {c: points[c] for c in other.inputs if c in points}
    back = other.predict({**given, setting: answers.y[:, 0]}, sensors=["Wf_kg_s"])
    assert back.ok.all()
    assert back.y[:, 0] == pytest.approx(points["Wf_kg_s"], rel=1e-7)


def test_torque_behind_a_gearbox_may_set_the_power(tmp_path):
    engine, other = loaded(tmp_path, GEARED_FAN), loaded(tmp_path, GEARED_FAN, "fan_gear_torque_N_m")
    points = flight(engine)
    answers = engine.predict(points, sensors=["fan_gear_torque_N_m"])
    given = {c: points[c] for c in other.inputs if c in points}
    back = other.predict({**given, "fan_gear_torque_N_m": answers.y[:, 0]}, sensors=["Wf_kg_s"])
    assert back.ok.all()
    assert back.y[:, 0] == pytest.approx(points["Wf_kg_s"], rel=1e-7)


def test_a_worse_gearbox_takes_thrust_at_given_fuel_and_its_derivative_is_right(tmp_path):
    engine = loaded(tmp_path, GEARED_FAN)
    points = flight(engine, 40)
    p = engine.predict(points, sensors=["Fn_N", "N1_rpm"], wrt=["fan_gear.efficiency"])
    assert (p.jacobian[:, 0, 0] > 0.0).all()
    h = 1e-3
    up, down = (
        engine.predict(points, {"fan_gear.efficiency": 0.993 + t}, sensors=["Fn_N", "N1_rpm"], start=p.x).y
        for t in (h, -h)
    )
    assert p.jacobian[:, :, 0] == pytest.approx((up - down) / (2 * h), rel=1e-5)


def test_a_ratio_that_contradicts_the_design_speeds_is_refused_with_the_speed_that_would_do(tmp_path):
    told = message(tmp_path, turboprop().replace("ratio: 15", "ratio: 16"))
    assert "ratio of 16 does not agree" in told and "design_speed_rpm: 1875" in told


def test_a_machine_behind_its_gearbox_is_refused(tmp_path):
    fan = "  - {type: load, name: pump, shaft: fan, law: given, design_power_W: 1000}\n"
    told = message(tmp_path, GEARED_FAN.replace("  - {type: burner", fan + "  - {type: burner"))
    assert "pump: is on shaft 'fan', which gearbox fan_gear before it drives" in told


def test_a_load_behind_a_gearbox_that_takes_what_is_left_is_refused(tmp_path):
    load = "  - {type: load, name: propeller, shaft: propeller, law: surplus}\n"
    assert "cannot take the surplus power of its shaft" in message(tmp_path, turboprop(propeller=load))


def test_shafts_that_turn_together_have_one_speed_given_at_most(tmp_path):
    text = turboprop().replace("design_speed_rpm: 30000}", "design_speed_rpm: 30000, speed: input}")
    text = text.replace("design_speed_rpm: 2000,", "design_speed_rpm: 2000, speed: constant,")
    assert "turn together, and both have a speed given" in message(tmp_path, text)


def test_a_gearbox_may_not_drive_a_shaft_that_does_not_exist_or_has_a_turbine(tmp_path):
    assert "there is no shaft 'rotor'" in message(tmp_path, turboprop().replace("drives: propeller", "drives: rotor"))
    text = GEARED_FAN.replace("shaft: lp, drives: fan", "shaft: lp, drives: hp")
    assert "shaft 'fan' has no turbine" in message(tmp_path, text)
