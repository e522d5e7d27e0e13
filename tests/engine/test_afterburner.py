"""Afterburner: off it is a duct, its heat and composition balance, Rayleigh's loss, and an engine with one."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient, operating_points
from mixed_flow import MIXED_FLOW
from standing import standing

from enginediag_cli.engine.components.combustion import burnt, find_fuel
from enginediag_cli.engine.dual import value
from enginediag_cli.engine.evaluation import static_pressure
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

LHV = 42.8e6
LIT = MIXED_FLOW.replace(
    '  - {type: nozzle, name: nozzle, from: "6"}\n',
    '  - {type: afterburner, name: afterburner, from: "6", to: "7", set_by: SET, upper_stop: 2400, inlet_mach: 0.2}\n'
    '  - {type: nozzle, name: nozzle, from: "7", opening_range: [0.8, 2.0]}\n',
)


def made(tmp_path, text, name="engine"):
    path = tmp_path / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path)


def burning(quantity="fuel_kg_s", setting=0.0, wrt=(), sized=True, T=900.0, P=3e5, W=50.0, far=0.02, **options):
    set_by = {"fuel_kg_s": "fuel_flow", "exit_temperature_K": "exit_temperature"}.get(quantity, quantity)
    part = component("afterburner", to="7", set_by=set_by, upper_stop=2300.0, **{"from": "6"}, **options)
    for step in (part.size, part.evaluate) if sized else (part.evaluate,):
        given = {f"afterburner__{quantity}": setting} if step == part.evaluate else {}
        e = evaluation([part], size=np.size(W), wrt=wrt if step == part.evaluate else (), **given)
        e.flows["6"], e.outputs["Wf_kg_s"] = flow(T, P, W, far=far), 0.5
        step(e)
    return part, e


@pytest.mark.parametrize("quantity", ["fuel_kg_s", "fuel_air_ratio", "exit_temperature_K"])
@pytest.mark.parametrize("mach", [None, 0.25])
def test_off_it_is_a_duct_with_its_loss_to_the_last_digit(quantity, mach):
    _, e = burning(quantity, 0.0, pressure_loss=0.04, inlet_mach=mach)
    before, behind = e.flows["6"], e.flows["7"]
    assert behind.P[0] == before.P[0] * (1.0 - 0.04)
    assert behind.h[0] == before.h[0] and behind.W[0] == before.W[0]
    assert behind.mixture.far[0] == before.mixture.far[0]
    assert np.all(e.outputs["afterburner_fuel_kg_s"] == 0.0)


def test_its_heat_balance_and_its_fuel_are_those_of_the_books():
    _, e = burning(setting=1.6, combustion_efficiency=0.92)
    before, behind = e.flows["6"], e.flows["7"]
    assert behind.W[0] == pytest.approx(51.6, rel=1e-14)
    assert behind.W[0] * behind.h[0] == pytest.approx(50.0 * before.h[0] + 1.6 * 0.92 * LHV, rel=1e-13)
    dry = 50.0 / 1.02
    assert behind.mixture.far[0] == pytest.approx(0.02 + 1.6 / dry, rel=1e-13)
    assert (e.outputs["Wf_total_kg_s"], e.outputs["Wf_kg_s"]) == (2.1, 0.5)


def test_burning_twice_is_burning_once():
    air = flow(700.0, 1e6, 50.0)
    once = burnt(air, np.array([2.0]), LHV, air.P)
    twice = burnt(burnt(air, np.array([1.2]), LHV, air.P), np.array([0.8]), LHV, air.P)
    assert twice.mixture.far[0] == pytest.approx(once.mixture.far[0], rel=1e-14)
    assert twice.T[0] == pytest.approx(once.T[0], rel=1e-12)


@pytest.mark.parametrize("wanted", [1200.0, 1700.0, 2100.0])
def test_the_fuel_of_an_exit_temperature_gives_it(wanted):
    _, e = burning("exit_temperature_K", wanted, far=0.015)
    assert e.flows["7"].T[0] == pytest.approx(wanted, abs=1e-6)


def test_an_exit_temperature_below_that_of_the_gas_needs_no_fuel():
    _, e = burning("exit_temperature_K", 850.0)
    assert e.outputs["afterburner_fuel_kg_s"][0] == 0.0


def test_fuel_over_air_is_over_the_dry_air_that_enters():
    _, e = burning("fuel_air_ratio", 0.03)
    assert e.outputs["afterburner_fuel_kg_s"][0] == pytest.approx(0.03 * 50.0 / 1.02, rel=1e-14)
    assert e.flows["7"].mixture.far[0] == pytest.approx(0.05, rel=1e-13)


def test_more_fuel_than_the_air_can_burn_is_marked():
    for far, marked in ((0.04, False), (0.05, True)):
        _, e = burning("fuel_air_ratio", far)
        assert {what: bool(m.any()) for what, m in e.outside.items()} == {
            "what the air of afterburner can burn": marked
        }


def test_heating_in_a_constant_area_conserves_momentum():
    part, e = burning(setting=1.6, inlet_mach=0.25, pressure_loss=0.02)
    cold = e.flows["6"].replace(P=e.flows["6"].P * 0.98)
    p1, V1 = static_pressure(cold, part.area_m2)
    p2, V2 = static_pressure(e.flows["7"], part.area_m2)
    W2 = e.flows["7"].W
    assert (50.0 * V1 + p1 * part.area_m2)[0] == pytest.approx((W2 * V2 + p2 * part.area_m2)[0], rel=1e-10)
    cp, R = GAS.heat_capacity(cold.T, cold.mixture), cold.R
    T_s = cold.T - 0.5 * V1**2 / cp
    assert (V1 / np.sqrt(cp / (cp - R) * R * T_s))[0] == pytest.approx(0.25, rel=1e-3)


def test_the_loss_by_heating_is_that_of_rayleigh_s_line():
    """Total pressures of a perfect gas from M 0.2 to where W² R T is that behind the flame."""
    _, e = burning(setting=0.9, T=300.0, far=None, W=50.0, inlet_mach=0.2, pressure_loss=0.0)
    ratio = (e.flows["7"].P / e.flows["6"].P)[0]
    before, behind = e.flows["6"], e.flows["7"]
    g = 1.37  # between that of cold air and that of the burnt gas

    def heat(M):
        return 2.0 * (g + 1.0) * M**2 / (1.0 + g * M**2) ** 2 * (1.0 + 0.5 * (g - 1.0) * M**2)

    def pressure(M):
        return (g + 1) / (1 + g * M**2) * ((1.0 + 0.5 * (g - 1) * M**2) * 2.0 / (g + 1)) ** (g / (g - 1))

    from scipy.optimize import brentq

    added = (behind.W * behind.R * behind.T * behind.W / (before.W * before.R * before.T * before.W))[0]
    M2 = brentq(lambda M: heat(M) / heat(0.2) - added, 0.2, 0.99)
    assert 1.0 - ratio == pytest.approx(1.0 - pressure(M2) / pressure(0.2), rel=0.03)


def test_heat_that_chokes_the_area_is_no_number():
    _, e = burning(setting=2.0, inlet_mach=0.5, far=None)
    assert np.isnan(e.flows["7"].P[0])


@pytest.mark.parametrize(
    ("quantity", "setting"), [("fuel_kg_s", 1.3), ("fuel_air_ratio", 0.025), ("exit_temperature_K", 1800.0)]
)
def test_its_derivatives_match_differences(quantity, setting):
    names = {
        f"afterburner.{quantity}": setting,
        "afterburner.efficiency": 1.0,
        "afterburner.pressure_loss": 0.03,
        "afterburner.lower_heating_value_J_kg": LHV,
    }
    part, _ = burning(quantity, setting, inlet_mach=0.22)

    def run(values, wrt=()):
        e = evaluation([part], wrt=wrt, **{n.replace(".", "__"): v for n, v in values.items()})
        e.flows["6"], e.outputs["Wf_kg_s"] = flow(900.0, 3e5, 50.0, far=0.02), 0.5
        part.evaluate(e)
        return [e.flows["7"].P, e.flows["7"].T, e.outputs["afterburner_fuel_kg_s"]], e

    exact, e = run(names, tuple(names))
    for name, at in names.items():
        if name not in e.directions:
            continue
        for k, x in enumerate(exact):

            def moved(t, name=name, k=k):
                return np.ravel(run({**names, name: names[name] * (1.0 + t)})[0][k])[0]

            numeric = fourth_order(moved, 1e-3)
            g = gradient(x, len(e.directions))[e.directions[name]][0] * at
            assert g == pytest.approx(numeric, rel=1e-6, abs=1e-9 * abs(value(x)[0])), (name, k)


def test_the_fuel_of_an_afterburner_that_is_off_has_a_derivative():
    part, _ = burning(inlet_mach=0.22)
    e = evaluation([part], wrt=("afterburner.fuel_kg_s",), afterburner__fuel_kg_s=0.0)
    e.flows["6"], e.outputs["Wf_kg_s"] = flow(900.0, 3e5, 50.0, far=0.02), 0.5
    part.evaluate(e)
    assert gradient(e.flows["7"].T, 1)[0][0] > 100.0
    assert gradient(e.flows["7"].P, 1)[0][0] < 0.0


def test_a_design_point_may_be_lit():
    part, _ = burning(exit_temperature_K=1900.0, inlet_mach=0.2)
    e = evaluation([part])
    e.flows["6"], e.outputs["Wf_kg_s"] = flow(900.0, 3e5, 50.0, far=0.02), 0.5
    part.size(e)
    assert e.flows["7"].T[0] == pytest.approx(1900.0, abs=1e-6)


def test_a_design_point_that_cannot_be_lit_is_told():
    with pytest.raises(ValueError, match="above its exit_temperature_K"):
        burning(exit_temperature_K=850.0)
    with pytest.raises(ValueError, match="stoichiometric"):
        burning(exit_temperature_K=2350.0, far=0.035)


# an engine with one

COLUMNS = ("N1_rpm", "N2_rpm", "T3_K", "P3_Pa", "T5_K", "Fn_N", "W2_kg_s")


def test_an_engine_whose_afterburner_is_off_is_one_with_a_duct_to_the_last_digit(tmp_path):
    lit = made(tmp_path, LIT.replace("SET", "fuel_flow"))
    duct = MIXED_FLOW.replace(
        '  - {type: nozzle, name: nozzle, from: "6"}\n',
        '  - {type: duct, name: duct, from: "6", to: "7", pressure_loss: 0.03}\n'
        '  - {type: nozzle, name: nozzle, from: "7"}\n',
    )
    dry = made(tmp_path, duct, "dry")
    U = operating_points(dry, 30, 3, altitude=(0.0, 10000.0), mach=(0.2, 0.8), power=(0.4, 1.0))
    a, b = lit.predict(U, sensors=COLUMNS), dry.predict(U, sensors=COLUMNS)
    assert b.status.max() == 0
    assert np.array_equal(a.y, b.y)


@pytest.mark.parametrize("mach", [0.2, 0.8])
def test_a_lit_engine_conserves_energy_and_counts_all_fuel(tmp_path, mach):
    engine = standing(made(tmp_path, LIT.replace("SET", "exit_temperature")), afterburner__exit_temperature_K=1900.0)
    engine = standing(engine, nozzle__opening=1.5)
    U = {"altitude_m": np.array([0.0, 6000.0]), "mach": mach, "dT_isa_K": 0.0}
    U["Wf_kg_s"] = engine.power_from_fraction(0.9, U)
    columns = ("W6_kg_s", "T6_K", "FAR6", "W7_kg_s", "T7_K", "FAR7", "Wf_kg_s", "Wf_total_kg_s", "SFC_kg_Ns", "Fn_N")
    p = engine.predict(U, sensors=columns)
    assert p.status.max() == 0, p.reason(0)
    W6, T6, far6, W7, T7, far7, fuel, total, sfc, thrust = p.y.T
    from enginediag_cli.engine.gas import Mixture

    h6, h7 = GAS.enthalpy(T6, Mixture(far6)), GAS.enthalpy(T7, Mixture(far7))
    assert np.allclose(T7, 1900.0, atol=1e-6)
    assert np.allclose(W7 * h7, W6 * h6 + (total - fuel) * 0.9 * LHV, rtol=1e-9)
    assert np.allclose(W7, W6 + total - fuel, rtol=1e-12)
    assert np.allclose(sfc, total / thrust, rtol=1e-14)
    assert np.allclose(fuel, U["Wf_kg_s"], rtol=1e-12)


def test_an_afterburner_is_not_watched_unless_asked(tmp_path):
    engine = made(tmp_path, LIT.replace("SET", "fuel_flow"))
    assert not any(name.startswith("afterburner") for name in engine.monitored)
    assert "afterburner.efficiency" in engine.parameters


def test_sequential_combustion_is_a_burner_between_two_turbines(tmp_path):
    text = MIXED_FLOW.replace(
        '  - {type: turbine, name: lpt, from: "45",',
        '  - {type: afterburner, name: second, from: "45", to: "46", exit_temperature_K: 1350, '
        "combustion_efficiency: 0.995, set_by: fuel_flow, upper_stop: 1}\n"
        '  - {type: turbine, name: lpt, from: "46",',
    ).replace("pressure_ratio: 2.5", "pressure_ratio: 3.2")
    engine = standing(made(tmp_path, text), second__fuel_kg_s=0.25)
    U = {"altitude_m": 0.0, "mach": 0.3, "dT_isa_K": 0.0}
    U["Wf_kg_s"] = engine.power_from_fraction(0.9, U)
    p = engine.predict(U, sensors=("T45_K", "T46_K", "FAR46", "FAR45", "second_fuel_kg_s"))
    assert p.status[0] == 0, p.reason(0)
    assert p.y[0, 1] > p.y[0, 0] + 100.0 and p.y[0, 2] > p.y[0, 3] and p.y[0, 4] == 0.25


def test_its_actuator_has_a_stop_that_a_fuel_flow_must_state():
    found = {}
    for set_by in ("fuel_air_ratio", "exit_temperature"):
        (a,) = component("afterburner", to="7", set_by=set_by, **{"from": "6"}).actuators()
        found[a.name] = (a.neutral, a.lower, a.upper)
    assert found == {
        "afterburner.fuel_air_ratio": (0.0, 0.0, 0.07),
        "afterburner.exit_temperature_K": (0.0, 0.0, 2400.0),
    }
    with pytest.raises(ValueError, match="needs an upper_stop"):
        component("afterburner", to="7", set_by="fuel_flow", **{"from": "6"})


def test_an_afterburner_before_the_burner_and_two_burners_are_refused(tmp_path):
    second = '  - {type: burner, name: second, from: "6", to: "7", exit_temperature_K: 1500}\n'
    text = MIXED_FLOW.replace('  - {type: nozzle, name: nozzle, from: "6"}\n', second)
    with pytest.raises(ConfigError, match="exactly one burner"):
        made(tmp_path, text)
    first = MIXED_FLOW.replace(
        '  - {type: splitter, name: splitter, from: "21"',
        '  - {type: afterburner, name: early, from: "21", to: "22"}\n  - {type: splitter, name: splitter, from: "22"',
    )
    with pytest.raises(ConfigError, match="behind the burner"):
        made(tmp_path, first)


FLOWN = ("Fn_N", "T7_K", "Wf_total_kg_s", "N1_rpm", "T5_K")
SUPERSONIC = LIT.replace("SET", "fuel_air_ratio").replace(
    'type: nozzle, name: nozzle, from: "7",', 'type: condi_nozzle, name: nozzle, from: "7", area_ratio: 1.3,'
)


def test_sensitivities_of_a_lit_engine_match_differences_of_full_solves(tmp_path):
    engine = standing(made(tmp_path, SUPERSONIC), afterburner__fuel_air_ratio=0.02, nozzle__opening=1.4)
    U = operating_points(engine, 20, 4, altitude=(0.0, 10000.0), mach=(0.3, 0.9), power=(0.6, 1.0))
    names = ("afterburner.efficiency", "afterburner.pressure_loss", "nozzle.area", "lpt.efficiency")
    p = engine.predict(U, wrt=names, sensors=FLOWN)
    assert p.status.max() == 0
    step = 1e-3
    for k, name in enumerate(names):

        def moved(t, name=name):
            return engine.predict(U, {name: engine.parameters[name].nominal * (1.0 + t)}, start=p.x, sensors=FLOWN).y

        numeric = (moved(-2 * step) - 8 * moved(-step) + 8 * moved(step) - moved(2 * step)) / (12 * step)
        error = np.abs(p.jacobian[:, :, k] * engine.parameters[name].nominal - numeric).max(axis=0)
        assert (error <= 1e-6 * np.abs(numeric).max(axis=0) + 1e-9 * np.abs(p.y).max(axis=0)).all(), name


@pytest.mark.parametrize(("ratio", "opening"), [(0.0, 1.0), (0.015, 1.3), (0.03, 1.6)])
def test_a_thousand_points_of_the_envelope_all_converge(tmp_path, ratio, opening):
    engine = standing(made(tmp_path, SUPERSONIC), afterburner__fuel_air_ratio=ratio, nozzle__opening=opening)
    U = operating_points(engine, 1000, 5, altitude=(0.0, 10000.0), mach=(0.2, 0.9), power=(0.3, 1.0))
    p = engine.predict(U, sensors=FLOWN)
    assert p.status.max() == 0, p.reason(int(p.status.argmax()))


def test_the_fuel_of_a_row_does_not_depend_on_how_long_others_take():
    wanted, T = np.linspace(800.0, 2200.0, 40), np.linspace(1100.0, 700.0, 40)

    def needed(wanted, T):
        return find_fuel(flow(T, 3e5, np.full(40, 50.0), far=np.full(40, 0.02)), wanted, LHV)

    whole = needed(wanted, T)
    for k in range(0, 40, 7):
        assert whole[k] == needed(np.full(40, wanted[k]), np.full(40, T[k]))[k]
