"""Intercooler: limits, heat, coolant from ambient or a column, derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.gas import DRY_AIR
from enginediag_cli.physics.engine_file import load_engine

ENGINE = """\
kind: engine
description: intercooled gas turbine for tests
name: intercooled
power_setting: T4_K
components:
  - {type: ambient, name: ambient, to: "1", conditions: ground}
  - {type: inlet, name: inlet, from: "1", to: "2", corrected_flow_kg_s: 20}
  - {type: compressor, name: low, from: "2", to: "24", shaft: rotor, pressure_ratio: 3, isentropic_efficiency: 0.85}
  - {type: intercooler, name: cooler, from: "24", to: "25", effectiveness: 0.8, coolant: column, design_coolant_K: 295,
     law: corrected_flow_squared}
  - {type: compressor, name: high, from: "25", to: "3", shaft: rotor, pressure_ratio: 4, isentropic_efficiency: 0.85}
  - {type: burner, name: burner, from: "3", to: "4", exit_temperature_K: 1400}
  - {type: turbine, name: turbine, from: "4", to: "5", shaft: rotor, pressure_ratio: 10, isentropic_efficiency: 0.88}
  - {type: exhaust, name: exhaust, from: "5"}
  - {type: load, name: generator, shaft: rotor, law: surplus, efficiency: 0.97}
shafts: [{name: rotor, speed_label: N1, design_speed_rpm: 9000, speed: constant}]
sensors: {T5_K: {noise_sigma: 2}}
envelope: {T4_K: {low: 1000, high: 1500}}
power_range: [1100, 1400]
"""


def cooled(effectiveness=0.8, T=430.0, coolant=288.15, wrt=(), **leaves):
    part = component("intercooler", to="25", effectiveness=effectiveness, pressure_loss=0.02, **{"from": "24"})
    e = evaluation([part], wrt=wrt, **leaves)
    e.flows["24"], e.outputs["T0_K"] = flow(T, 3e5, 20.0), np.array([coolant])
    part.evaluate(e)
    return e


def test_it_cools_towards_the_ambient_by_its_effectiveness_and_loses_pressure():
    e = cooled()
    h_in, h_c, h = (GAS.enthalpy(np.atleast_1d(T), DRY_AIR)[0] for T in (430.0, 288.15, e.flows["25"].T[0]))
    assert (h_in - h) / (h_in - h_c) == pytest.approx(0.8, rel=1e-9)
    assert e.flows["25"].P[0] == pytest.approx(3e5 * 0.98, rel=1e-14)
    assert e.outputs["intercooler_heat_W"][0] == pytest.approx(20.0 * (h_in - h), rel=1e-9)


def test_its_limits_are_a_duct_and_the_coolant():
    assert cooled(0.0).flows["25"].h[0] == cooled().flows["24"].h[0]
    assert cooled(1.0).flows["25"].T[0] == pytest.approx(288.15, abs=1e-7)


def test_a_coolant_that_is_warmer_heats():
    assert cooled(coolant=450.0).flows["25"].T[0] > 430.0


@pytest.mark.parametrize(("exponent", "expected"), [(0.0, 1.0 - 0.2**0.5), (0.8, 1.0 - 0.2 ** (2.0**-0.2))])
def test_a_given_conductance_is_less_effective_at_twice_the_flow(exponent, expected):
    """ε = 1 − e^−NTU is 0.8 at the design flow; NTU ∝ W^(m − 1)."""
    part = component(
        "intercooler",
        to="25",
        effectiveness=0.8,
        effectiveness_law="ntu",
        conductance_exponent=exponent,
        **{"from": "24"},
    )
    found = []
    for W, step in ((20.0, part.size), (20.0, part.evaluate), (40.0, part.evaluate)):
        e = evaluation([part])
        e.flows["24"], e.outputs["T0_K"] = flow(430.0, 3e5, W), np.array([288.15])
        step(e)
        h_in, h_c, h = (GAS.enthalpy(np.atleast_1d(T), DRY_AIR)[0] for T in (430.0, 288.15, e.flows["25"].T[0]))
        found.append((h_in - h) / (h_in - h_c))
    assert found == pytest.approx([0.8, 0.8, expected], rel=1e-9)


def test_its_derivatives_match_differences():
    names = {"intercooler.effectiveness": 1.0, "intercooler.pressure_loss": 0.02}
    e = cooled(wrt=tuple(names))
    for name, at in names.items():
        for read in (lambda e: e.flows["25"].T, lambda e: e.flows["25"].P):

            def moved(t, name=name, at=at, read=read):
                return value(read(cooled(**{name.replace(".", "__"): at * (1.0 + t)})))[0]

            x = read(e)
            g = gradient(x, len(e.directions))[e.directions[name]][0] * at if name in e.directions else 0.0
            assert g == pytest.approx(fourth_order(moved, 1e-3), rel=1e-6, abs=1e-12 * abs(value(x)[0]))


def test_an_engine_takes_the_coolant_from_its_column(tmp_path):
    path = tmp_path / "engine.yaml"
    path.write_text(ENGINE, encoding="utf-8")
    engine = load_engine(path)
    assert "cooler_coolant_K" in engine.inputs
    U = {"ambient_pressure_Pa": 101325.0, "ambient_temperature_K": 288.15, "T4_K": 1400.0}
    p = engine.predict({**U, "cooler_coolant_K": np.array([280.0, 295.0, 310.0])}, sensors=("T25_K", "power_W"))
    assert p.status.max() == 0
    assert (np.diff(p.y[:, 0]) > 5.0).all()
    assert (np.diff(p.y[:, 1]) < 0.0).all()
    assert p.x[:, 1] == pytest.approx(np.ones(len(engine.unknowns)), abs=1e-9)
