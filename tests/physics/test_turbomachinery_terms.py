"""Equations of the terms of turbomachinery, bleeds and shafts: a model that carries the term agrees with the plain
model whose parameters have been set by the equation, and terms relative to design vanish at the design point."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_flow import MIXED_FLOW
from term_makers import drawn, own_inputs, shipped

from enginediag_cli.engine.evaluation import saturated_water
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.registry import effect, term

RECORDS = 12
SUTHERLAND = 110.4


def carrying(engine, name, site, **values):
    return engine.replace_effects([effect(engine, name, site, values)])


def design_point(engine):
    """The design point as one record: inputs of its block and the power setting found there."""
    net = engine.network
    U = {c: np.array([net.design.get(c, 0.0)]) for c in (*engine.inputs, *engine.optional_inputs)}
    U |= {c: np.array([net.shafts[s]["design_speed_rpm"]]) for c, s in net.speed_columns.items() if c in U}
    U[engine.power_setting] = np.ravel(np.asarray(net.read(net.design_point, engine.power_setting), float))
    return U


def design(engine, *columns):
    """Model columns at the design point."""
    return engine.predict(design_point(engine), sensors=columns).y[0]


def agrees(engine, name, site, values, states, parameters, *, at=None, inputs=None):
    """Carries the term, reads `states` from it, and solves the plain engine with `parameters(*states)`."""
    carried = carrying(engine, name, site, **values)
    U = drawn(carried, RECORDS, 5, at)
    y = carried.predict(U)
    assert y.ok.all()
    theta = parameters(*carried.predict(U, sensors=states).y.T, U)
    plain = engine.predict({**own_inputs(engine, U), **(inputs or (lambda *_: {}))(U)}, theta)
    assert np.allclose(y.y, plain.y, rtol=1e-8)
    assert not np.allclose(y.y, engine.predict(own_inputs(engine, U)).y, rtol=1e-5)


def viscosity(T):
    return T**1.5 / (T + SUTHERLAND)


def test_turbine_losses_grow_with_a_power_of_the_reynolds_number():
    engine = shipped("turbofan")
    W4, T4 = design(engine, "W4_kg_s", "T4_K")
    loss = 1.0 - 0.88

    def efficiency(W, T, _):
        re = W / viscosity(T) / (W4 / viscosity(T4))
        return {"hpt.efficiency": (1.0 - loss * re**-0.2) / 0.88}

    agrees(engine, "reynolds_turbine_efficiency", "hpt", {"exponent": 0.2}, ("W4_kg_s", "T4_K"), efficiency)


def test_compressor_flow_falls_with_the_logarithm_of_the_reynolds_index():
    engine = shipped("turbojet")

    def index(T, P):
        return P / viscosity(T) / T**-0.5 / T

    reference = index(*design(engine, "T2_K", "P2_Pa"))
    agrees(
        engine,
        "reynolds_flow_capacity",
        "compressor",
        {"slope": 0.02},
        ("T2_K", "P2_Pa"),
        lambda T, P, _: {"compressor.flow_capacity": 1.0 + 0.02 * np.log(index(T, P) / reference)},
    )


@pytest.mark.parametrize(
    ("name", "growth"),
    [("turbine_tip_clearance", {"hpt": (0.0175, 0.002)}), ("compressor_tip_clearance", {"hpc": (0.015, 0.025)})],
)
def test_clearance_opens_as_the_square_of_the_speed_falls(name, growth):
    engine = shipped("turbofan")
    ((part, (k, kw)),) = growth.items()
    agrees(
        engine,
        name,
        part,
        {"growth": 1.5},
        ("N2_rpm",),
        lambda N, _: {
            f"{part}.efficiency": 1.0 - k * 1.5 * (1.0 - (N / 7900.0) ** 2),
            f"{part}.flow_capacity": 1.0 - kw * 1.5 * (1.0 - (N / 7900.0) ** 2),
        },
    )


def test_clearance_control_adds_efficiency_above_its_altitude_only():
    engine = shipped("turbofan")
    agrees(
        engine,
        "active_clearance_control",
        "hpt",
        {"closing": 0.8},
        (),
        lambda U: {"hpt.efficiency": 1.0 + 0.8 * 0.0175 / (1.0 + np.exp((6000.0 - U["altitude_m"]) / 300.0))},
    )


def test_vanes_closed_by_degrees_cost_flow_and_efficiency():
    engine = shipped("citation_jt15d")
    N, T = design(engine, "N2_rpm", "T25_K")

    def vanes(N2, T25, _):
        angle = 25.0 * (1.0 - N2 / np.sqrt(T25) / (N / np.sqrt(T)))
        return {"hpc.flow_capacity": np.exp(-0.01 * angle), "hpc.efficiency": 1.0 / (1.0 + 3e-4 * angle**2)}

    agrees(engine, "guide_vanes", "hpc", {"slope_deg": 25.0}, ("N2_rpm", "T25_K"), vanes)


def test_vanes_of_a_constant_speed_machine_close_as_the_firing_temperature_falls():
    engine = shipped("power_plant")
    (T4,) = design(engine, "T4_K")

    def vanes(U):
        below = np.log1p(np.exp(20.0 * (1.0 - U["T4_K"] / T4) / 0.02)) / 20.0
        angle = 30.0 * (1.0 - np.exp(-below))
        return {"compressor.flow_capacity": np.exp(-0.01 * angle), "compressor.efficiency": 1 / (1 + 5e-5 * angle**2)}

    agrees(engine, "guide_vanes_load", "compressor", {"closing_deg": 30.0}, (), vanes, at={"power": 0.95})


def test_vanes_of_a_constant_speed_machine_are_open_above_its_base_load():
    engine = shipped("power_plant")
    U = drawn(engine, RECORDS, 12, {"power": 1.0})
    U["T4_K"] = np.full(RECORDS, 1400.0)
    carried = carrying(engine, "guide_vanes_load", "compressor", closing_deg=30.0).predict(U)
    assert np.allclose(carried.y, engine.predict(U).y, rtol=1e-6)


def test_cooling_shares_follow_the_pressure_at_their_source():
    engine = shipped("turbofan")
    (P,) = design(engine, "P3_Pa")
    agrees(
        engine,
        "cooling_flow_variation",
        "hpt",
        {"exponent": 0.2},
        ("P3_Pa",),
        lambda P3, _: {
            "cooling.hpt_vanes.fraction": 0.055 * (P3 / P) ** 0.2,
            "cooling.hpt_exit.fraction": 0.035 * (P3 / P) ** 0.2,
        },
    )


def test_friction_and_windage_are_loads_on_the_shaft():
    engine = shipped("turbofan")
    N, P3, T3, power, hp = design(engine, "N2_rpm", "P3_Pa", "T3_K", "hpt_power_W", "hpc_power_W")
    assert power == pytest.approx(hp)
    agrees(
        engine,
        "bearing_loss",
        "hp",
        {"fraction": 0.01},
        ("N2_rpm",),
        lambda n, _: {"hp.power_offtake_W": 0.01 * power * (n / N) ** 2},
    )
    agrees(
        engine,
        "windage_loss",
        "hp",
        {"fraction": 0.01},
        ("N2_rpm", "P3_Pa", "T3_K"),
        lambda n, p, T, _: {"hp.power_offtake_W": 0.01 * power * (p / T) / (P3 / T3) * (n / N) ** 3},
        at={"humidity_kg_kg": 0.0},
    )


def test_fouling_saturates_with_the_hours_since_the_wash():
    engine = shipped("turbojet")

    def dirt(U):
        settled = 0.04 * (1.0 - np.exp(-U["hours_since_wash_h"] / 500.0))
        return {"compressor.flow_capacity": 1.0 - settled, "compressor.efficiency": 1.0 - 0.5 * settled}

    agrees(engine, "fouling", "compressor", {"flow_loss": 0.04}, (), dirt)


def test_a_compressor_just_washed_is_clean():
    engine = shipped("turbojet")
    U = drawn(carrying(engine, "fouling", "compressor"), RECORDS, 6, {"hours_since_wash_h": 0.0})
    fouled = carrying(engine, "fouling", "compressor", flow_loss=0.05).predict(U)
    assert np.allclose(fouled.y, engine.predict(own_inputs(engine, U)).y, rtol=1e-9)


def test_relative_humidity_is_water_of_saturated_air():
    engine = shipped("naval_gas_generator")
    agrees(
        engine,
        "humidity",
        "ambient",
        {"relative_humidity": 0.7},
        (),
        lambda U: {},
        at={"humidity_kg_kg": 0.0},
        inputs=lambda U: {
            "humidity_kg_kg": 0.7 * saturated_water(U["ambient_temperature_K"], U["ambient_pressure_Pa"])
        },
    )


def test_saturated_air_holds_the_published_amounts_of_water():
    """Psychrometric tables at 101.325 kPa: 3.79 g/kg at 0 °C, 7.66 at 10, 14.76 at 20, 27.33 at 30."""
    T = 273.15 + np.array([0.0, 10.0, 20.0, 30.0])
    assert saturated_water(T, 101325.0) == pytest.approx(np.array([3.79, 7.66, 14.76, 27.33]) * 1e-3, rel=0.008)


def test_an_interstage_bleed_with_all_the_work_done_is_a_bleed_from_the_exit():
    engine = shipped("turbofan")
    U = drawn(engine, RECORDS, 8)
    by_exit = carrying(engine, "customer_bleed", "hpc", fraction=0.04).predict(U)
    inside = carrying(engine, "interstage_bleed", "hpc", fraction=0.04, work_fraction=1.0).predict(U)
    assert np.allclose(by_exit.y, inside.y, rtol=1e-8)


def test_an_interstage_bleed_is_what_a_declared_port_does(tmp_path):
    port = "- {name: cabin, fraction: 0.01}"
    assert port in MIXED_FLOW
    path = tmp_path / "engine.yaml"
    path.write_text(MIXED_FLOW.replace(port, port.replace("0.01}", "0.03, work_fraction: 0.5}")))
    engine = load_engine(path)
    U = drawn(engine, RECORDS, 9)
    by_port = engine.predict(U)
    bled = carrying(engine, "interstage_bleed", "hpc", fraction=0.03, work_fraction=0.5).predict(
        U, {"hpc.cabin.fraction": 0.0}
    )
    assert by_port.ok.all()
    assert np.allclose(bled.y, by_port.y, rtol=1e-8)


def test_anti_ice_air_is_a_larger_share_at_low_speed():
    engine = shipped("turbojet")
    net = engine.network
    for fraction, share in ((1.0, 0.02), (0.0, 0.02)):
        U = drawn(engine, 1, 4, {"power": fraction, "altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0})
        p = carrying(engine, "anti_ice_bleed", "compressor", fraction=share).predict(
            U, sensors=("W2_kg_s", "W3_kg_s", "N1_rpm", "T2_K")
        )
        W2, W3, N, T2 = p.y[0]
        (T,) = design(engine, "T2_K")
        relative = N / 16500.0 / np.sqrt(T2 / T)
        assert net.shafts["spool"]["design_speed_rpm"] == 16500
        assert 1.0 - W3 / W2 == pytest.approx(share / relative, rel=1e-6)
        assert (1.0 - W3 / W2 > 0.025) == (fraction == 0.0)


def test_the_handling_valve_is_open_at_idle_and_shut_at_take_off():
    engine = shipped("turbofan")
    carried = carrying(engine, "handling_bleed", "booster", fraction=0.1)
    for power, low, high in ((0.0, 0.099, 0.1001), (1.0, 0.0, 0.002)):
        U = drawn(engine, 1, 4, {"power": power, "altitude_m": 0.0, "mach": 0.0, "dT_isa_K": 0.0})
        W23, W24 = carried.predict(U, sensors=("W23_kg_s", "W24_kg_s")).y[0]
        assert low <= 1.0 - W24 / W23 <= high


def test_the_fan_root_has_the_efficiency_that_its_pressure_says():
    """Isentropic efficiency from the core's pressure and the fan's temperature rise differs by a ln(BPR/BPR_design)."""
    engine = shipped("turbofan")
    U = drawn(engine, RECORDS, 10)
    carried = carrying(engine, "fan_split", "fan", root_efficiency=-0.05)
    T2, P2, T21, P21, P22, bpr = carried.predict(U, sensors=("T2_K", "P2_Pa", "T21_K", "P21_Pa", "P22_Pa", "BPR")).y.T
    k = 0.2857  # (γ − 1)/γ of cool air
    root, whole = ((T2 * ((P / P2) ** k - 1.0)) / (T21 - T2) for P in (P22, P21))
    assert np.allclose(root - whole, -0.05 * np.log(bpr / 5.1), atol=4e-3 * np.abs(np.log(bpr / 5.1)).max())


@pytest.mark.parametrize(
    ("name", "engine_name", "site"),
    [
        ("reynolds_turbine_efficiency", "turbofan", "lpt"),
        ("reynolds_flow_capacity", "citation_jt15d", "hpc"),
        ("guide_vanes", "turbofan", "hpc"),
        ("turbine_tip_clearance", "turbofan", "hpt"),
        ("compressor_tip_clearance", "naval_gas_generator", "compressor"),
        ("cooling_flow_variation", "turbofan", "hpt"),
        ("fan_split", "turbofan", "fan"),
    ],
)
def test_effects_relative_to_design_vanish_at_the_design_point(name, engine_name, site):
    engine = shipped(engine_name)
    U = design_point(engine)
    typical = {c.name: c.typical for c in term(name).amplitudes()}
    carried = carrying(engine, name, site, **typical).predict(U)
    assert carried.ok.all()
    assert np.allclose(carried.y, engine.predict(U).y, rtol=1e-8)
