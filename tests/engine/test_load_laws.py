"""Loads that take power by a law of their own, several of them on one shaft, and those that cannot be sized."""

from __future__ import annotations

import numpy as np
import pytest
from driven_engines import CORE, turboprop
from engine_makers import CONFIGS, fourth_order
from test_gearbox import loaded, message

from enginediag_cli.engine.load import power_settings

TURBOSHAFT = (CONFIGS / "turboshaft.yaml").read_text(encoding="utf-8")
GEARBOX = "  - {type: load, name: gearbox, shaft: rotor, law: surplus, efficiency: 0.98}\n"
POINT = {"altitude_m": 500.0, "mach": 0.1, "dT_isa_K": 5.0}
FUEL = np.linspace(0.055, 0.09, 8)


def driving(*loads, speed="balance"):
    """The shipped turboshaft with other loads on its rotor."""
    text = TURBOSHAFT.replace(GEARBOX, "".join(f"  - {{type: load, shaft: rotor, {load}}}\n" for load in loads))
    text = text.replace("speed: input", f"speed: {speed}").replace("power_W: {noise_sigma: 4000, maximum: 1.4e6}", "")
    return text.replace(
        "  N2_rpm: {low: 20200, high: 21600}\n", "" if speed == "balance" else "  N2_rpm: {low: 20200, high: 21600}\n"
    )


def answers(engine, columns, **inputs):
    p = engine.predict({**POINT, **inputs}, sensors=columns)
    assert p.ok.all(), [p.reason(k) for k in np.flatnonzero(~p.ok)]
    return p.y.T


@pytest.mark.parametrize(
    ("law", "exponent"), [("law: cube", 2.0), ("law: torque", 0.0), ("law: torque, torque_exponent: 1.0", 1.0)]
)
def test_a_law_gives_the_torque_its_power_of_the_speed(tmp_path, law, exponent):
    engine = loaded(tmp_path, driving(f"name: brake, {law}"), "Wf_kg_s")
    torque, N, power = answers(engine, ["brake_torque_N_m", "N2_rpm", "brake_power_W"], Wf_kg_s=FUEL)
    assert torque / torque[-1] == pytest.approx((N / N[-1]) ** exponent, rel=1e-9)
    assert power == pytest.approx(torque * N * np.pi / 30.0, rel=1e-12)


def test_a_table_of_torque_is_read_between_and_beyond_its_speeds(tmp_path):
    table = "law: torque, speeds_rpm: [17000, 20900, 22000], torques_N_m: [450, 520, 530]"
    engine = loaded(tmp_path, driving(f"name: brake, {table}", "name: rest, law: cube"), "Wf_kg_s")
    torque, N = answers(engine, ["brake_torque_N_m", "N2_rpm"], Wf_kg_s=FUEL)
    inside = np.interp(N, [17000, 20900, 22000], [450, 520, 530])
    beyond = np.where(N < 17000, 450 + (N - 17000) * 70 / 3900, 530 + (N - 22000) * 10 / 1100)
    assert torque == pytest.approx(np.where((N < 17000) | (N > 22000), beyond, inside), rel=1e-12)


def test_several_loads_on_one_shaft_share_its_power(tmp_path):
    """An alternator of 90 kW at its terminals, a pump by the cube, and a rotor that takes what is left at its speed."""
    loads = (
        "name: alternator, law: given, design_power_W: 90000, efficiency: 0.9",
        "name: pump, law: cube, design_power_W: 50000",
        "name: rotor_gear, law: surplus, efficiency: 0.98",
    )
    engine = loaded(tmp_path, driving(*loads, speed="input"), "Wf_kg_s")
    columns = ["alternator_power_W", "pump_power_W", "rotor_gear_power_W", "power_turbine_power_W", "power_W"]
    N = np.linspace(20200.0, 21600.0, 8)
    alternator, pump, gear, turbine, total = answers(engine, columns, Wf_kg_s=FUEL, N2_rpm=N)
    assert alternator == pytest.approx(90000.0)
    assert pump == pytest.approx(50000.0 * (N / 20900.0) ** 3, rel=1e-12)
    assert 0.99 * turbine == pytest.approx(alternator / 0.9 + pump + gear / 0.98, rel=1e-9)
    assert total == pytest.approx(alternator + pump + gear, rel=1e-12)
    assert {"rotor_gear_power_W", "pump_torque_N_m", "power_W"} <= set(power_settings(engine.declared))
    assert "alternator_power_W" not in power_settings(engine.declared)


def test_a_demanded_power_is_an_input_and_fuel_follows(tmp_path):
    """The governed helicopter: rotor speed held, power demanded; the fuel is what the model answers with."""
    engine = loaded(tmp_path, driving("name: rotor_gear, law: given, demand: input, efficiency: 0.98"), "N2_rpm")
    assert "rotor_gear_power_demand_W" in engine.inputs
    demand = np.linspace(0.5e6, 1.1e6, 8)
    power, fuel, N1 = answers(
        engine, ["rotor_gear_power_W", "Wf_kg_s", "N1_rpm"], N2_rpm=20900.0, rotor_gear_power_demand_W=demand
    )
    assert power == pytest.approx(demand, rel=1e-12)
    assert (np.diff(fuel) > 0.0).all() and (np.diff(N1) > 0.0).all()
    given = loaded(tmp_path, TURBOSHAFT, "power_W")
    assert answers(given, ["Wf_kg_s"], N2_rpm=20900.0, power_W=demand)[0] == pytest.approx(fuel, rel=1e-8)


def test_a_demand_that_states_its_design_power_sets_the_turbine_behind_it(tmp_path):
    core = CORE.replace("law: given, design_power_W: 6000", "law: given, demand: input, design_power_W: 6000")
    engine = loaded(tmp_path, turboprop(core=core))
    points = {"altitude_m": 1000.0, "mach": 0.1, "dT_isa_K": 0.0, "Wf_kg_s": np.array([0.04, 0.06])}
    one = loaded(tmp_path, turboprop()).predict(points, sensors=["N1_rpm"]).y
    column = "starter_generator_power_demand_W"
    assert engine.predict({**points, column: 6000.0}, sensors=["N1_rpm"]).y == pytest.approx(one, rel=1e-9)
    assert (engine.predict({**points, column: 0.0}, sensors=["N1_rpm"]).y > one).all()


def test_derivatives_with_respect_to_demand_and_efficiency_match_differences(tmp_path):
    engine = loaded(tmp_path, driving("name: gear, law: given, demand: input, efficiency: 0.98"), "N2_rpm")
    points = {**POINT, "N2_rpm": 20900.0, "gear_power_demand_W": np.linspace(0.5e6, 1.1e6, 6)}
    columns, wrt = ["Wf_kg_s", "N1_rpm", "T45_K"], ("gear_power_demand_W", "gear.efficiency")
    p = engine.predict(points, sensors=columns, wrt=wrt)
    for k, (name, h) in enumerate(zip(wrt, (500.0, 1e-3), strict=True)):

        def moved(t, name=name):
            if name in points:
                return engine.predict({**points, name: points[name] + t}, sensors=columns, start=p.x).y
            return engine.predict(points, {name: 0.98 + t}, sensors=columns, start=p.x).y

        numeric = fourth_order(moved, h)
        assert (np.abs(p.jacobian[:, :, k] - numeric).max(axis=0) < 2e-6 * np.abs(numeric).max(axis=0)).all(), name


def test_a_stated_load_before_its_turbine_sets_the_pressure_ratio(tmp_path):
    less, more = (
        loaded(tmp_path, turboprop(core=CORE.replace("6000", power))).network.design_point.outputs
        for power in ("6000", "60000")
    )
    difference = (60000.0 - 6000.0) / 0.85 / 0.99
    assert more["hpt_power_W"][0] - less["hpt_power_W"][0] == pytest.approx(difference, rel=1e-6)


def test_loads_that_do_not_add_up_are_refused_with_what_is_missing(tmp_path):
    told = message(tmp_path, driving("name: brake, law: cube, design_power_W: 1.0e6"))
    assert "the turbines of shaft 'rotor' give" in told and "W more than is taken from it" in told


@pytest.mark.parametrize(
    ("loads", "words"),
    [
        (("name: a, law: cube", "name: b, law: cube"), "drives a already, which takes what it has"),
        (("name: a, law: surplus", "name: b, law: given, design_power_W: 1000"), "b: stands behind a, which takes all"),
        (("name: a, law: surplus, design_power_W: 5", ""), "has no design_power_W"),
        (("name: a, law: torque, speeds_rpm: [100], torques_N_m: [1]", ""), "speeds_rpm must rise"),
    ],
)
def test_loads_that_contradict_each_other_are_refused(tmp_path, loads, words):
    assert words in message(tmp_path, driving(*(x for x in loads if x)))


def test_a_load_that_takes_the_rest_comes_behind_its_turbine(tmp_path):
    text = TURBOSHAFT.replace(GEARBOX, "").replace(
        "  - type: turbine                       # drives", GEARBOX + "  - type: turbine  # drives"
    )
    assert "a load comes behind the turbine that drives its shaft" in message(tmp_path, text)
