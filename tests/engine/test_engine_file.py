"""Faults of wiring in an engine file: each is reported at file:line:column with a near match, together."""

from __future__ import annotations

import re

import numpy as np
import pytest
import yaml
from engine_makers import TURBOFAN
from mixed_flow import MIXED_FLOW

from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine


def problems(tmp_path, old, new, text=MIXED_FLOW):
    """The problems of an engine file in which one text is replaced, and the line where the new one stands."""
    assert text.count(old) >= 1
    path = tmp_path / "engine.yaml"
    changed = text.replace(old, new, 1)
    path.write_text(changed, encoding="utf-8")
    line = changed[: text.index(old)].count("\n") + 1
    with pytest.raises(ConfigError) as caught:
        load_engine(path)
    for problem in caught.value.problems:
        assert re.match(r".*engine\.yaml:\d+:\d+: error: ", str(problem)), str(problem)
    return caught.value.problems, line


@pytest.mark.parametrize(
    ("old", "new", "message", "near"),
    [
        ("shaft: lp, pressure_ratio: 2.5", "shaft: lb, pressure_ratio: 2.5", "no shaft 'lb'", "lp"),
        ('from: "45", to: "5"', 'from: "46", to: "5"', "station '46'", "4"),
        ("cooling_before_rotor: [vanes]", "cooling_before_rotor: [vane]", "no bleed 'vane'", "vanes"),
        ("receives: [valve]", "receives: [valves]", "no bleed 'valves'", "valve"),
        ('core: "5", bypass: "15"', 'core: "5", bypass: "51"', "station '51'", "5"),
        (
            "power_range:",
            "monitored: [fan.eficiency]\npower_range:",
            "no parameter 'fan.eficiency'",
            "fan.efficiency",
        ),
        ("T5_K: {noise_sigma: 2}", "T55_K: {noise_sigma: 2}", "no column 'T55_K'", "T5_K"),
        ("power_setting: Wf_kg_s", "power_setting: Wf_kgs", "'Wf_kgs'", "Wf_kg_s"),
        ("  mach: {low: 0, high: 0.9}", "  mac: {low: 0, high: 0.9}", "'mac' is not an input", "mach"),
        ("type: mixer", "type: mixr", "mixr", "mixer"),
        ("core_mach: 0.4", "core_mac: 0.4", "core_mac", "core_mach"),
    ],
)
def test_a_name_that_does_not_exist_is_reported_at_its_place_with_a_near_match(tmp_path, old, new, message, near):
    found, line = problems(tmp_path, old, new)
    hit = [p for p in found if message in p.message]
    assert len(hit) == 1, [str(p) for p in found]
    assert near in hit[0].hint
    first_new = line + new.count("\n") if new.startswith("power_range") else line
    assert hit[0].mark.line == first_new
    assert hit[0].mark.column > 1 or new.startswith(("monitored", "power_setting"))


def test_a_sensor_that_reads_an_unknown_column_is_reported(tmp_path):
    found, line = problems(
        tmp_path, "T5_K: {noise_sigma: 2}", "ITT_K: {noise_sigma: 2, reads: {T45_K: 0.5, T51_K: 0.5}}"
    )
    assert any("T51_K" in p.message and p.mark.line == line for p in found)


def test_several_faults_are_reported_together(tmp_path):
    text = MIXED_FLOW.replace("shaft: hp, isentropic_efficiency: 0.87", "shaft: hpp, isentropic_efficiency: 0.87")
    found, _ = problems(tmp_path, 'from: "45", to: "5"', 'from: "46", to: "5"', text)
    messages = "\n".join(p.message for p in found)
    assert "shaft 'hpp'" in messages
    assert "station '46'" in messages


def test_two_burners_are_one_too_many(tmp_path):
    second = '  - {type: burner, name: reheat, from: "5", to: "52", exit_temperature_K: 1500}\n'
    found, _ = problems(tmp_path, "  - {type: mixer", second + "  - {type: mixer")
    assert any("exactly one burner, this one has 2" in p.message for p in found)


def test_a_load_that_leaves_its_shaft_without_balance_is_told_as_unknowns_without_balance(tmp_path):
    nozzle = '  - {type: nozzle, name: nozzle, from: "6"}\n'
    found, _ = problems(tmp_path, nozzle, nozzle + "  - {type: load, name: generator, shaft: lp}\n")
    told = r"6 unknowns \(.*lp\.corrected_speed.*\) but 5 balances \(.*hpt flow.*\)"
    assert any(re.search(told, p.message) for p in found)


def test_a_flow_that_goes_nowhere_is_reported(tmp_path):
    found, _ = problems(tmp_path, '  - {type: nozzle, name: nozzle, from: "6"}\n', "")
    assert found


def test_a_bleed_can_be_received_only_once(tmp_path):
    found, _ = problems(
        tmp_path, "cooling_before_rotor: [vanes]", "cooling_before_rotor: [vanes], cooling_after_rotor: [vanes]"
    )
    assert any("vanes" in p.message for p in found)


def test_a_bleed_name_can_be_given_only_once(tmp_path):
    found, _ = problems(tmp_path, "{name: cabin, fraction: 0.01}", "{name: vanes, fraction: 0.01}")
    assert any("vanes" in p.message for p in found)


def test_a_station_can_be_the_inlet_of_only_one_component(tmp_path):
    found, _ = problems(tmp_path, '{type: mixer, name: mixer, core: "5"', '{type: mixer, name: mixer, core: "45"')
    assert any("45" in p.message for p in found)


def test_a_shaft_without_turbine_is_reported(tmp_path):
    found, _ = problems(tmp_path, "shafts:\n", "shafts:\n  - {name: ip, speed_label: N3, design_speed_rpm: 9000}\n")
    assert any("ip" in p.message for p in found)


def test_a_load_before_its_turbine_is_reported(tmp_path):
    found, _ = problems(
        tmp_path,
        "  - {type: compressor, name: fan",
        "  - {type: load, name: generator, shaft: lp}\n  - {type: compressor, name: fan",
    )
    assert any("generator" in p.message for p in found)


def test_a_start_value_of_an_unknown_name_is_reported(tmp_path):
    found, _ = problems(tmp_path, "power_range:", "start: {hpt.presure_ratio: 0.9}\npower_range:")
    assert any("hpt.presure_ratio" in p.message and "hpt.pressure_ratio" in p.hint for p in found)


@pytest.mark.parametrize(
    "table",
    [
        "recovery_mach: [0, 0.5], recovery_table: [1.0]",
        "recovery_mach: [0.5, 0], recovery_table: [1.0, 0.99]",
        "recovery_mach: [0], recovery_table: [1.0]",
    ],
    ids=["unequal", "falling", "one"],
)
def test_a_recovery_table_must_be_a_rising_table(tmp_path, table):
    found, _ = problems(tmp_path, "corrected_flow_kg_s: 80", f"corrected_flow_kg_s: 80, {table}")
    assert any("recovery" in p.message for p in found)


def test_a_design_point_that_cannot_be_met_names_the_component(tmp_path):
    found, _ = problems(tmp_path, "exit_temperature_K: 1450", "exit_temperature_K: 700")
    assert any("design point" in p.message for p in found)


def test_a_component_map_that_is_not_there_is_reported(tmp_path):
    path = tmp_path / "engine.yaml"
    path.write_text(
        MIXED_FLOW.replace("pressure_ratio: 2.5,", "pressure_ratio: 2.5, table: {file: none.csv},"), encoding="utf-8"
    )
    with pytest.raises(ConfigError, match=r"none\.csv"):
        load_engine(path)


# what a good file gives


def test_the_turbofan_declares_what_its_file_monitors_and_measures():
    engine = load_engine(TURBOFAN)
    file = yaml.safe_load(TURBOFAN.read_text(encoding="utf-8"))
    assert list(engine.sensors) == list(file["sensors"])
    assert list(engine.monitored) == file["monitored"]
    assert len(engine.sensors) == 9
    assert len(engine.monitored) == 11
    assert engine.inputs == ("altitude_m", "mach", "dT_isa_K", "Wf_kg_s")
    assert engine.optional_inputs == {"humidity_kg_kg": 0.0}
    assert all(engine.parameters[name].family == "health" for name in engine.monitored)
    assert all(p.lower <= p.nominal <= p.upper for p in engine.parameters.values())
    assert all(p.prior_sigma > 0.0 for p in engine.parameters.values())


@pytest.mark.parametrize("power_setting", ["N1_rpm", "N2_rpm", "T4_K", "Fn_N"])
def test_another_power_setting_is_an_input_and_no_longer_a_sensor(power_setting):
    engine = load_engine(TURBOFAN, power_setting)
    assert engine.power_setting == power_setting
    assert power_setting in engine.inputs
    assert "Wf_kg_s" not in engine.inputs
    assert power_setting not in engine.sensors


def test_a_power_setting_that_nothing_can_set_is_a_config_error():
    with pytest.raises(ConfigError, match="P3_Pa"):
        load_engine(TURBOFAN, "P3_Pa")


def test_sensors_mix_columns_divide_and_carry_heat_soak(tmp_path):
    path = tmp_path / "engine.yaml"
    sensors = (
        "  ITT_K: {noise_sigma: 2, reads: {T45_K: 0.6, T5_K: 0.4}, soak: N1_soak_rpm}\n"
        "  EPR: {noise_sigma: 0.01, reads: {P5_Pa: 1}, over: P2_Pa}\n"
    )
    path.write_text(MIXED_FLOW.replace("  T5_K: {noise_sigma: 2}\n", sensors), encoding="utf-8")
    engine = load_engine(path)
    U = {"altitude_m": 3000.0, "mach": 0.4, "dT_isa_K": 0.0, "Wf_kg_s": 0.45, "N1_soak_rpm": 250.0}
    theta = {"sensor.ITT.soak": 0.02, "sensor.ITT.bias": 3.0, "sensor.ITT.scale": 1.01, "sensor.EPR.bias": 0.05}
    T45, T5, P5, P2 = engine.predict(U, sensors=("T45_K", "T5_K", "P5_Pa", "P2_Pa")).y[0]
    p = engine.predict(U, theta, sensors=("ITT_K", "EPR"), wrt=tuple(theta))
    mixed = 0.6 * T45 + 0.4 * T5
    assert p.y[0] == pytest.approx([1.01 * mixed + 3.0 + 0.02 * 250.0, P5 / P2 + 0.05], rel=1e-9)
    assert np.allclose(p.jacobian[0], [[250.0, 1.0, mixed, 0.0], [0.0, 0.0, 0.0, 1.0]], rtol=1e-9, atol=1e-9)
    without = engine.predict({c: v for c, v in U.items() if c != "N1_soak_rpm"}, theta, sensors=("ITT_K",))
    assert without.y[0, 0] == pytest.approx(1.01 * mixed + 3.0, rel=1e-9)
