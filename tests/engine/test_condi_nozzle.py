"""Convergent–divergent nozzle against the gas tables of γ = 1.4, through its regimes, and in an engine."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import component, evaluation, flow, fourth_order, gradient, operating_points
from mixed_flow import MIXED_FLOW
from scipy.optimize import brentq

from enginediag_cli.engine.dual import value
from enginediag_cli.physics.engine_file import load_engine

P0 = 20000.0  # of a cold nozzle, so that γ = 1.4 holds in what it expands to
R = 287.05


def area_ratio(M):
    return ((1.0 + 0.2 * M * M) / 1.2) ** 3 / M


def pressure_ratio(M):
    return (1.0 + 0.2 * M * M) ** 3.5


def run(npr, T=320.0, sized_at=8.0, wrt=(), kind="condi_nozzle", leaves=None, **options):
    """A nozzle of 10 kg/s at design, and what it does at a pressure ratio (N,) with the flow that then passes."""
    part = component(kind, **{"from": "7"}, **options)
    e = evaluation([part])
    e.flows["7"], e.outputs["P0_Pa"] = flow(T, P0 * sized_at, 10.0), np.array([P0])
    part.size(e)
    npr = np.atleast_1d(np.asarray(npr, dtype=float))
    e = evaluation([part], size=npr.size, wrt=wrt, **(leaves or {}))
    e.flows["7"] = flow(np.full(npr.size, T), P0 * npr, np.full(npr.size, 10.0))
    e.outputs["P0_Pa"] = np.full(npr.size, P0)
    part.evaluate(e)
    passing = 10.0 * (1.0 - e.balances[f"{part.name} flow"])  # kg/s
    return part, e, passing


def thrust(npr, **options):
    """Gross thrust (N,) with the flow that passes."""
    part, _, W = run(npr, **options)
    e = evaluation([part], size=np.size(npr))
    T = options.get("T", 320.0)
    e.flows["7"], e.outputs["P0_Pa"] = (
        flow(np.full(np.size(npr), T), P0 * np.asarray(npr), value(W)),
        np.full(np.size(npr), P0),
    )
    part.evaluate(e)
    assert np.allclose(e.balances[f"{part.name} flow"], 0.0, atol=1e-12)
    return e.outputs["gross_thrust_N"], e


@pytest.mark.parametrize("M", [1.3, 1.8, 2.2])
def test_full_expansion_has_the_exit_mach_number_and_area_of_the_tables(M):
    npr = pressure_ratio(M)
    F, e = thrust(np.array([npr]))
    assert e.outputs["condi_nozzle_area_ratio"][0] == pytest.approx(area_ratio(M), rel=3e-3)
    V = M * np.sqrt(1.4 * R * 320.0 / (1.0 + 0.2 * M * M))
    assert F[0] / value(e.flows["7"].W)[0] == pytest.approx(V, rel=2e-3)


@pytest.mark.parametrize("npr", [3.0, 8.0, 14.0])
def test_a_fixed_exit_is_under_or_over_expanded_as_the_tables_say(npr):
    eps = 1.6
    M = brentq(lambda M: area_ratio(M) - eps, 1.01, 4.0)
    F, e = thrust(np.array([npr]), area_ratio=eps)
    W = value(e.flows["7"].W)[0]
    T_e = 320.0 / (1.0 + 0.2 * M * M)
    V = M * np.sqrt(1.4 * R * T_e)
    p = P0 * npr / pressure_ratio(M)
    A_e = W * R * T_e / (p * V)
    assert F[0] == pytest.approx(W * V + A_e * (p - P0), rel=2e-3)


def test_full_expansion_is_the_largest_thrust_of_all_exits():
    npr = np.array([8.0])
    best, _ = thrust(npr)
    M = np.sqrt(5.0 * (8.0 ** (1 / 3.5) - 1.0))
    for off in (0.7, 0.9, 1.1, 1.4):
        other, _ = thrust(npr, area_ratio=area_ratio(M) * off)
        assert other[0] < best[0]
    near, _ = thrust(npr, area_ratio=area_ratio(M) * 1.002)
    assert near[0] == pytest.approx(best[0], rel=1e-4)


def test_a_shock_inside_leaves_the_exit_of_the_normal_shock_tables():
    """ε = 1.6, a normal shock at the area ratio of M = 1.5: exit pressure by the tables."""
    Ms, eps = 1.5, 1.6
    loss = (1.2 * Ms**2 / (1 + 0.2 * Ms**2)) ** 3.5 * (1.0 / (7.0 / 6.0 * Ms**2 - 1.0 / 6.0)) ** 2.5
    Me = brentq(lambda M: area_ratio(M) - eps * loss, 0.05, 0.999)
    npr = pressure_ratio(Me) / loss
    F, e = thrust(np.array([npr]), area_ratio=eps)
    V = Me * np.sqrt(1.4 * R * 320.0 / (1.0 + 0.2 * Me**2))
    assert F[0] == pytest.approx(value(e.flows["7"].W)[0] * V, rel=3e-3)


def test_the_shock_leaves_the_exit_where_the_tables_say():
    eps = 1.6
    M = brentq(lambda M: area_ratio(M) - eps, 1.01, 4.0)
    leaving = pressure_ratio(M) / (7.0 / 6.0 * M * M - 1.0 / 6.0)  # p_0 behind a normal shock at the exit
    npr = np.linspace(0.9 * leaving, 1.1 * leaving, 2001)
    _, e, _ = run(npr, area_ratio=eps)
    part = component("condi_nozzle", area_ratio=eps, **{"from": "7"})
    found = part._expanded(e.flows["7"], np.log(npr), e.outputs["P0_Pa"]).excess_Pa
    assert npr[np.flatnonzero(found != 0.0)[0]] == pytest.approx(leaving, rel=5e-3)


def test_a_throat_that_does_not_choke_is_a_venturi():
    """Below the pressure ratio of the subsonic solution the exit's area passes the flow, isentropic."""
    eps = 1.6
    M = brentq(lambda M: area_ratio(M) - eps, 0.05, 0.999)
    limit = pressure_ratio(M)
    W = run(np.array([limit * 0.99, limit * 1.01, 1.8, 6.0]), area_ratio=eps)[2]
    per_pressure = value(W) / np.array([limit * 0.99, limit * 1.01, 1.8, 6.0])
    assert per_pressure[0] < per_pressure[1] * 0.999
    assert np.allclose(per_pressure[1:], per_pressure[1], rtol=1e-9)
    low = np.array([1.05])
    a = run(low, area_ratio=eps)[0].reference_area_m2
    M = np.sqrt(5.0 * (1.05 ** (1.0 / 3.5) - 1.0))
    expected = eps * a * 1.05 * P0 * np.sqrt(1.4 / (R * 320.0)) * M * (1 + 0.2 * M * M) ** -3
    assert value(run(low, area_ratio=eps)[2])[0] == pytest.approx(expected, rel=2e-3)


def test_thrust_and_flow_are_continuous_through_all_regimes():
    npr = np.linspace(1.02, 9.0, 20001)
    F, e = thrust(npr, area_ratio=1.5)
    assert np.abs(np.diff(F)).max() < 4.0 * np.median(np.abs(np.diff(F)))
    assert (np.diff(value(e.flows["7"].W)) > -1e-12).all()


def test_hardly_divergent_it_is_a_convergent_nozzle():
    npr = np.array([1.3, 1.7, 2.5])
    a, _ = thrust(npr, area_ratio=1.01)
    b, _ = thrust(npr, kind="nozzle")
    assert a == pytest.approx(b, rel=0.02)


def test_below_choking_an_ideal_exit_is_a_convergent_nozzle_to_the_last_digit():
    npr = np.array([1.1, 1.5, 1.85])
    a, e = thrust(npr)
    b, _ = thrust(npr, kind="nozzle")
    assert np.array_equal(a, b)
    assert np.array_equal(e.outputs["condi_nozzle_area_ratio"], np.ones(3))


def test_an_exit_that_opens_only_so_far_is_under_expanded_beyond():
    npr = np.array([3.0, 12.0])
    limited, e = thrust(npr, largest_area_ratio=1.3)
    free, _ = thrust(npr)
    fixed, _ = thrust(npr, area_ratio=1.3)
    assert limited[0] == free[0]
    assert limited[1] == pytest.approx(fixed[1], rel=1e-12)
    assert e.outputs["condi_nozzle_area_ratio"][1] == 1.3


def test_the_coefficients_are_on_velocity_and_on_thrust():
    npr = np.array([12.0])
    F, e = thrust(npr, area_ratio=1.4)
    with_v, _ = thrust(npr, area_ratio=1.4, velocity_coefficient=0.98)
    with_f, _ = thrust(npr, area_ratio=1.4, thrust_coefficient=0.98)
    assert with_f[0] == pytest.approx(0.98 * F[0], rel=1e-14)
    part = component("condi_nozzle", area_ratio=1.4, **{"from": "7"})
    V = part._expanded(e.flows["7"], np.log(npr), e.outputs["P0_Pa"]).V
    assert F[0] - with_v[0] == pytest.approx(0.02 * (value(e.flows["7"].W) * V)[0], rel=1e-10)


def test_fixed_and_limited_at_once_is_refused():
    with pytest.raises(ValueError, match="give one"):
        component("condi_nozzle", area_ratio=1.4, largest_area_ratio=1.6, **{"from": "7"})


@pytest.mark.parametrize("options", [{"area_ratio": 1.5}, {}, {"largest_area_ratio": 1.2}])
@pytest.mark.parametrize("npr", [1.05, 1.6, 2.4, 9.0])
def test_its_derivatives_match_differences(options, npr):
    from enginediag_cli.engine.dual import Dual, log
    from enginediag_cli.engine.evaluation import Flow

    part = component("condi_nozzle", **{"from": "7"}, **options)
    at = {"T": 900.0, "P": npr * P0, "p0": P0}

    def expanded(T, P, p0):
        made = Flow(flow(1.0, 1.0).gas, flow(1.0, 1.0).mixture, np.ones(1), P, T=T)
        return part._expanded(made, log(P / p0), p0)

    seeded = {}
    for k, (name, x) in enumerate(at.items()):
        d = np.zeros((k + 1, 1))
        d[k] = 1.0
        seeded[name] = Dual(np.array([x]), d)
    exact = expanded(**seeded)
    for k, name in enumerate(at):
        for which in ("flux", "V", "excess_Pa", "area_ratio"):

            def moved(t, name=name, which=which):
                there = {n: np.array([x * (1.0 + t * (n == name))]) for n, x in at.items()}
                return np.ravel(value(getattr(expanded(**there), which)))[0]

            x = getattr(exact, which)
            g = gradient(x, 3)[k][0] * at[name] if np.size(value(x)) else 0.0
            scale = abs(np.ravel(value(x))[0])
            assert g == pytest.approx(fourth_order(moved, 1e-3), rel=1e-6, abs=1e-8 * scale + 1e-9), (name, which)


@pytest.mark.parametrize("keys", ["area_ratio: 1.3", "largest_area_ratio: 1.4", ""])
def test_an_engine_flies_with_it(tmp_path, keys):
    path = tmp_path / "engine.yaml"
    given = f", {keys}" if keys else ""
    nozzle = f'{{type: condi_nozzle, name: nozzle, from: "6"{given}}}'
    path.write_text(MIXED_FLOW.replace('{type: nozzle, name: nozzle, from: "6"}', nozzle), encoding="utf-8")
    engine = load_engine(path)
    U = operating_points(engine, 60, 3, altitude=(0.0, 10000.0), mach=(0.2, 0.8), power=(0.3, 1.0))
    p = engine.predict(U, wrt=("nozzle.area", "lpt.efficiency"), sensors=("Fn_N", "nozzle_area_ratio"))
    assert p.status.max() == 0
    assert np.isfinite(p.jacobian).all()


@pytest.mark.parametrize("options", [{"area_ratio": 1.5}, {"largest_area_ratio": 1.2}])
def test_a_row_does_not_depend_on_how_long_others_take(options):
    part = component("condi_nozzle", **{"from": "7"}, **options)
    npr, T = np.linspace(1.05, 12.0, 40), np.linspace(300.0, 2000.0, 40)

    def expanded(npr, T):
        found = part._expanded(flow(T, P0 * npr), np.log(npr), np.full(40, P0))
        return np.array([np.broadcast_to(x, (40,)) for x in (found.flux, found.V, found.excess_Pa)])

    whole = expanded(npr, T)
    for k in range(0, 40, 7):
        among_its_like = expanded(np.full(40, npr[k]), np.full(40, T[k]))
        assert np.array_equal(whole[:, k], among_its_like[:, k])
