"""Propellers: the law's closed forms, its sizing, thrust in Fn_N, pitch, tables, derivatives."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from driven_engines import turboprop
from engine_makers import component, fourth_order, gradient, seeds
from test_gearbox import flight as any_flight
from test_gearbox import loaded, message

SLOW = 0.18
"""Mach number up to which the propeller, its pitch sized at rest, pulls: beyond, its blades windmill."""
PITCHES = np.array([8.0, 20.0, 35.0, 50.0])


def ideal(**keys):
    """A propeller without profile drag: nothing is lost but the energy of its slipstream."""
    return component("propeller", shaft="x", diameter_m=2.0, drag_coefficient=0.0, drag_rise=0.0, **keys)


def test_without_drag_static_thrust_is_that_of_an_actuator_disc():
    """P² = T³/(2 ρ A), whatever pitch and solidity."""
    for solidity in (0.05, 0.2):
        C_T, C_P, _ = ideal(solidity=solidity).coefficients(PITCHES, np.zeros(4))
        assert C_P**2 == pytest.approx(C_T**3 / (2.0 * pi / 4.0), rel=1e-12)


def test_without_drag_the_efficiency_in_flight_is_froudes():
    """η = T V/P = 2/(1 + √(1 + c_T)), c_T = T/(½ ρ V² A)."""
    J = np.array([0.3, 0.6, 0.9, 1.5])
    C_T, C_P, _ = ideal(solidity=0.12).coefficients(PITCHES + 10.0, J)
    loading = C_T / (0.5 * J**2 * pi / 4.0)
    assert C_T * J / C_P == pytest.approx(2.0 / (1.0 + np.sqrt(1.0 + loading)), rel=1e-12)


def test_thrust_vanishes_at_the_advance_ratio_of_the_blades_pitch():
    J_0 = 0.75 * pi * np.tan(np.radians(PITCHES))
    C_T, C_P, _ = component("propeller", shaft="x", diameter_m=2.0).coefficients(PITCHES, J_0)
    assert np.abs(C_T).max() < 1e-12
    profile = pi**4 * 0.12 / 32.0 * 0.0087 * (1.0 + 3.0 * (J_0 / pi) ** 2)
    assert C_P == pytest.approx(profile, rel=1e-9)


def test_the_law_is_of_the_size_of_real_propellers():
    """About 0.8 of the power becomes thrust at its best advance ratio, and a static thrust of 20 N/kW or so is had."""
    propeller = component("propeller", shaft="x", diameter_m=2.0, solidity=0.1)
    J = np.linspace(0.3, 1.2, 60)
    C_T, C_P, _ = propeller.coefficients(np.full(60, 28.0), J)
    assert (C_T > 0.0).all()
    assert 0.75 < (C_T * J / C_P).max() < 0.92
    C_T, C_P, _ = propeller.coefficients(np.full(1, 20.0), np.zeros(1))
    per_kW = 1000.0 * C_T[0] / (C_P[0] * 40.0 * 2.0)  # at 2400 rpm
    assert 10.0 < per_kW < 35.0


def test_derivatives_of_the_law_match_differences():
    propeller = component("propeller", shaft="x", diameter_m=2.0)
    pitch, J = seeds([10.0, 25.0, 45.0], [0.0, 0.7, 1.9])
    for k, (x, h) in enumerate(((pitch, 1e-2), (J, 1e-3))):
        moved = [pitch.v, J.v]

        def at(t, k=k, moved=moved, x=x):
            args = list(moved)
            args[k] = x.v + t
            return np.stack(propeller.coefficients(*args)[:2])

        C_T, C_P, _ = propeller.coefficients(pitch, J)
        exact = np.stack([gradient(C_T, 2)[k], gradient(C_P, 2)[k]])
        assert exact == pytest.approx(fourth_order(at, h), rel=1e-7, abs=1e-10)


def flight(engine, n=200):
    U = any_flight(engine, n)
    return {**U, "mach": U["mach"] * (SLOW / engine.envelope["mach"][1])}


@pytest.fixture(scope="module")
def engine(tmp_path_factory):
    return loaded(tmp_path_factory.mktemp("turboprop"), turboprop())


def propeller_of(engine):
    return next(c for c in engine.network.components if c.TYPE == "propeller")


def test_at_the_design_point_it_takes_its_power_at_the_pitch_where_it_stands(engine):
    [actuator] = propeller_of(engine).actuators()
    assert actuator.name == "propeller.pitch_deg"
    assert engine.network.neutral["propeller.pitch_deg"] == actuator.neutral
    assert actuator.lower < actuator.neutral < actuator.upper
    e = engine.network.design_point
    assert e.outputs["propeller_power_W"][0] == pytest.approx(6.0e5, rel=1e-9)
    assert e.outputs["power_W"][0] == pytest.approx(6.0e5 + 6000.0, rel=1e-9)


def test_its_thrust_is_part_of_the_net_thrust(engine):
    columns = ["Fn_N", "gross_thrust_N", "ram_drag_N", "propeller_thrust_N"]
    net, gross, ram, thrust = engine.predict(flight(engine), sensors=columns).y.T
    assert net == pytest.approx(gross - ram + thrust, rel=1e-13)
    assert (thrust > 0.0).all()


def test_power_thrust_and_speed_follow_the_coefficients(engine):
    points = flight(engine)
    columns = ["propeller_power_W", "propeller_thrust_N", "N3_rpm", "V0_m_s", "P0_Pa", "T0_K", "propeller_torque_N_m"]
    power, thrust, rpm, V, P0, T0, torque = engine.predict(points, sensors=columns).y.T
    n, rho = rpm / 60.0, P0 / (287.05 * T0)
    propeller = propeller_of(engine)
    C_T, C_P, _ = propeller.coefficients(np.full(len(n), propeller.design_pitch_deg), V / (n * 2.5))
    assert power == pytest.approx(C_P * rho * n**3 * 2.5**5, rel=1e-4)
    assert thrust == pytest.approx(C_T * rho * n**2 * 2.5**4, rel=1e-4)
    assert torque == pytest.approx(power / (2.0 * pi * n), rel=1e-12)


def test_at_coarser_pitch_it_turns_slower(engine, monkeypatch):
    points = {c: v[:5] for c, v in flight(engine).items()}
    before = engine.predict(points, sensors=["N3_rpm"]).y
    neutral = engine.network.neutral["propeller.pitch_deg"]
    monkeypatch.setitem(engine.network.neutral, "propeller.pitch_deg", neutral + 3.0)
    assert (engine.predict(points, sensors=["N3_rpm"]).y < 0.97 * before).all()


def test_a_worn_propeller_gives_less_thrust_for_the_same_fuel_and_derivatives_match(engine):
    points = flight(engine, 30)
    wrt = ("propeller.efficiency", "propeller.power_coefficient", "mach")
    columns = ["Fn_N", "N3_rpm", "propeller_power_W"]
    p = engine.predict(points, sensors=columns, wrt=wrt)
    assert (p.jacobian[:, 0, 0] > 0.0).all()
    assert (p.jacobian[:, 1, 1] < 0.0).all()
    for k, name in enumerate(wrt):

        def moved(t, name=name):
            if name == "mach":
                return engine.predict({**points, "mach": points["mach"] + t}, sensors=columns, start=p.x).y
            return engine.predict(points, {name: 1.0 + t}, sensors=columns, start=p.x).y

        numeric = fourth_order(moved, 1e-3)
        assert np.abs(p.jacobian[:, :, k] - numeric).max(axis=0) == pytest.approx(
            np.zeros(3), abs=2e-6 * np.abs(numeric).max()
        )


def test_a_table_of_the_laws_own_values_makes_the_same_propeller(engine, tmp_path):
    pitches, J = np.linspace(4.0, 70.0, 67), np.linspace(0.0, 4.0, 81)
    grid = [(b, j) for b in pitches for j in J]
    C_T, C_P, _ = propeller_of(engine).coefficients(*(np.array(v) for v in zip(*grid, strict=True)))
    rows = [f"{b},{j},{t},{p}" for (b, j), t, p in zip(grid, C_T, C_P, strict=True)]
    (tmp_path / "propeller.csv").write_text("\n".join(["pitch_deg,J,CT,CP", *rows]), encoding="utf-8")
    text = turboprop().replace(
        "diameter_m: 2.5, ", "diameter_m: 2.5, table: {file: propeller.csv, interpolation: quadratic}, "
    )
    other = loaded(tmp_path, text)
    points = flight(engine)
    columns = ["Fn_N", "N3_rpm", "propeller_power_W"]
    assert other.predict(points, sensors=columns).y == pytest.approx(
        engine.predict(points, sensors=columns).y, rel=2e-4
    )


def test_a_propeller_that_cannot_take_the_power_is_refused_with_its_range_and_a_diameter(tmp_path):
    told = message(tmp_path, turboprop().replace("diameter_m: 2.5", "diameter_m: 0.8"))
    assert "propeller: at 2000 rpm it takes" in told and "m is the nearest that would do" in told


def test_a_propeller_at_a_given_speed_is_refused_with_what_would_close(tmp_path):
    text = turboprop().replace("design_speed_rpm: 2000,", "design_speed_rpm: 2000, speed: constant,")
    told = message(tmp_path, text)
    assert "propeller takes power by a law" in told and "a pitch that a control moves" in told


def test_a_propeller_behind_its_turbine_takes_what_the_shaft_has_to_spare(tmp_path):
    """On a shaft of its own, without gears: the pitch is sized by what the turbine's stated ratio gives."""
    text = turboprop(propeller="").replace(
        "  - {type: gearbox, name: reduction, shaft: free, drives: propeller, ratio: 15, efficiency: 0.985}\n", ""
    )
    text = text.replace("isentropic_efficiency: 0.87}", "isentropic_efficiency: 0.87, pressure_ratio: 2.2}")
    text = text.replace("design_speed_rpm: 30000}", "design_speed_rpm: 2000}")
    text = text[: text.index("  - {name: propeller, speed_label")]
    text = text.replace("shafts:\n", "  - {type: propeller, name: propeller, shaft: free, diameter_m: 2.5}\nshafts:\n")
    e = loaded(tmp_path, text).network.design_point
    assert e.outputs["propeller_power_W"][0] == pytest.approx(e.outputs["lpt_power_W"][0], rel=1e-9)
