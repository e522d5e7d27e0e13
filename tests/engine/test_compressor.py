"""Compressor: isentropic work, efficiency, health factors, bleed ports and tabulated maps."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, gradient, shaft

from enginediag_cli.engine.dual import value

PORTS = [
    {"name": "early", "fraction": 0.04, "work_fraction": 0.5, "pressure_fraction": 0.3},
    {"name": "late", "fraction": 0.06, "work_fraction": 1.0, "pressure_fraction": 1.0},
]


def sized(size=1, **options):
    """A compressor of pressure ratio 10 and efficiency 0.85 with the pass that sized it."""
    part = component(
        "compressor", to="3", shaft="hp", pressure_ratio=10.0, isentropic_efficiency=0.85, **{"from": "2"}, **options
    )
    e = evaluation([part])
    e.flows["2"], e.shafts["hp"] = flow(288.15, 101325.0, 20.0), shaft(10000.0)
    part.size(e)
    return part, e


def run(part, T=288.15, P=101325.0, W=20.0, rpm=10000.0, wrt=(), **parameters):
    inlet, turning = flow(T, P, W), shaft(rpm)
    e = evaluation([part], size=np.size(inlet.W), wrt=wrt, **parameters)
    e.flows["2"], e.shafts["hp"] = inlet, turning
    part.evaluate(e)
    return e


def isentropic_efficiency(inlet, outlet):
    _, h_s = GAS.temperature_from_entropy(inlet.phi + inlet.R * np.log(value(outlet.P) / value(inlet.P)), inlet.mixture)
    return (h_s - inlet.h) / (value(outlet.h) - inlet.h)


def test_a_sized_compressor_has_its_design_pressure_ratio_and_efficiency():
    _, e = sized()
    inlet, outlet = e.flows["2"], e.flows["3"]
    assert outlet.P[0] / inlet.P[0] == pytest.approx(10.0, rel=1e-9)
    assert isentropic_efficiency(inlet, outlet)[0] == pytest.approx(0.85, rel=1e-9)


def test_the_exit_temperature_is_near_that_of_constant_gamma():
    _, e = sized()
    rise = (10.0 ** (0.39 / 1.39) - 1.0) / 0.85  # γ = 1.39 at the mean temperature
    assert e.flows["3"].T[0] == pytest.approx(288.15 * (1.0 + rise), rel=0.01)


def test_shaft_power_is_mass_flow_times_enthalpy_rise():
    _, e = sized()
    work = 20.0 * (e.flows["3"].h - e.flows["2"].h)
    assert e.shafts["hp"].demand_W[0] == pytest.approx(work[0], rel=1e-12)
    assert e.outputs["compressor_power_W"][0] == pytest.approx(work[0], rel=1e-12)


def test_the_same_corrected_point_gives_the_same_pressure_ratio_at_any_inlet_pressure():
    part, _ = sized()
    e = run(
        part,
        P=np.array([101325.0, 30000.0]),
        T=np.array([288.15, 288.15]),
        W=np.array([18.0, 18.0 * 30000 / 101325]),
        rpm=np.array([9500.0, 9500.0]),
    )
    assert e.outputs["compressor_pressure_ratio"][0] == pytest.approx(
        e.outputs["compressor_pressure_ratio"][1], rel=1e-12
    )


def test_the_efficiency_factor_scales_the_isentropic_efficiency():
    part, _ = sized()
    e = run(part, compressor__efficiency=0.97)
    assert isentropic_efficiency(e.flows["2"], e.flows["3"])[0] == pytest.approx(0.97 * 0.85, rel=1e-9)


def test_the_flow_factor_moves_the_map_along_flow():
    part, _ = sized()
    fouled = run(part, W=20.0 * 0.96, compressor__flow_capacity=0.96)
    assert fouled.outputs["compressor_pressure_ratio"][0] == pytest.approx(10.0, rel=1e-9)


def test_pressure_ratio_falls_with_flow_and_rises_with_speed():
    part, _ = sized()
    flows = run(
        part, W=np.linspace(16.0, 22.0, 20), T=np.full(20, 288.15), P=np.full(20, 101325.0), rpm=np.full(20, 1e4)
    )
    assert (np.diff(flows.outputs["compressor_pressure_ratio"]) < 0.0).all()
    speeds = run(
        part, W=np.full(20, 18.0), T=np.full(20, 288.15), P=np.full(20, 101325.0), rpm=np.linspace(9e3, 1.05e4, 20)
    )
    assert (np.diff(speeds.outputs["compressor_pressure_ratio"]) > 0.0).all()


def test_bleed_ports_conserve_mass_and_energy():
    _, e = sized(ports=PORTS)
    inlet, outlet, bleeds = e.flows["2"], e.flows["3"], e.bleeds
    assert outlet.W + bleeds["early"].W + bleeds["late"].W == pytest.approx(inlet.W, rel=1e-14)
    delivered = sum(f.W * f.h for f in (outlet, *bleeds.values()))
    assert delivered[0] == pytest.approx((inlet.W * inlet.h + e.shafts["hp"].demand_W)[0], rel=1e-13)


def test_bleed_ports_deliver_their_share_of_work_and_pressure():
    _, e = sized(ports=PORTS)
    inlet, outlet, early = e.flows["2"], e.flows["3"], e.bleeds["early"]
    assert (early.h - inlet.h)[0] == pytest.approx(0.5 * (outlet.h - inlet.h)[0], rel=1e-12)
    assert (early.P - inlet.P)[0] == pytest.approx(0.3 * (outlet.P - inlet.P)[0], rel=1e-12)
    assert e.bleeds["late"].h == pytest.approx(outlet.h)


# tabulated

MAP_SPEEDS, MAP_RLINES = np.array([0.8, 0.9, 1.0, 1.1]), np.array([1.0, 1.5, 2.0, 2.5, 3.0])


def map_file(tmp_path):
    rows = ["Nc_map,Rline,Wc_map,PR_map,eff_map"]
    for n in MAP_SPEEDS:
        for r in MAP_RLINES:
            rows.append(
                f"{n},{r},{50 * n**2 * (0.8 + 0.1 * r)},{1 + 6 * n**3 * (1.4 - 0.2 * r)},"
                f"{0.9 - 0.02 * (r - 2) ** 2 - 0.3 * (n - 1) ** 2}"
            )
    (tmp_path / "map.csv").write_text("\n".join(rows), encoding="utf-8")
    return {"directory": str(tmp_path), "table": {"file": "map.csv", "design_speed": 1.0, "design_rline": 2.0}}


def test_a_tabulated_map_is_scaled_to_the_design_point(tmp_path):
    part, e = sized(**map_file(tmp_path))
    assert [u.name for u in part.unknowns()] == ["compressor.rline"]
    assert e.flows["3"].P[0] / e.flows["2"].P[0] == pytest.approx(10.0, rel=1e-9)
    assert isentropic_efficiency(e.flows["2"], e.flows["3"])[0] == pytest.approx(0.85, rel=1e-9)
    assert e.balances["compressor flow"][0] == pytest.approx(0.0, abs=1e-13)


def test_a_point_outside_the_tabulated_map_is_marked_by_component_name(tmp_path):
    part, _ = sized(**map_file(tmp_path))
    e = run(part, T=[288.15, 288.15], P=[101325.0, 101325.0], W=[20.0, 20.0], rpm=[10000.0, 11500.0])
    assert list(e.outside["the map of compressor"]) == [False, True]


def test_the_tabulated_balance_says_how_the_flow_differs_from_the_map(tmp_path):
    part, _ = sized(**map_file(tmp_path))
    e = run(part, W=21.0)
    assert e.balances["compressor flow"][0] == pytest.approx(0.05, rel=1e-10)
    e = run(part, W=21.0, compressor__flow_capacity=1.05)
    assert e.balances["compressor flow"][0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("tabulated", [False, True], ids=["parametric", "tabulated"])
def test_exit_state_has_the_derivative_of_the_efficiency_factor(tmp_path, tabulated):
    part, _ = sized(**(map_file(tmp_path) if tabulated else {}))
    e = run(part, wrt=("compressor.efficiency",))
    up, down = (run(part, compressor__efficiency=1.0 + s) for s in (1e-4, -1e-4))
    for what in (lambda e: e.flows["3"].T, lambda e: e.flows["3"].P, lambda e: e.shafts["hp"].demand_W):
        numeric = (value(what(up)) - value(what(down))) / 2e-4
        assert gradient(what(e), 1)[0] == pytest.approx(numeric, rel=1e-6, abs=1e-6 * abs(value(what(up))[0]))
