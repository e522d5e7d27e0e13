"""What an engine file that cannot be sized or closed is told: who follows the hint has an engine that solves."""

from __future__ import annotations

import re

import numpy as np
import pytest
from engine_makers import CONFIGS
from mixed_flow import MIXED_FLOW

from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

TURBOSHAFT = (CONFIGS / "turboshaft.yaml").read_text(encoding="utf-8")


def loaded(tmp_path, text):
    path = tmp_path / "engine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path)


def told(tmp_path, text):
    """All that is said about a file that is refused."""
    with pytest.raises(ConfigError) as caught:
        loaded(tmp_path, text)
    return str(caught.value)


def solves(engine):
    """Whether the middle of the envelope solves at 90 % of the power range."""
    U = {c: np.array([np.mean(r)]) for c, r in engine.envelope.items() if c in engine.inputs}
    U[engine.power_setting] = engine.power_from_fraction(np.array([0.9]), U)
    return bool(engine.predict(U).ok.all())


def test_a_free_turbine_without_pressure_ratio_is_told_the_one_that_reaches_ambient(tmp_path):
    words = told(tmp_path, TURBOSHAFT.replace("    pressure_ratio: 3.3\n", ""))
    found = re.search(
        r"pressure_ratio must be given; ([\d.]+) expands the gas to about ambient .* gives ([\d.]+) MW", words
    )
    assert found and "nothing before it takes power from shaft 'rotor'" in words
    engine = loaded(tmp_path, TURBOSHAFT.replace("pressure_ratio: 3.3", f"pressure_ratio: {found[1]}"))
    assert solves(engine)
    assert float(np.ravel(engine.network.design_point.outputs["power_turbine_power_W"])[0]) == pytest.approx(
        1e6 * float(found[2]), rel=0.01
    )


def test_a_turbine_whose_gas_is_too_cold_is_told_how_hot_would_do(tmp_path):
    words = told(tmp_path, TURBOSHAFT.replace("exit_temperature_K: 1475", "exit_temperature_K: 760"))
    found = re.search(r"cannot give the ([\d.]+) MW .* enters at (\d+) K instead of (\d+) K", words)
    assert found, words
    hotter = 760 * 1.15 * float(found[2]) / float(found[3])  # and something for the power turbine
    text = TURBOSHAFT.replace("exit_temperature_K: 1475", f"exit_temperature_K: {hotter:.0f}")
    assert solves(loaded(tmp_path, text.replace("pressure_ratio: 3.3", "pressure_ratio: 1.05")))


def test_a_power_turbine_that_expands_too_far_is_told_by_how_much(tmp_path):
    words = told(tmp_path, TURBOSHAFT.replace("pressure_ratio: 3.3", "pressure_ratio: 4.5"))
    found = re.search(r"must be at most ([\d.]+) times what it is", words)
    assert found, words
    text = TURBOSHAFT.replace("pressure_ratio: 3.3", f"pressure_ratio: {4.5 * float(found[1]) * 0.99:.4f}")
    assert solves(loaded(tmp_path, text))


@pytest.mark.parametrize("cure", ["speed: constant", "speed: input"])
def test_a_load_on_a_shaft_of_open_speed_is_told_to_give_the_speed(tmp_path, cure):
    words = told(tmp_path, TURBOSHAFT.replace("speed: input, ", ""))
    assert "gearbox takes what shaft 'rotor' has to spare, which leaves its speed open" in words
    assert cure in words and "nozzle" not in words
    text = TURBOSHAFT if cure == "speed: input" else TURBOSHAFT.replace("  N2_rpm: {low: 20200, high: 21600}\n", "")
    assert solves(loaded(tmp_path, text.replace("speed: input", cure)))


def test_a_load_on_a_shaft_of_open_speed_may_also_follow_a_law(tmp_path):
    text = TURBOSHAFT.replace("speed: input, ", "").replace("  N2_rpm: {low: 20200, high: 21600}\n", "")
    assert "'law: cube'" in told(tmp_path, text)
    assert solves(loaded(tmp_path, text.replace("law: surplus", "law: cube")))


def test_a_given_speed_without_a_load_is_told(tmp_path):
    text = MIXED_FLOW.replace("design_speed_rpm: 9000", "speed: constant, design_speed_rpm: 9000")
    words = told(tmp_path, text)
    assert "the speed of shaft 'lp' is given" in words and "'speed: balance'" in words


def test_a_flow_that_ends_nowhere_is_told_by_its_station(tmp_path):
    words = told(tmp_path, MIXED_FLOW.replace('  - {type: nozzle, name: nozzle, from: "6"}\n', ""))
    assert "the flow at station '6' behind mixer goes nowhere" in words


def solves_at_design(engine):
    """Whether the sized engine solves at its own design point from a start beside it."""
    U = {c: np.array([engine.network.design[c]]) for c in engine.inputs if c in engine.network.design}
    U[engine.power_setting] = engine.network.design_setting
    return bool(engine.predict(U, start=np.full((len(engine.unknowns), 1), 1.01)).ok.all())


@pytest.mark.parametrize("fan", ["1.15", "6.0"], ids=["too little pressure", "too much"])
@pytest.mark.parametrize("key", ["pressure_ratio", "bypass_ratio"])
def test_flows_that_cannot_mix_are_told_which_fan_or_bypass_ratio_would_do(tmp_path, fan, key):
    text = MIXED_FLOW.replace("pressure_ratio: 2.5", f"pressure_ratio: {fan}")
    words = told(tmp_path, text)
    found = re.search(rf"{key}: ([\d.]+)", words)
    if key == "bypass_ratio" and fan == "6.0":
        assert found is None  # no bypass ratio alone would do
        return
    old = f"pressure_ratio: {fan}" if key == "pressure_ratio" else "bypass_ratio: 1.2"
    assert solves_at_design(loaded(tmp_path, text.replace(old, f"{key}: {found[1]}")))
