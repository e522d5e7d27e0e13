"""Sensor faults next to component faults, on the real turbofan: 1 of 11 + 9."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from parameter_makers import described
from turbofan_trials import faulty_window, turbofan_monitor, window_score

from enginediag_cli.isolation.diagnosis import DiagnosisOptions, diagnose, find_sensor_ambiguity
from enginediag_cli.isolation.results import Explanation, SetIsolation
from enginediag_cli.report.sentences import sensor_or_component


def diagnosis_of(seed, change, n=100):
    monitor = turbofan_monitor(sensors=True)
    window = faulty_window(np.random.default_rng(seed), monitor, change, n)
    return diagnose(window_score(monitor, *window), DiagnosisOptions())


def test_a_2_percent_hpc_efficiency_loss_is_isolated_to_the_hpc_not_to_the_T3_sensor():
    result = diagnosis_of(1, {"hpc.efficiency": -0.02}).result
    assert result.isolated == ("hpc.efficiency",) and result.probability > 0.5
    assert abs(result.sizes[0].change + 0.02) < 4 * result.sizes[0].standard_error
    assert result.inclusion["sensor.T3.bias"] < 0.1


def test_a_T3_bias_of_5_K_is_isolated_to_the_T3_sensor():
    result = diagnosis_of(2, {"sensor.T3.bias": 5.0}).result
    assert result.isolated == ("sensor.T3.bias",) and result.probability > 0.5
    assert abs(result.sizes[0].change - 5) < 4 * result.sizes[0].standard_error
    assert result.inclusion["hpc.efficiency"] < 0.1


@pytest.mark.parametrize("seed", [3, 4])
def test_a_fault_of_engine_and_sensor_together_is_isolated_to_both(seed):
    found = diagnosis_of(seed, {"hpc.efficiency": -0.02, "sensor.T3.bias": 5.0})
    assert set(found.result.isolated) == {"hpc.efficiency", "sensor.T3.bias"}


def rivalry_of(answer, probability, *rivals):
    names = ("fan.efficiency", "hpc.efficiency", "sensor.T3.bias")
    score = SimpleNamespace(described=tuple(map(described, names)))
    return find_sensor_ambiguity(SetIsolation("posterior", answer, probability, rivals, 0, 0.95, {}, ()), score)


def test_a_sensor_against_a_component_is_a_rivalry_and_told_with_both_probabilities():
    found = rivalry_of(("sensor.T3.bias",), 0.55, Explanation(("hpc.efficiency",), 0.41))
    assert (found.sensors, found.components) == (("sensor.T3.bias",), ("hpc.efficiency",))
    assert (
        sensor_or_component(["T3 sensor bias"], ["HPC isentropic efficiency"], found.p_sensors, found.p_components)
        == "T3 sensor bias is indistinguishable from HPC isentropic efficiency: 0.55 against 0.41"
    )
    turned = rivalry_of(("hpc.efficiency",), 0.55, Explanation(("sensor.T3.bias",), 0.41))
    assert (turned.p_sensors, turned.p_components) == (0.41, 0.55)


def test_what_both_explanations_share_is_no_part_of_the_rivalry():
    answer = ("fan.efficiency", "sensor.T3.bias")
    found = rivalry_of(answer, 0.5, Explanation(("fan.efficiency", "hpc.efficiency"), 0.3))
    assert found.shared == ("fan.efficiency",) and found.components == ("hpc.efficiency",)


def test_two_components_an_addition_or_an_improbable_sensor_are_no_rivalry():
    for rival in (
        Explanation(("fan.efficiency",), 0.4),
        Explanation(("hpc.efficiency", "sensor.T3.bias"), 0.4),
        Explanation(("sensor.T3.bias",), 0.001),
    ):
        assert rivalry_of(("hpc.efficiency",), 0.5, rival) is None
