"""Ambient, inlet, splitter, bleed, duct, burner, exhaust and load: each against its own law."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient, shaft

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.gas import Mixture

# ambient


def ambient(wrt=(), **leaves):
    part = component("ambient", to="1", conditions="ground" if "ambient_pressure_Pa" in leaves else "flight")
    given = {"humidity_kg_kg": 0.0, **{k: np.atleast_1d(np.asarray(v, dtype=float)) for k, v in leaves.items()}}
    e = evaluation([part], size=max(np.size(v) for v in given.values()), wrt=wrt, **given)
    part.evaluate(e)
    return e


def test_total_conditions_in_flight_are_those_of_gamma_1_4():
    e = ambient(altitude_m=[0.0, 8000.0, 11000.0], mach=[0.3, 0.6, 0.85], dT_isa_K=[0.0, 0.0, 10.0])
    M = np.array([0.3, 0.6, 0.85])
    assert np.allclose(e.flows["1"].T / e.outputs["T0_K"], 1.0 + 0.2 * M**2, rtol=1e-3)
    assert np.allclose(e.flows["1"].P / e.outputs["P0_Pa"], (1.0 + 0.2 * M**2) ** 3.5, rtol=2e-3)
    assert np.allclose(e.outputs["V0_m_s"], M * np.sqrt(1.4 * 287.05 * e.outputs["T0_K"]), rtol=1e-3)


def test_at_rest_total_conditions_are_the_static_ones():
    e = ambient(altitude_m=1500.0, mach=0.0, dT_isa_K=5.0)
    assert e.flows["1"].T[0] == pytest.approx(283.40, abs=1e-6)
    assert e.flows["1"].P[0] == pytest.approx(84556.0, rel=1e-5)
    assert e.outputs["V0_m_s"][0] == 0.0


def test_ground_conditions_are_the_measured_ones():
    e = ambient(ambient_pressure_Pa=99000.0, ambient_temperature_K=301.0, humidity_kg_kg=0.01)
    f = e.flows["1"]
    assert (f.T[0], f.P[0], e.outputs["P0_Pa"][0]) == (301.0, 99000.0, 99000.0)
    assert f.mixture.war[0] == 0.01


def test_humidity_raises_the_speed_of_sound_by_a_quarter_percent_per_hundredth():
    dry, humid = (ambient(altitude_m=0.0, mach=0.5, dT_isa_K=10.0, humidity_kg_kg=w) for w in (0.0, 0.01))
    assert (humid.outputs["V0_m_s"] / dry.outputs["V0_m_s"])[0] == pytest.approx(1.0025, abs=2e-4)


def test_ambient_has_exact_derivatives_with_its_inputs_even_at_zero_humidity():
    nominal = {"altitude_m": 9000.0, "mach": 0.7, "dT_isa_K": 4.0, "humidity_kg_kg": 0.0}
    e = ambient(wrt=tuple(nominal), **nominal)
    steps = {"altitude_m": 20.0, "mach": 2e-3, "dT_isa_K": 0.5, "humidity_kg_kg": 1e-3}
    for what in (lambda e: e.flows["1"].T, lambda e: e.flows["1"].P, lambda e: e.outputs["V0_m_s"]):
        g = gradient(what(e), 4)
        for name, h in steps.items():
            numeric = fourth_order(
                lambda t, name=name, what=what: what(ambient(**{**nominal, name: nominal[name] + t})), h
            )
            assert g[e.directions[name]] == pytest.approx(numeric, rel=1e-6, abs=1e-7 * abs(value(what(e))[0]))


# inlet and splitter


def inlet(mach=0.5, W=1.0, **options):
    part = component("inlet", to="2", corrected_flow_kg_s=100.0, **{"from": "1"}, **options)
    e = evaluation([part], inlet__corrected_flow=np.array([W]), mach=np.array([mach]), dP_inlet_Pa=np.array([1500.0]))
    e.flows["1"], e.outputs["V0_m_s"] = flow(280.0, 90000.0), np.array([150.0])
    part.evaluate(e)
    return e


def test_the_inlet_gives_corrected_flow_recovery_and_ram_drag():
    e = inlet(W=0.9, pressure_recovery=0.98)
    P = 0.98 * 90000.0
    W = 0.9 * 100.0 * (P / 101325.0) / np.sqrt(280.0 / 288.15)
    assert e.flows["2"].P[0] == pytest.approx(P)
    assert e.flows["2"].W[0] == pytest.approx(W, rel=1e-14)
    assert e.outputs["ram_drag_N"][0] == pytest.approx(W * 150.0, rel=1e-14)


def test_a_measured_inlet_loss_is_taken_off_the_pressure():
    assert inlet(measured_loss=True).flows["2"].P[0] == pytest.approx(88500.0)


@pytest.mark.parametrize(("rule", "recovery"), [("linear", 0.985), ("step", 0.99)])
def test_the_recovery_table_is_read_linearly_or_in_steps(rule, recovery):
    e = inlet(mach=0.5, recovery_mach=[0.0, 0.4, 0.6], recovery_table=[1.0, 0.99, 0.98], recovery_rule=rule)
    assert e.flows["2"].P[0] == pytest.approx(90000.0 * recovery)


def test_outside_its_table_the_recovery_keeps_the_end_value():
    e = inlet(mach=0.9, recovery_mach=[0.0, 0.4, 0.6], recovery_table=[1.0, 0.99, 0.98])
    assert e.flows["2"].P[0] == pytest.approx(90000.0 * 0.98)


def test_the_splitter_divides_by_the_bypass_ratio():
    part = component("splitter", core="22", bypass="13", bypass_ratio=5.0, **{"from": "21"})
    e = evaluation([part], splitter__bypass_ratio=np.array([0.9]))
    e.flows["21"] = flow(320.0, 1.6e5, 110.0)
    part.evaluate(e)
    assert (e.flows["13"].W / e.flows["22"].W)[0] == pytest.approx(4.5, rel=1e-14)
    assert (e.flows["13"].W + e.flows["22"].W)[0] == pytest.approx(110.0, rel=1e-15)
    assert e.outputs["BPR"][0] == pytest.approx(4.5)


# bleed and duct

PORTS = [{"name": "cooling", "fraction": 0.06}, {"name": "cabin", "fraction": 0.02}]


def test_bleeds_take_their_fraction_at_the_station_state():
    part = component("bleed", to="31", ports=PORTS, **{"from": "3"})
    e = evaluation([part], bleed__cabin__fraction=0.03)
    e.flows["3"] = flow(780.0, 2e6, 50.0)
    part.evaluate(e)
    assert e.bleeds["cooling"].W[0] == pytest.approx(3.0)
    assert e.bleeds["cabin"].W[0] == pytest.approx(1.5)
    assert e.flows["31"].W[0] == pytest.approx(45.5)
    for f in (*e.bleeds.values(), e.flows["31"]):
        assert (f.T[0], f.P[0]) == (780.0, 2e6)


def duct(law="constant", W=20.0, T=500.0, P=2e5, bleed=None, **parameters):
    part = component("duct", to="b", pressure_loss=0.02, law=law, receives=["air"] if bleed else [], **{"from": "a"})
    for step in (part.size, part.evaluate):
        e = evaluation([part], **parameters)
        sizing = step == part.size
        e.flows["a"] = flow(500.0, 2e5, 20.0) if sizing else flow(T, P, W)
        if bleed:
            e.bleeds["air"] = bleed
        step(e)
    return e


def test_a_constant_duct_loses_the_same_share_of_pressure_everywhere():
    assert duct(W=33.0, T=700.0).flows["b"].P[0] == pytest.approx(0.98 * 2e5, rel=1e-14)


def test_a_duct_by_corrected_flow_loses_with_its_square():
    assert duct("corrected_flow_squared").flows["b"].P[0] == pytest.approx(0.98 * 2e5, rel=1e-14)
    assert duct("corrected_flow_squared", W=10.0).flows["b"].P[0] == pytest.approx((1 - 0.02 / 4) * 2e5, rel=1e-14)
    assert duct("corrected_flow_squared", T=2000.0).flows["b"].P[0] == pytest.approx((1 - 0.02 * 4) * 2e5, rel=1e-14)


def test_a_duct_that_receives_a_bleed_conserves_mass_and_energy():
    air = flow(800.0, 3e5, 2.0)
    f = duct(bleed=air).flows["b"]
    assert f.W[0] == pytest.approx(22.0)
    assert (f.W * f.h)[0] == pytest.approx((20.0 * flow(500.0, 2e5).h + 2.0 * air.h)[0], rel=1e-14)
    assert f.P[0] == pytest.approx(0.98 * 2e5, rel=1e-14)


# burner


def burner(**parameters):
    part = component(
        "burner",
        to="4",
        exit_temperature_K=1500.0,
        combustion_efficiency=0.99,
        pressure_loss=0.05,
        lower_heating_value_J_kg=43e6,
        **{"from": "3"},
    )
    for step in (part.size, part.evaluate):
        e = evaluation([part], **(parameters if step == part.evaluate else {}))
        e.flows["3"] = flow(800.0, 2e6, 50.0)
        step(e)
    return part, e


def test_a_sized_burner_reaches_its_exit_temperature_and_its_heat_balance_closes():
    _, e = burner()
    f, fuel = e.flows["4"], e.outputs["Wf_kg_s"]
    assert f.T[0] == pytest.approx(1500.0, abs=1e-7)
    assert f.P[0] == pytest.approx(1.9e6, rel=1e-14)
    assert (f.W * f.h)[0] == pytest.approx((50.0 * e.flows["3"].h + fuel * 0.99 * 43e6)[0], rel=1e-14)
    assert f.W[0] == pytest.approx(50.0 + fuel[0], rel=1e-15)
    assert f.mixture.far[0] == pytest.approx(fuel[0] / 50.0, rel=1e-14)


def test_less_complete_combustion_gives_a_cooler_exit():
    _, poor = burner(burner__efficiency=0.97)
    _, good = burner()
    assert poor.flows["4"].T[0] < good.flows["4"].T[0] - 15.0


def test_fuel_burnt_again_adds_to_the_fuel_air_ratio():
    part, _ = burner()
    e = evaluation([part], burner__fuel_flow=np.array([0.4]))
    e.flows["3"] = flow(1000.0, 5e5, 51.0, far=0.02)
    part.evaluate(e)
    assert e.flows["4"].mixture.far[0] == pytest.approx(0.02 + 0.4 / (51.0 / 1.02), rel=1e-14)


# exhaust and load


def exhaust(P=1.04e5, W=30.0, back=0.0, **parameters):
    part = component("exhaust", measured_back_pressure=True, **{"from": "6"})
    for step in (part.size, part.evaluate):
        sizing = step == part.size
        e = evaluation([part], dP_exhaust_Pa=np.array([0.0 if sizing else back]), **({} if sizing else parameters))
        e.outputs["P0_Pa"] = np.array([1e5])
        e.flows["6"] = flow(800.0, 1.04e5 if sizing else P, 30.0 if sizing else W)
        step(e)
    return part, e


def test_the_exhaust_meets_its_balance_at_design_and_its_loss_follows_the_square_of_the_flow():
    _, e = exhaust()
    assert e.balances["exhaust pressure"][0] == pytest.approx(0.0, abs=1e-14)
    loss = 1.0 - 1e5 / 1.04e5
    _, e = exhaust(W=15.0)
    assert e.balances["exhaust pressure"][0] == pytest.approx(1.04 * (1.0 - loss / 4.0) - 1.0, rel=1e-12)
    _, e = exhaust(exhaust__loss_factor=2.0)
    assert e.balances["exhaust pressure"][0] == pytest.approx(1.04 * (1.0 - 2.0 * loss) - 1.0, rel=1e-12)


def test_a_measured_back_pressure_raises_the_pressure_to_be_met():
    _, e = exhaust(back=2000.0)
    assert e.balances["exhaust pressure"][0] == pytest.approx(1e5 / 1.02e5 - 1.0, rel=1e-12)


def load(law, rpm=3000.0, supply=12e6):
    part = component("load", shaft="power", law=law, efficiency=0.97)
    for step in (part.size, part.evaluate):
        sizing = step == part.size
        e = evaluation([part], power__mechanical_efficiency=0.99, power__power_offtake_W=1e5)
        e.shafts["power"] = shaft(3000.0 if sizing else rpm)
        e.shafts["power"].supply_W = np.array([12e6 if sizing else supply])
        e.shafts["power"].demand_W = np.array([5e6])
        step(e)
    return e


def test_a_surplus_load_takes_what_the_shaft_can_spare():
    e = load("surplus", supply=11e6)
    assert e.outputs["power_W"][0] == pytest.approx(0.97 * (0.99 * 11e6 - 5e6 - 1e5), rel=1e-14)
    assert not e.balances


def test_a_cube_load_absorbs_the_cube_of_speed_and_leaves_the_balance_to_its_shaft():
    surplus = 0.99 * 12e6 - 5e6 - 1e5
    e = load("cube")
    assert e.shafts["power"].load_W == pytest.approx(surplus, rel=1e-15)
    assert not e.balances
    e = load("cube", rpm=1500.0)
    assert e.outputs["power_W"][0] == pytest.approx(0.97 * surplus / 8.0, rel=1e-13)
    assert e.shafts["power"].load_W[0] == pytest.approx(surplus / 8.0, rel=1e-13)


def test_gas_data_of_the_helpers_are_those_of_kerosene():
    assert GAS.constant(Mixture(far=np.array([0.02])))[0] == pytest.approx(287.1, abs=0.3)
