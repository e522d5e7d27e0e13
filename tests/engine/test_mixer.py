"""Static states against isentropic tables; mixing conserves mass, energy and momentum; exact derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient, seeds

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.evaluation import Flow, mix, static_pressure
from enginediag_cli.engine.gas import DRY_AIR, Mixture

TABLES = {0.1: (0.99303, 5.8218), 0.3: (0.93947, 2.0351), 0.5: (0.84302, 1.3398), 0.8: (0.65602, 1.0382)}  # p/P, A/A*


@pytest.mark.parametrize("mach", TABLES)
def test_static_pressure_of_cold_air_is_that_of_the_isentropic_tables(mach):
    pressure, area = TABLES[mach]
    f = flow(300.0, 1e5, 5.0)
    throat = 5.0 * np.sqrt(300.0) / (0.040418 * 1e5)
    p, V = static_pressure(f, throat * area)
    assert p[0] / 1e5 == pytest.approx(pressure, rel=1.5e-3)
    assert V[0] == pytest.approx(mach * np.sqrt(1.4 * 287.05 * 300.0 / (1.0 + 0.2 * mach**2)), rel=3e-3)


def test_a_static_state_satisfies_continuity_and_energy():
    n = 30
    f = flow(np.linspace(400, 1100, n), np.full(n, 1.8e5), np.linspace(5, 30, n), far=np.linspace(0, 0.03, n))
    area = 0.25
    p, V = static_pressure(f, area)
    T_s, _ = GAS.temperature_from_enthalpy(f.h - 0.5 * V**2, f.mixture)
    assert np.allclose(p / (value(f.R) * T_s) * V * area, f.W, rtol=1e-9)
    assert (p < f.P).all()


def test_a_flow_too_large_for_its_area_has_no_static_pressure():
    p, _ = static_pressure(flow([300.0, 300.0], [1e5, 1e5], [5.0, 50.0]), 0.05)
    assert np.isfinite(p[0])
    assert np.isnan(p[1])


def test_static_pressure_has_exact_derivatives():
    T, P, W, far = np.array([600.0, 900.0]), np.array([1.5e5, 1.8e5]), np.array([18.0, 16.0]), np.array([0.01, 0.02])

    def at(dT=0.0, dP=0.0, dW=0.0, dfar=0.0):
        return static_pressure(Flow(GAS, Mixture(far + dfar), W + dW, P + dP, T=T + dT), 0.11)

    Td, Pd, Wd, fd = seeds(T, P, W, far)
    for k, x in enumerate(static_pressure(Flow(GAS, Mixture(fd), Wd, Pd, T=Td), 0.11)):
        g = gradient(x, 4)
        for row, step, name in ((0, 1.0, "dT"), (1, 200.0, "dP"), (2, 0.02, "dW"), (3, 1e-3, "dfar")):
            numeric = fourth_order(lambda t, k=k, name=name: at(**{name: t})[k], step)
            assert np.allclose(g[row], numeric, rtol=1e-6), name


def test_mixed_flows_conserve_mass_energy_fuel_and_water():
    hot, cold = flow(1000.0, 2e5, 12.0, far=0.02, war=0.01), flow(400.0, 2e5, 7.0, war=0.01)
    both = mix(hot, cold)
    assert both.W[0] == pytest.approx(19.0)
    assert (both.W * both.h)[0] == pytest.approx((hot.W * hot.h + cold.W * cold.h)[0], rel=1e-14)
    dry = 12.0 / 1.03 + 7.0 / 1.01
    assert both.mixture.far[0] == pytest.approx(12.0 / 1.03 * 0.02 / dry, rel=1e-12)
    assert both.mixture.war[0] == pytest.approx(0.01, rel=1e-12)
    assert both.W / both.mixture.per_dry_air() == pytest.approx(dry, rel=1e-12)


def mixer(core, bypass, **options):
    part = component("mixer", to="6", core="5", bypass="15", **options)
    e = evaluation([part])
    e.flows["5"], e.flows["15"] = core, bypass
    part.size(e)
    return part, e


def test_equal_streams_mix_without_loss():
    _, e = mixer(flow(500.0, 1.6e5, 10.0), flow(500.0, 1.6e5, 20.0))
    assert e.flows["6"].P[0] == pytest.approx(1.6e5, rel=1e-9)
    assert e.flows["6"].T[0] == pytest.approx(500.0, abs=1e-6)


def test_a_sized_mixer_meets_its_balance_at_the_core_mach_number():
    part, e = mixer(flow(900.0, 1.65e5, 10.0, far=0.02), flow(400.0, 1.7e5, 20.0), core_mach=0.35)
    assert e.balances["mixer static pressure"][0] == pytest.approx(0.0, abs=1e-9)
    p, V = static_pressure(e.flows["5"], part.core_area)
    T_s, _ = GAS.temperature_from_enthalpy(e.flows["5"].h - 0.5 * V**2, e.flows["5"].mixture)
    cp, R = GAS.heat_capacity(T_s, e.flows["5"].mixture), value(e.flows["5"].R)
    assert V[0] / np.sqrt(cp / (cp - R) * R * T_s)[0] == pytest.approx(0.35, rel=3e-3)  # sized with cp at total T
    assert p[0] < 1.65e5


def test_mixing_conserves_mass_energy_and_momentum():
    part, e = mixer(flow(900.0, 1.65e5, 10.0, far=0.02), flow(400.0, 1.7e5, 20.0))
    core, bypass, out = e.flows["5"], e.flows["15"], e.flows["6"]
    assert out.W[0] == pytest.approx(30.0)
    assert (out.W * out.h)[0] == pytest.approx((core.W * core.h + bypass.W * bypass.h)[0], rel=1e-13)
    impulse = 0.0
    for f, area in ((core, part.core_area), (bypass, part.bypass_area)):
        p, V = static_pressure(f, area)
        impulse = impulse + f.W * V + p * area
    area = part.core_area + part.bypass_area
    p, V = static_pressure(out, area)
    assert (out.W * V + p * area)[0] == pytest.approx(impulse[0], rel=1e-9)


def test_unequal_streams_lose_total_pressure():
    _, e = mixer(flow(1000.0, 1.7e5, 10.0), flow(350.0, 1.7e5, 20.0))
    assert 0.95 * 1.7e5 < e.flows["6"].P[0] < 1.7e5


def test_the_mixer_has_exact_derivatives_of_balance_and_total_pressure():
    part, _ = mixer(flow(900.0, 1.65e5, 10.0), flow(400.0, 1.7e5, 20.0), core_mach=0.5)
    start = {
        "Tc": np.array([880.0]),
        "Pc": np.array([1.64e5]),
        "Wc": np.array([9.9]),
        "Tb": np.array([410.0]),
        "Pb": np.array([1.69e5]),
        "Wb": np.array([19.5]),
    }

    def at(v):
        e = evaluation([part])
        e.flows["5"] = Flow(GAS, DRY_AIR, v["Wc"], v["Pc"], T=v["Tc"])
        e.flows["15"] = Flow(GAS, DRY_AIR, v["Wb"], v["Pb"], T=v["Tb"])
        part.evaluate(e)
        return e.balances["mixer static pressure"], e.flows["6"].P

    exact = at(dict(zip(start, seeds(*start.values()), strict=True)))
    for k, x in enumerate(exact):
        for row, name in enumerate(start):
            numeric = fourth_order(lambda t, k=k, name=name: at({**start, name: start[name] * (1 + t)})[k], 1e-3)
            found = gradient(x, 6)[row] * start[name]
            assert found == pytest.approx(numeric, rel=1e-6, abs=1e-7 * abs(value(x)[0]) + 1e-8), name


def test_a_bypass_below_the_core_static_pressure_cannot_be_sized():
    with pytest.raises(ValueError, match="below the core's static pressure"):
        mixer(flow(900.0, 2e5, 10.0), flow(400.0, 1.2e5, 20.0))


def test_a_supersonic_bypass_cannot_be_sized():
    with pytest.raises(ValueError, match="supersonic"):
        mixer(flow(900.0, 1.2e5, 10.0), flow(400.0, 2.6e5, 20.0))
