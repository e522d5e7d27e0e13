"""∂Φ/∂θ against fourth-order differences of full solves, for every kind of parameter and input."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import TURBOFAN, operating_points, turbofan

from enginediag_cli.engine import solver
from enginediag_cli.physics.engine_file import load_engine

N = 100
COLUMNS = ("N1_rpm", "N2_rpm", "T25_K", "P25_Pa", "T3_K", "P3_Pa", "T45_K", "T5_K", "P5_Pa", "Fn_N", "T4_K", "BPR")
CRITICAL = ("core_nozzle_pressure_ratio", "bypass_nozzle_pressure_ratio")
DESIGN = (
    "hpc.map.work_slope",
    "fan.map.choking_exponent",
    "booster.map.flow_speed_exponent",
    "fan.map.work_speed_exponent",
    "hpc.map.loss_incidence",
    "hpt.map.choking_exponent",
    "lpt.map.efficiency_loading",
    "lpt.map.capacity_speed_slope",
    "inlet.pressure_recovery",
    "interduct.pressure_loss",
    "burner.pressure_loss",
    "burner.efficiency",
    "burner.lower_heating_value_J_kg",
    "cooling.hpt_vanes.fraction",
    "cooling.hpt_exit.fraction",
    "core_nozzle.velocity_coefficient",
    "bypass_nozzle.area",
    "lp.mechanical_efficiency",
    "hp.power_offtake_W",
)
INPUTS = ("altitude_m", "mach", "dT_isa_K", "humidity_kg_kg")
STEP = {
    "altitude_m": 10.0,
    "mach": 1e-3,
    "dT_isa_K": 0.3,
    "humidity_kg_kg": 1e-3,
    "hp.power_offtake_W": 1e4,
    "lpt.map.capacity_speed_slope": 2e-3,
}


@pytest.fixture(autouse=True)
def tightly_solved(monkeypatch):
    """Solves go to rounding, so that differences of them are not differences of their tolerance."""
    monkeypatch.setattr(solver, "TOLERANCE", 3e-13)


def flight(engine, seed):
    # 11 km, where the atmosphere has its own kink, is left out
    return operating_points(engine, N, seed, altitude=(0.0, 10500.0), mach=(0.02, 0.85))


def away_from_choking(ratios):
    """Points at least 3 % from the pressure ratio at which a nozzle chokes, where Φ has a kink."""
    return (np.abs(ratios[:, 0] / 1.855 - 1.0) > 0.04) & (np.abs(ratios[:, 1] / 1.893 - 1.0) > 0.03)


def check(engine, points, names, least_points=60):
    """Jacobian entries against differences, relative to the largest of each entry over the points."""
    p = engine.predict(points, sensors=COLUMNS + CRITICAL, wrt=names)
    assert p.ok.all()
    away = away_from_choking(p.y[:, len(COLUMNS) :])
    assert away.sum() >= least_points
    for k, name in enumerate(names):

        def moved(t, name=name):
            if name in engine.parameters:
                return engine.predict(points, {name: engine.parameters[name].nominal + t}, sensors=COLUMNS, start=p.x).y
            return engine.predict({**points, name: points.get(name, 0.0) + t}, sensors=COLUMNS, start=p.x).y

        h = STEP.get(name) or 1.5e-3 * (
            abs(engine.parameters[name].nominal) if name in engine.parameters else np.abs(points[name]).mean()
        )
        numeric = (moved(-2 * h) - 8 * moved(-h) + 8 * moved(h) - moved(2 * h)) / (12 * h)
        error = np.abs(p.jacobian[:, : len(COLUMNS), k] - numeric)[away].max(axis=0)
        # an entry that is zero but for rounding has no scale of its own: its column's value gives it one
        scale = np.maximum(
            np.abs(numeric[away]).max(axis=0),
            1e-4
            * np.abs(p.y[away][:, : len(COLUMNS)]).max(axis=0)
            / max(abs(engine.parameters[name].nominal) if name in engine.parameters else 1.0, h),
        )
        worst = int(np.argmax(error / scale))
        assert (error <= 1e-6 * scale).all(), f"{name} on {COLUMNS[worst]}: {(error / scale)[worst]:.1e}"


def test_sensitivities_to_the_monitored_parameters_match_differences():
    engine = turbofan()
    check(engine, flight(engine, 21), engine.monitored)


def test_sensitivities_to_design_parameters_match_differences():
    engine = turbofan()
    check(engine, flight(engine, 22), DESIGN)


def test_sensitivities_to_inputs_match_differences():
    engine = turbofan()
    check(engine, flight(engine, 23), (*INPUTS, "Wf_kg_s"))


def test_sensitivities_in_humid_air_match_differences():
    engine = turbofan()
    U = {**flight(engine, 24), "humidity_kg_kg": np.linspace(0.0, 0.02, N)}
    check(engine, U, ("fan.efficiency", "hpt.flow_capacity", "humidity_kg_kg", "core_nozzle.area"))


@pytest.mark.parametrize("power_setting", ["N1_rpm", "T4_K", "Fn_N"])
def test_sensitivities_at_another_power_setting_match_differences(power_setting):
    by_fuel = turbofan()
    U = flight(by_fuel, 25)
    engine = load_engine(TURBOFAN, power_setting)
    value = by_fuel.predict(U, sensors=(power_setting,)).y[:, 0]
    points = {**{c: U[c] for c in ("altitude_m", "mach", "dT_isa_K")}, power_setting: value}
    check(engine, points, ("fan.efficiency", "hpc.flow_capacity", "core_nozzle.area", "hpt.efficiency", power_setting))


def test_sensor_parameters_have_the_derivatives_of_a_straight_line():
    engine = turbofan()
    U = flight(engine, 26)
    theta = {"sensor.T3.bias": 2.0, "sensor.T3.scale": 1.01}
    p = engine.predict(
        U, theta, sensors=("T3_K", "P3_Pa"), wrt=("sensor.T3.bias", "sensor.T3.scale", "sensor.P3.scale")
    )
    assert np.allclose(p.jacobian[:, 0, 0], 1.0)
    assert np.allclose(p.jacobian[:, 0, 1], (p.y[:, 0] - 2.0) / 1.01, rtol=1e-12)
    assert np.allclose(p.jacobian[:, 1, 2], p.y[:, 1], rtol=1e-12)
    assert np.abs(p.jacobian[:, 1, :2]).max() == 0.0


def test_a_sensor_scale_multiplies_the_sensitivity_of_its_reading():
    engine = turbofan()
    U = flight(engine, 27)
    plain = engine.predict(U, sensors=("T3_K",), wrt=("hpc.efficiency",))
    scaled = engine.predict(U, {"sensor.T3.scale": 1.05}, sensors=("T3_K",), wrt=("hpc.efficiency",))
    assert np.allclose(scaled.jacobian, 1.05 * plain.jacobian, rtol=1e-7)


def test_the_order_of_the_parameters_only_orders_the_columns():
    engine = turbofan()
    U = flight(engine, 28)
    a = engine.predict(U, wrt=engine.monitored)
    b = engine.predict(U, wrt=engine.monitored[::-1])
    scale = np.abs(a.jacobian).max(axis=0)
    assert (np.abs(b.jacobian[:, :, ::-1] - a.jacobian) <= 1e-9 * scale + 1e-12).all()


def test_more_parameters_do_not_change_the_sensitivity_to_one():
    engine = turbofan()
    U = flight(engine, 29)
    alone = engine.predict(U, wrt=("hpt.efficiency",)).jacobian[:, :, 0]
    among = engine.predict(U, wrt=(*engine.monitored, *DESIGN, *INPUTS)).jacobian[
        :, :, engine.monitored.index("hpt.efficiency")
    ]
    assert (np.abs(alone - among) <= 1e-8 * np.abs(alone).max(axis=0)).all()


def test_the_chain_of_power_settings_closes():
    """dT45/dN2 at given N2 = (dT45/dWf) / (dN2/dWf) at given fuel flow."""
    by_fuel, by_speed = turbofan(), load_engine(TURBOFAN, "N2_rpm")
    U = flight(by_fuel, 30)
    fuel = by_fuel.predict(U, sensors=("T45_K", "N2_rpm"), wrt=("Wf_kg_s",))
    points = {**{c: U[c] for c in ("altitude_m", "mach", "dT_isa_K")}, "N2_rpm": fuel.y[:, 1]}
    speed = by_speed.predict(points, sensors=("T45_K",), wrt=("N2_rpm",))
    assert np.allclose(speed.jacobian[:, 0, 0], fuel.jacobian[:, 0, 0] / fuel.jacobian[:, 1, 0], rtol=1e-6)
