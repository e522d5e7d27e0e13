"""Facts about effects on readings, on input columns and on nozzles that the table of all terms does not hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect, term
from enginediag_cli.physics.terms.control import recorded_altitude

CONFIGS = Path(__file__).parents[2] / "configs"


def carrying(name, *labels):
    engine = load_engine(CONFIGS / f"{name}.yaml")
    return engine.replace_effects([effect(engine, *label.split("@")) for label in labels])


def sites(name, term_name):
    return {s.name for s in term(term_name).sites(load_engine(CONFIGS / f"{name}.yaml").network)}


def flight(engine, altitude, mach, power=0.7):
    U = {"altitude_m": np.array(altitude), "mach": np.array(mach), "dT_isa_K": np.full(len(mach), 5.0)}
    U[engine.power_setting] = engine.power_from_fraction(power, U)
    return U


# inputs


def test_a_position_error_leaves_total_pressure_and_temperature_as_they_are():
    """Pitot tube and temperature probe are right; errors of second order in k = 0.1 % remain."""
    engine = carrying("turbofan", "static_pressure_error@ambient")
    U = flight(engine, [3000.0, 10000.0, 10990.0, 12000.0], [0.4, 0.8, 0.8, 0.82])
    columns = ("P1_Pa", "T1_K", "P0_Pa")
    right = engine.predict(U, sensors=columns).y
    k = 1e-3
    wrong = engine.predict(U, {"static_pressure_error.ambient.error": k}, sensors=columns).y
    assert wrong[:, 2] / right[:, 2] == pytest.approx(1.0 - k * U["mach"] ** 2, abs=1e-6)
    assert wrong[:, :2] == pytest.approx(right[:, :2], rel=3e-6)


@pytest.mark.parametrize("h_recorded", [0.0, 10990.0, 11500.0])
def test_the_recorded_altitude_is_found_from_the_true_one(h_recorded):
    T = 288.15 - 0.0065 * min(h_recorded, 11000.0)
    assert recorded_altitude(np.array([h_recorded + 0.4 * T]), 0.4) == pytest.approx(h_recorded, abs=1e-9)


def test_the_heated_probe_errs_most_on_the_ground_and_in_inverse_proportion_to_mach_and_pressure_in_flight():
    engine = carrying("turbofan", "tat_probe_heating@ambient")
    U = flight(engine, [0.0, 0.0, 9000.0, 9000.0], [0.0, 0.6, 0.6, 0.8])
    name = "tat_probe_heating.ambient.error_K"
    change = (engine.predict(U, {name: 2.0}, sensors=("T1_K",)).y - engine.predict(U, sensors=("T1_K",)).y)[:, 0]
    assert change[0] == pytest.approx(-2.0, abs=1e-6)
    assert change[1] == pytest.approx(-2.0 * 0.1 / 0.6, rel=0.03)
    assert change[2] / change[1] == pytest.approx(101325.0 / 30742.5, rel=0.01)
    assert change[3] / change[2] == pytest.approx(0.6 / 0.8, rel=0.02)


def test_a_meter_error_acts_where_its_column_is_given_and_nowhere_else():
    assert sites("turbofan", "fuel_meter_scale") == {"Wf"} and sites("turbofan", "speed_scale") == set()
    assert sites("citation_jt15d", "fuel_meter_scale") == set() and sites("citation_jt15d", "speed_scale") == {"N1"}
    assert sites("naval_gas_generator", "speed_scale") == {"N2"}
    engine = carrying("turbofan", "fuel_meter_scale@Wf")
    U = flight(engine, [5000.0], [0.5])
    scaled = engine.predict(U, {"fuel_meter_scale.Wf.error": 0.01}, sensors=("N1_rpm", "Wf_kg_s")).y
    less = engine.predict({**U, "Wf_kg_s": U["Wf_kg_s"] / 1.01}, sensors=("N1_rpm", "Wf_kg_s")).y
    assert scaled == pytest.approx(less, rel=1e-9)


# readings


def test_a_turbine_inlet_temperature_computed_without_the_barometer_errs_by_300_kelvin_per_unit_of_its_logarithm():
    engine = carrying("power_plant", "computed_reading@T4")
    p0 = np.array([98000.0, 101600.0, 103000.0])
    U = {
        "ambient_pressure_Pa": p0,
        "ambient_temperature_K": np.full(3, 288.0),
        "dP_inlet_Pa": np.full(3, 490.0),
        "T4_K": np.full(3, 1370.0),
    }
    true = engine.predict(U, {"computed_reading.T4.ignored": 1.0}, sensors=("T4_K",)).y[:, 0]
    assert true == pytest.approx(1370.0 - 301.0 * np.log(p0 / 101600.0), abs=0.5)


def test_computed_temperatures_are_sought_on_the_ground_and_in_burnt_gas_only():
    assert sites("power_plant", "computed_reading") == {"T4", "T5"}
    assert sites("naval_gas_generator", "computed_reading") == {"T45"}
    assert sites("turbofan", "computed_reading") == set()


def test_a_mean_of_two_stations_errs_by_the_mean_of_their_errors():
    engine = carrying("citation_jt15d", "thermocouple_recovery@ITT")
    U = flight(engine, [8000.0], [0.5])
    values = {"thermocouple_recovery.ITT.deficit": 0.1, "thermocouple_recovery.ITT.design_mach": 0.4}
    error = engine.predict(U, values).y - engine.predict(U).y
    column = list(engine.sensors).index("ITT_K")
    lost = 0.0
    for station in ("45", "5"):
        W, T, P = engine.predict(U, sensors=(f"W{station}_kg_s", f"T{station}_K", f"P{station}_Pa")).y[0]
        design = engine.network.design_point.flows[station]
        mach = 0.4 * (W * T**0.5 / P) / (design.W[0] * design.T[0] ** 0.5 / design.P[0])
        lost += 0.5 * T * (1.0 - 1.0 / (1.0 + 0.5 * (1.34 - 1.0) * mach**2))  # γ about 1.34
    assert error[0, column] == pytest.approx(-0.1 * lost, rel=0.05)
    assert np.delete(error[0], column) == pytest.approx(0.0, abs=1e-12)


def test_differences_ratios_shares_and_static_taps_are_not_probes_of_total_pressure():
    assert sites("power_plant", "pressure_probe_recovery") == {"P3"}  # not the exhaust's back pressure
    assert sites("cmapss_turbofan", "pressure_probe_recovery") == {"P3"}  # not Ps3, not fuel over P3


def test_a_reading_of_t4_itself_has_no_profile_error():
    for name in ("turbofan", "turbojet", "power_plant", "naval_gas_generator"):
        assert "T4" not in sites(name, "egt_profile")


# losses and nozzles


def test_a_filter_that_loads_up_costs_more_with_the_hours():
    engine = carrying("naval_gas_generator", "inlet_filter_loss@inlet")
    n = 3
    U = {
        "ambient_pressure_Pa": np.full(n, 101325.0),
        "ambient_temperature_K": np.full(n, 288.0),
        "N2_rpm": np.full(n, 3000.0),
        "Wf_kg_s": np.full(n, 1.3),
        "hours_since_filter_change_h": np.array([0.0, 1000.0, 2000.0]),
    }
    values = {"inlet_filter_loss.inlet.loss": 0.01, "inlet_filter_loss.inlet.growth": 0.5}
    y = engine.predict(U, values, sensors=("P2_Pa", "P1_Pa", "W2_kg_s", "T2_K")).y
    lost = 1.0 - y[:, 0] / y[:, 1]
    x = y[:, 2] * np.sqrt(y[:, 3] / 288.15) / (y[:, 0] / 101325.0) / 81.4
    assert lost == pytest.approx(0.01 * np.array([1.0, 1.5, 2.0]) * x**2, rel=1e-9)


def test_where_the_inlet_loss_is_recorded_a_filter_is_not_sought():
    assert sites("power_plant", "inlet_filter_loss") == set()
    assert sites("naval_gas_generator", "inlet_filter_loss") == {"inlet"}


def test_the_exhausts_back_pressure_is_the_stated_share_at_the_design_point():
    engine = carrying("power_plant", "exhaust_back_pressure@exhaust")
    d = engine.network.design
    U = {c: np.array([d[c]]) for c in ("ambient_pressure_Pa", "ambient_temperature_K", "dP_inlet_Pa", "humidity_kg_kg")}
    U["T4_K"] = np.array([1373.2])
    exhaust = next(c for c in engine.network.components if c.name == "exhaust")
    y = engine.predict(U, {"exhaust_back_pressure.exhaust.rise": 0.01}, sensors=("P5_Pa", "W5_kg_s", "T5_K")).y[0]
    own = y[1] ** 2 * y[2] / y[0] ** 2 / exhaust.flow_parameter**2 * exhaust.design_loss
    held_back = y[0] * (1.0 - own) - d["ambient_pressure_Pa"]
    assert held_back == pytest.approx(0.01 * d["ambient_pressure_Pa"], rel=0.02)


def test_a_stack_behind_the_nozzle_of_a_ground_engine_takes_the_flow_that_the_raised_pressure_leaves(tmp_path):
    """The turbojet on a test bed: the same power as against the ambient pressure plus the back pressure."""
    text = (CONFIGS / "turbojet.yaml").read_text()
    declared = yaml.safe_load(
        text.replace(
            '{type: ambient, name: ambient, to: "1"}', '{type: ambient, name: ambient, to: "1", conditions: ground}'
        )
    )
    declared["design"] = {"ambient_pressure_Pa": 101325, "ambient_temperature_K": 288.15}
    declared["envelope"] = {"ambient_pressure_Pa": {"low": 95000, "high": 104000}}
    path = tmp_path / "bed.yaml"
    path.write_text(yaml.safe_dump(declared))
    engine = load_engine(path)
    assert {s.name for s in term("inlet_ram_recovery").sites(engine.network)} == set()
    engine = engine.replace_effects([effect(engine, "exhaust_back_pressure", "nozzle")])
    U = {
        "ambient_pressure_Pa": np.full(2, 101325.0),
        "ambient_temperature_K": np.full(2, 288.15),
        "Wf_kg_s": np.array([0.12, 0.2]),
    }
    name = "exhaust_back_pressure.nozzle.rise"
    columns = ("P7_Pa", "W7_kg_s", "T7_K", "N1_rpm")
    p = engine.predict(U, {name: 0.03}, sensors=columns, wrt=(name,))
    free = engine.predict(U, sensors=columns)
    assert p.ok.all() and (p.y[:, 0] > free.y[:, 0]).all()
    h = 1e-4
    numeric = (
        engine.predict(U, {name: 0.03 + h}, sensors=columns).y - engine.predict(U, {name: 0.03 - h}, sensors=columns).y
    ) / (2 * h)
    assert p.jacobian[:, :, 0] == pytest.approx(numeric, rel=1e-5)


def test_unburnt_fuel_grows_in_proportion_to_the_loading():
    engine = carrying("turbofan", "combustion_efficiency@burner")
    U = flight(engine, [0.0, 10000.0], [0.0, 0.8], power=0.5)
    a = 1e-3
    y = engine.predict(U, {"combustion_efficiency.burner.unburnt": a}, sensors=("W31_kg_s", "P31_Pa", "T31_K")).y
    design = engine.network.design_point.flows["31"]
    loading = [w / p**1.8 / 10 ** (0.00145 * (T - 400.0)) for w, p, T in [*y, (design.W[0], design.P[0], design.T[0])]]
    share = 1.0 - a * (np.array(loading[:2]) / loading[2] - 1.0) / 0.994
    plain = load_engine(CONFIGS / "turbofan.yaml")
    same = plain.predict(U, {"burner.efficiency": share}, sensors=("W31_kg_s", "P31_Pa", "T31_K")).y
    assert y == pytest.approx(same, rel=1e-8)


def test_derivatives_along_input_columns_pass_through_what_corrects_them():
    engine = carrying(
        "turbofan",
        "static_pressure_error@ambient",
        "tat_probe_heating@ambient",
        "fuel_meter_scale@Wf",
        "inlet_filter_loss@inlet",
    )
    typical = {e.parameter_name(c.name): c.typical for e in engine.effects for c in e.term.COEFFICIENTS}
    U = flight(engine, [2000.0, 9000.0, 12000.0], [0.3, 0.7, 0.8])
    U["hours_since_filter_change_h"] = np.array([0.0, 500.0, 900.0])
    steps = {"altitude_m": 20.0, "mach": 1e-3, "dT_isa_K": 0.5, "Wf_kg_s": 1e-3, "hours_since_filter_change_h": 20.0}
    base = engine.predict(U, typical, wrt=tuple(steps))
    for k, (column, h) in enumerate(steps.items()):

        def moved(t, column=column):
            return engine.predict({**U, column: U[column] + t}, typical, start=base.x).y

        numeric = (moved(-2 * h) - 8 * moved(-h) + 8 * moved(h) - moved(2 * h)) / (12 * h)
        assert base.jacobian[:, :, k] == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max())
