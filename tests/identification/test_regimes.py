"""Regimes: by flight where altitude and time tell, else bands of the power setting, never of the weather."""

from __future__ import annotations

import numpy as np

from enginediag_cli.identification.nominal import assign_regimes

N = 90
RNG = np.random.default_rng(5)
WEATHER = {
    "ambient_pressure_Pa": RNG.uniform(98e3, 103e3, N),
    "ambient_temperature_K": RNG.uniform(275, 305, N),
    "dP_inlet_Pa": RNG.uniform(300, 600, N),
}
INPUTS = (*WEATHER, "T4_K")


def test_a_ground_engine_is_cut_by_its_power_setting_and_not_by_the_weather():
    [label] = assign_regimes([{**WEATHER, "T4_K": np.linspace(1280, 1370, N)}], INPUTS)
    assert label[0] == "low T4_K" and label[N // 2] == "middle T4_K" and label[-1] == "high T4_K"


def test_a_power_setting_that_hardly_varies_is_one_regime():
    [label] = assign_regimes([{**WEATHER, "T4_K": 1373.0 + RNG.normal(0, 0.3, N)}], INPUTS)
    assert set(label) == {"all"}


def test_bands_are_common_to_all_recordings():
    low, high = (np.full(N, v) + RNG.uniform(-5, 5, N) for v in (1280.0, 1370.0))
    first, second = assign_regimes([{**WEATHER, "T4_K": low}, {**WEATHER, "T4_K": high}], INPUTS)
    assert "high T4_K" not in first and "low T4_K" not in second


def test_a_climb_a_cruise_and_a_descent_are_told_apart_by_altitude_and_time():
    time = np.arange(300.0)
    altitude = np.concatenate([10.0 * time[:100], np.full(100, 1000.0), 1000.0 - 8.0 * time[:100]])
    [label] = assign_regimes([{"time_s": time, "altitude_m": altitude}], ("altitude_m", "N1_rpm"))
    assert label[50] == "climb" and label[150] == "cruise" and label[250] == "descent"


def test_a_phase_column_is_used_as_it_is():
    phase = np.array(["taxi"] * N)
    [label] = assign_regimes([{"phase": phase, "N1_rpm": np.arange(N)}], ("N1_rpm",))
    assert (label == phase).all()
