"""Engines that come with the project have the published figures of their class at the design point."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import CONFIGS

from enginediag_cli.physics.engine_file import load_engine

NEW = ("three_spool_turbofan", "afterburning_turbofan", "recuperated_micro_gas_turbine", "turboprop")


def loaded(name):
    return load_engine(CONFIGS / f"{name}.yaml")


def at_design(engine, *columns):
    e = engine.network.design_point
    return [float(np.ravel(engine.network.read(e, c))[0]) for c in columns]


@pytest.mark.parametrize("name", NEW)
def test_every_point_of_the_envelope_converges_from_idle_to_rating(name):
    engine = loaded(name)
    rng = np.random.default_rng(11)
    U = {c: rng.uniform(*engine.envelope[c], 5000) for c in engine.inputs if c != engine.power_setting}
    U[engine.power_setting] = engine.power_from_fraction(rng.uniform(0.0, 1.0, 5000), U)
    p = engine.predict(U)
    assert p.status.max() == 0, {p.reason(k) for k in np.flatnonzero(p.status)}
    assert p.passes.mean() < 6.0


def test_the_three_spool_turbofan_has_the_take_off_figures_of_a_trent_772():
    """Bare engine 320.3 kN at bypass ratio 5.05 and an overall pressure ratio of 35 to 36."""
    thrust, bypass, overall = at_design(loaded("three_spool_turbofan"), "Fn_N", "BPR", "OPR")
    assert thrust == pytest.approx(320.3e3, rel=0.01)
    assert bypass == pytest.approx(5.05)
    assert 35.0 < overall < 36.0


def test_the_afterburning_turbofan_has_the_figures_of_an_rm12_dry_and_lit():
    """54 kN at about 24 mg/(N s) dry, 80.5 kN at about 50 lit, from 68 kg/s."""
    engine = loaded("afterburning_turbofan")
    thrust, fuel = at_design(engine, "Fn_N", "SFC_kg_Ns")
    assert thrust == pytest.approx(54.0e3, rel=0.02)
    assert fuel == pytest.approx(24.0e-6, rel=0.05)
    design = {"altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0, "N2_rpm": 16810.0, "afterburner_fuel_air_ratio": 0.0437}
    p = engine.predict(design, sensors=["Fn_N", "SFC_kg_Ns", "T7_K", "N1_rpm", "Wf_kg_s"])
    assert p.ok.all()
    thrust, fuel, hot, fan, burnt = p.y[0]
    assert thrust == pytest.approx(80.5e3, rel=0.02)
    assert fuel == pytest.approx(50.0e-6, rel=0.03)
    assert 2000.0 < hot < 2300.0
    # the nozzle opens, so that the core hardly notices
    assert fan == pytest.approx(13270.0, rel=0.02)
    assert burnt == pytest.approx(at_design(engine, "Wf_kg_s")[0], rel=0.04)


def test_the_turboprop_has_the_figures_of_a_PT6A_42():
    """850 shp at 0.6 lb of fuel per shaft horse-power and hour; the governor keeps its propeller at 2,000 rpm."""
    engine = loaded("turboprop")
    power, fuel = at_design(engine, "propeller_power_W", "Wf_kg_s")
    assert power == pytest.approx(634.0e3, rel=1e-6)
    assert fuel / power == pytest.approx(0.601 * 0.45359237 / 3600.0 / 745.7, rel=0.02)
    torque = np.linspace(600.0, 3040.0, 20)
    points = {"altitude_m": 3000.0, "mach": 0.3, "dT_isa_K": 0.0, "reduction_gear_torque_N_m": torque}
    columns = ["N2_rpm", "N3_rpm", "propeller_thrust_N", "V0_m_s", "propeller_power_W"]
    p = engine.predict(points, sensors=columns)
    assert p.ok.all()
    N2, N3, thrust, V, power = p.y.T
    assert N2 == pytest.approx(2000.0, rel=1e-8) and N3 == pytest.approx(30000.0, rel=1e-8)
    efficiency = thrust * V / power
    assert ((efficiency > 0.75) & (efficiency < 0.93)).all()


def test_the_micro_gas_turbine_has_the_figures_of_a_capstone_c30():
    """30.0 kW from 415,000 kJ/h, 26 % of the lower heating value; 0.31 kg/s of exhaust, 593 °C behind the turbine."""
    power, fuel, exhaust, behind = at_design(
        loaded("recuperated_micro_gas_turbine"), "power_W", "Wf_kg_s", "W6_kg_s", "T5_K"
    )
    assert power == pytest.approx(30.0e3, rel=0.01)
    assert fuel * 49.0e6 == pytest.approx(415.0e6 / 3600.0, rel=0.01)
    assert power / (fuel * 49.0e6) == pytest.approx(0.26, abs=0.003)
    assert exhaust == pytest.approx(0.31, rel=0.01)
    assert behind - 273.15 == pytest.approx(593.0, abs=3.0)


def test_with_half_its_recuperator_the_micro_gas_turbine_needs_much_more_fuel_for_its_power():
    engine = loaded("recuperated_micro_gas_turbine")
    points = {
        "ambient_pressure_Pa": 101325.0,
        "ambient_temperature_K": 288.15,
        "humidity_kg_kg": 0.0063,
        "N1_rpm": 96000.0,
        "T5_K": 865.0,
    }
    y = engine.predict(points, {"recuperator.effectiveness": np.array([1.0, 0.5])}, sensors=["Wf_kg_s", "power_W"]).y
    assert y[1, 1] == pytest.approx(y[0, 1], rel=0.1)
    assert y[1, 0] > 1.4 * y[0, 0]
