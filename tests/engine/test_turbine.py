"""Turbine: energy, efficiency, capacity, and cooling before and after the rotor."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import component, evaluation, flow, gradient, shaft

from enginediag_cli.engine.dual import value

COOLED = {"cooling_before_rotor": ["vanes"], "cooling_after_rotor": ["rear"]}


def prepared(part, W=21.0, T=1500.0, P=1.9e6, rpm=10000.0, wrt=(), demand=0.0, cooling=0.0, **parameters):
    e = evaluation(
        [part],
        size=np.size(W),
        wrt=wrt,
        **{"hp__mechanical_efficiency": 1.0, "hp__power_offtake_W": 0.0, **parameters},
    )
    e.flows["4"] = flow(T, P, W, far=np.full(np.size(W), 0.022))
    e.bleeds["vanes"] = flow(np.full(np.size(W), 780.0), np.full(np.size(W), 2.0e6), np.full(np.size(W), 1.2 + cooling))
    e.bleeds["rear"] = flow(np.full(np.size(W), 780.0), np.full(np.size(W), 2.0e6), np.full(np.size(W), 0.8))
    e.shafts["hp"] = shaft(np.full(np.size(W), rpm))
    e.shafts["hp"].demand_W = demand
    return e


def sized(demand=0.0, **options):
    part = component("turbine", to="45", shaft="hp", isentropic_efficiency=0.88, **{"from": "4"}, **options)
    e = prepared(part, demand=np.full(1, demand))
    part.size(e)
    return part, e


def run(part, **options):
    e = prepared(part, **options)
    part.evaluate(e)
    return e


def test_an_uncooled_turbine_expands_with_its_design_efficiency():
    _, e = sized(pressure_ratio=3.0)
    inlet, outlet = e.flows["4"], e.flows["45"]
    ideal = inlet.h - inlet.expanded_enthalpy(np.log(3.0))
    assert inlet.P[0] / outlet.P[0] == pytest.approx(3.0, rel=1e-12)
    assert (inlet.h - outlet.h)[0] == pytest.approx(0.88 * ideal[0], rel=1e-12)
    assert e.balances["turbine flow"][0] == pytest.approx(0.0, abs=1e-13)


def test_the_exit_temperature_is_near_that_of_constant_gamma():
    _, e = sized(pressure_ratio=3.0)
    drop = 1500.0 * 0.88 * (1.0 - 3.0 ** (-0.30 / 1.30))  # γ = 1.30 at the mean temperature
    assert e.flows["45"].T[0] == pytest.approx(1500.0 - drop, rel=0.01)


def test_the_energy_balance_of_a_cooled_turbine_closes():
    _, e = sized(pressure_ratio=3.0, **COOLED)
    outlet = e.flows["45"]
    entering = e.flows["4"].W * e.flows["4"].h + 2.0 * flow(780.0, 2e6).h
    assert (outlet.W * outlet.h + e.shafts["hp"].supply_W)[0] == pytest.approx(entering[0], rel=1e-13)


def test_a_cooled_turbine_conserves_mass_and_fuel():
    _, e = sized(pressure_ratio=3.0, **COOLED)
    outlet = e.flows["45"]
    assert outlet.W[0] == pytest.approx(23.0, rel=1e-14)
    dry = 21.0 / 1.022 + 2.0
    assert outlet.mixture.far[0] == pytest.approx(21.0 / 1.022 * 0.022 / dry, rel=1e-12)
    assert not e.bleeds


def test_cooling_before_the_rotor_works_and_cooling_after_it_does_not():
    plain, _ = sized(pressure_ratio=3.0)
    cooled, _ = sized(pressure_ratio=3.0, **COOLED)
    extra = value(run(cooled).shafts["hp"].supply_W - run(plain).shafts["hp"].supply_W)
    air = flow(780.0, 2e6)
    assert extra[0] == pytest.approx(0.88 * 1.2 * (air.h - air.expanded_enthalpy(np.log(3.0)))[0], rel=1e-10)


def test_the_rotor_inlet_station_is_the_mixed_state_before_the_work():
    _, e = sized(pressure_ratio=3.0, rotor_inlet_station="41", **COOLED)
    mixed = e.flows["41"]
    assert mixed.W[0] == pytest.approx(22.2)
    assert (mixed.W * mixed.h)[0] == pytest.approx((21.0 * e.flows["4"].h + 1.2 * flow(780.0, 2e6).h)[0], rel=1e-13)
    assert e.flows["4"].T[0] > mixed.T[0] > e.flows["45"].T[0]


def test_without_a_pressure_ratio_the_turbine_is_sized_to_meet_its_shaft():
    for options in ({}, COOLED):
        _, e = sized(demand=8e6, **options)
        assert e.shafts["hp"].supply_W[0] == pytest.approx(8e6, rel=1e-10)


def test_a_shaft_that_asks_for_more_than_the_gas_has_cannot_be_sized():
    with pytest.raises(ValueError, match="turbine: the gas cannot give the 40"):
        sized(demand=40e6)


def test_the_flow_factor_scales_the_swallowing_capacity():
    part, _ = sized(pressure_ratio=3.0)
    assert run(part, W=[21.0 * 1.03], T=[1500.0], P=[1.9e6]).balances["turbine flow"][0] == pytest.approx(
        0.03, rel=1e-9
    )
    assert run(part, W=[21.0 * 1.03], T=[1500.0], P=[1.9e6], turbine__flow_capacity=1.03).balances["turbine flow"][
        0
    ] == pytest.approx(0.0, abs=1e-12)


def test_the_efficiency_factor_scales_the_power():
    part, _ = sized(pressure_ratio=3.0, **COOLED)
    good, worn = run(part).shafts["hp"].supply_W, run(part, turbine__efficiency=0.98).shafts["hp"].supply_W
    assert worn[0] / good[0] == pytest.approx(0.98, rel=1e-12)


def test_power_and_balance_have_exact_derivatives():
    part, _ = sized(pressure_ratio=3.0, **COOLED)
    names = ("turbine.pressure_ratio", "turbine.efficiency", "turbine.map.choking_exponent")
    nominal = {
        "turbine.pressure_ratio": np.array([0.9]),
        "turbine.efficiency": 1.0,
        "turbine.map.choking_exponent": 3.0,
    }

    def at(name, t):
        given = {**nominal, name: nominal[name] + t}
        e = run(part, **{k.replace(".", "__"): v for k, v in given.items()})
        return np.array(
            [
                value(e.shafts["hp"].supply_W)[0] * 1e-6,
                value(e.balances["turbine flow"])[0],
                value(e.flows["45"].T)[0] * 1e-3,
            ]
        )

    e = run(part, wrt=names, turbine__pressure_ratio=np.array([0.9]))
    for name in names:
        numeric = (at(name, -2e-3) - 8 * at(name, -1e-3) + 8 * at(name, 1e-3) - at(name, 2e-3)) / 12e-3
        k = e.directions[name]
        exact = [gradient(x, 3)[k, 0] for x in (e.shafts["hp"].supply_W, e.balances["turbine flow"], e.flows["45"].T)]
        assert np.allclose(np.array(exact) * [1e-6, 1.0, 1e-3], numeric, rtol=1e-7, atol=1e-8)


def test_a_tabulated_map_is_scaled_to_the_design_point(tmp_path):
    rows = ["Nc_map,PR_map,Wp_map,eff_map"]
    for n in (60.0, 80.0, 100.0, 120.0):
        for r in (3.0, 4.0, 5.0, 6.0):
            rows.append(f"{n},{r},{80 + 2 * r - 0.05 * n},{0.9 - 1e-5 * (n - 100) ** 2 - 0.01 * (r - 5) ** 2}")
    (tmp_path / "map.csv").write_text("\n".join(rows), encoding="utf-8")
    part, e = sized(pressure_ratio=3.0, directory=str(tmp_path), table={"file": "map.csv"})
    ideal = e.flows["4"].h - e.flows["4"].expanded_enthalpy(np.log(3.0))
    assert (e.flows["4"].h - e.flows["45"].h)[0] == pytest.approx(0.88 * ideal[0], rel=1e-12)
    assert e.balances["turbine flow"][0] == pytest.approx(0.0, abs=1e-12)
    assert not any(mask.any() for mask in e.outside.values())
    fast = run(part, rpm=14000.0)
    assert fast.outside["the map of turbine"].all()
