"""Convergent nozzle against the gas tables of γ = 1.4, through choking, and its thrust."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import component, evaluation, flow, fourth_order, gradient, seeds

from enginediag_cli.engine.components.nozzles import throat
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.evaluation import Flow
from enginediag_cli.engine.gas import DRY_AIR

R = 287.05
CRITICAL_COLD = 1.8929  # 1.2^3.5


def flux_parameter(ratio, T=288.15, P=2e5):
    """ρV √T/P of dry air at total T [K] and P [Pa], expanded to P/ratio."""
    n = np.size(ratio)
    f = flow(np.full(n, T), np.full(n, P))
    flux, V, p = throat(f, np.log(np.atleast_1d(ratio)), np.full(n, P) / ratio)
    return flux * np.sqrt(T) / P, V, p


def test_choked_flow_of_cold_air_is_the_textbook_0_0404():
    # W √T/(A P) = √(γ/R) (2/2.4)^3 = 0.04042 for γ = 1.4
    for ratio in (1.9, 3.0, 10.0):
        assert flux_parameter(ratio)[0][0] == pytest.approx(0.04042, rel=1e-3)


@pytest.mark.parametrize("ratio", [1.05, 1.2, 1.4, 1.7])
def test_unchoked_flow_of_cold_air_is_that_of_the_isentropic_tables(ratio):
    M = np.sqrt(5.0 * (ratio ** (1.0 / 3.5) - 1.0))
    assert flux_parameter(ratio)[0][0] == pytest.approx(np.sqrt(1.4 / R) * M * (1.0 + 0.2 * M * M) ** -3, rel=1e-3)


def test_choked_velocity_is_the_speed_of_sound_at_the_throat():
    _, V, _ = flux_parameter(2.5)
    assert V[0] == pytest.approx(np.sqrt(1.4 * R * 288.15 / 1.2), rel=2e-3)


def test_the_throat_pressure_is_ambient_until_choking_and_critical_after():
    ratio = np.array([1.5, 1.88, 1.91, 4.0])
    _, _, p = flux_parameter(ratio, P=2e5)
    assert np.allclose(p[:2], 2e5 / ratio[:2], rtol=1e-14)
    assert np.allclose(p[2:], 2e5 / CRITICAL_COLD, rtol=1e-3)


def test_flow_velocity_and_throat_pressure_are_continuous_through_choking():
    f = flow(900.0, 2e5)
    critical = np.exp(f.gas.critical_log_pressure_ratio(f.T, f.mixture))[0]
    ratio = critical * (1.0 + np.array([-1e-6, 1e-6]))
    for x in flux_parameter(ratio, T=900.0):
        assert x[0] == pytest.approx(x[1], rel=3e-6)


def test_flow_rises_with_pressure_ratio_and_then_stays():
    flux, _, _ = flux_parameter(np.linspace(1.0001, 4.0, 2000))
    assert (np.diff(flux) > -1e-8 * flux.max()).all()
    assert np.ptp(flux[-1000:]) < 1e-12


def test_flow_falls_to_zero_with_the_pressure_ratio():
    flux, _, _ = flux_parameter(np.array([1.0 + 1e-12, 1.0 + 1e-5, 1.0 + 1e-4]))
    assert np.isfinite(flux).all()
    assert (np.diff(flux) > 0.0).all()
    assert flux[0] < 1e-6 * 0.04


def test_a_point_below_ambient_pressure_has_a_finite_negative_flow_for_the_iteration_to_leave():
    flux, _, _ = flux_parameter(np.array([0.9]))
    assert np.isfinite(flux).all()
    assert flux[0] < 0.0


@pytest.mark.parametrize("ratio", [1.3, 1.7, 2.2])
def test_the_throat_has_exact_derivatives_in_temperature_pressure_and_ambient_pressure(ratio):
    T, P, p0 = np.array([850.0]), np.array([2e5]), np.array([2e5 / ratio])

    def at(dT=0.0, dP=0.0, dp0=0.0):
        f = flow(T + dT, P + dP)
        return throat(f, np.log((P + dP) / (p0 + dp0)), p0 + dp0)

    Td, Pd, pd = seeds(T, P, p0)
    f = Flow(flow(T, P).gas, DRY_AIR, np.ones(1), Pd, T=Td)
    from enginediag_cli.engine.dual import log

    for k, x in enumerate(throat(f, log(Pd / pd), pd)):
        g = gradient(x, 3)
        for row, step, name in ((0, 1.0, "dT"), (1, 50.0, "dP"), (2, 50.0, "dp0")):
            numeric = fourth_order(lambda t, k=k, name=name: at(**{name: t})[k], step)
            scale = abs(value(x)[0]) / (T, P, p0)[row][0]
            assert g[row] == pytest.approx(numeric, rel=1e-6, abs=1e-6 * scale)


def nozzle(P=2.5e5, T=900.0, W=10.0, p0=101325.0, **parameters):
    part = component("nozzle", velocity_coefficient=0.98, **{"from": "7"})
    for step in (part.size, part.evaluate):
        e = evaluation([part], **(parameters if step == part.evaluate else {}))
        e.flows["7"], e.outputs["P0_Pa"] = flow(T, P, W), np.array([p0])
        step(e)
    return part, e


def test_a_sized_nozzle_meets_its_flow_and_its_area_factor_scales_it():
    _, e = nozzle()
    assert e.balances["nozzle flow"][0] == pytest.approx(0.0, abs=1e-14)
    _, e = nozzle(nozzle__area=1.02)
    assert e.balances["nozzle flow"][0] == pytest.approx(-0.02, rel=1e-10)


def test_gross_thrust_of_an_unchoked_nozzle_is_momentum_alone():
    _, e = nozzle(P=1.6e5)
    f = e.flows["7"]
    V = np.sqrt(2.0 * (f.h - f.expanded_enthalpy(np.log(1.6e5 / 101325.0))))
    assert e.outputs["gross_thrust_N"][0] == pytest.approx(10.0 * V[0] * 0.98, rel=1e-10)


def test_gross_thrust_of_a_choked_nozzle_adds_the_pressure_on_its_area():
    part, e = nozzle(P=4e5)
    flux, V, p = throat(e.flows["7"], np.log(4e5 / np.array([101325.0])), np.array([101325.0]))
    area = 10.0 / flux
    assert part.reference_area_m2 == pytest.approx(area[0], rel=1e-12)
    assert e.outputs["gross_thrust_N"][0] == pytest.approx((10.0 * V * 0.98 + area * (p - 101325.0))[0], rel=1e-12)


def test_a_design_point_below_ambient_pressure_cannot_be_sized():
    with pytest.raises(ValueError, match="below ambient"):
        nozzle(P=0.9e5)
