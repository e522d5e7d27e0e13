"""Water and steam in the gas path: enthalpy with evaporation, composition, none at all, and an engine with some."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import GAS, component, evaluation, flow, fourth_order, gradient
from recuperated import WITHOUT
from standing import standing

from enginediag_cli.engine.dual import value
from enginediag_cli.engine.gas import DRY_AIR, Mixture
from enginediag_cli.physics.engine_file import load_engine

STEAM = """\
  - {type: water_injection, name: steam, from: "35", to: "36", phase: steam, temperature_K: 600,
     largest_flow_kg_s: 0.05}
"""
ENGINE = WITHOUT.replace('from: "35", to: "4"', 'from: "36", to: "4"').replace(
    "  - {type: burner", f"{STEAM}  - {{type: burner"
)


def injected(water, T=700.0, P=1e6, W=20.0, war=None, far=None, wrt=(), **options):
    part = component("water_injection", to="31", largest_flow_kg_s=1.0, **{"from": "3"}, **options)
    e = evaluation([part], size=np.size(water), wrt=wrt, water_injection__flow_kg_s=np.atleast_1d(water))
    n = np.size(water)
    e.flows["3"] = flow(np.full(n, T), np.full(n, P), np.full(n, W), far=far, war=war)
    part.evaluate(e)
    return e


def vapour(T):
    """Enthalpy of water vapour from 298.15 K, from the gas data's mass averages."""
    T = np.atleast_1d(float(T))
    return (GAS.enthalpy(T, Mixture(war=0.5)) * 1.5 - GAS.enthalpy(T, DRY_AIR))[0] / 0.5


def test_the_heat_of_evaporation_is_that_of_the_steam_tables():
    """Air cools so that its heat evaporates 15 °C water: by hand, with c_p of air and vapour."""
    e = injected([0.2])
    T = e.flows["31"].T[0]
    air = 20.0 * (GAS.enthalpy(np.array([700.0]), DRY_AIR)[0] - GAS.enthalpy(np.array([T]), DRY_AIR)[0])
    at_15 = 2.4655e6  # J/kg to evaporate water of 288.15 K at its temperature
    warming = vapour(T) - vapour(288.15)
    assert air == pytest.approx(0.2 * (at_15 + warming), rel=1e-3)


def test_mass_and_composition_add():
    e = injected([0.4], war=0.01, far=0.02)
    out = e.flows["31"]
    dry = 20.0 / 1.03
    assert out.W[0] == pytest.approx(20.4, rel=1e-15)
    assert out.mixture.war[0] == pytest.approx(0.01 + 0.4 / dry, rel=1e-14)
    assert value(out.mixture.far)[0] == 0.02
    assert out.P[0] == 1e6


def test_steam_as_hot_as_the_gas_leaves_its_temperature():
    e = injected([0.5], phase="steam", temperature_K=700.0)
    assert e.flows["31"].T[0] == pytest.approx(700.0, abs=1e-5)


def test_water_cools_and_steam_hardly_does():
    assert injected([0.3]).flows["31"].T[0] < 660.0
    assert injected([0.3], phase="steam", temperature_K=600.0).flows["31"].T[0] > 695.0


def test_a_row_without_water_keeps_its_enthalpy_to_the_last_digit():
    e = injected([0.0, 0.3])
    assert e.flows["31"].h[0] == e.flows["3"].h[0]
    assert e.flows["31"].W[0] == 20.0


def test_more_water_than_the_air_can_hold_is_marked():
    cold = injected([0.05, 0.5], T=300.0, P=101325.0)
    assert list(cold.outside) == ["what air behind water_injection holds as vapour"]
    assert next(iter(cold.outside.values())).tolist() == [False, True]
    hot = injected([0.05, 0.5])
    assert not next(iter(hot.outside.values())).any()


def test_its_derivative_matches_differences():
    e = injected([0.3], wrt=("water_injection.flow_kg_s",))
    for read in (lambda e: e.flows["31"].T, lambda e: e.flows["31"].phi, lambda e: e.flows["31"].R):
        exact = gradient(read(e), 1)[0][0]
        assert exact == pytest.approx(fourth_order(lambda t, r=read: value(r(injected([0.3 + t])))[0], 1e-3), rel=1e-6)


def test_the_flow_has_a_derivative_where_there_is_none():
    e = injected([0.0], wrt=("water_injection.flow_kg_s",))
    assert gradient(e.flows["31"].T, 1)[0][0] < -50.0


@pytest.fixture(scope="module")
def engines(tmp_path_factory):
    folder = tmp_path_factory.mktemp("steam")
    for name, text in (("dry", WITHOUT), ("steam", ENGINE)):
        (folder / f"{name}.yaml").write_text(text, encoding="utf-8")
    return load_engine(folder / "dry.yaml"), load_engine(folder / "steam.yaml")


def points(n=30):
    rng = np.random.default_rng(2)
    return {
        "ambient_pressure_Pa": rng.uniform(85e3, 103e3, n),
        "ambient_temperature_K": rng.uniform(255.0, 313.0, n),
        "N1_rpm": rng.uniform(60000.0, 71000.0, n),
        "T4_K": rng.uniform(1100.0, 1210.0, n),
    }


def test_an_engine_without_injection_is_the_dry_one_to_the_last_digit(engines):
    dry, steam = engines
    U, columns = points(), ("T5_K", "P3_Pa", "Wf_kg_s", "power_W", "W2_kg_s")
    assert np.array_equal(dry.predict(U, sensors=columns).y, steam.predict(U, sensors=columns).y)


def test_steam_gives_power_and_energy_is_conserved(engines):
    dry, steam = engines
    columns = ("W2_kg_s", "T2_K", "W6_kg_s", "T6_K", "FAR6", "Wf_kg_s", "power_W")
    before = dry.predict(points(), sensors=columns).y
    p = standing(steam, steam__flow_kg_s=0.02).predict(points(), sensors=columns)
    assert p.status.max() == 0
    W2, T2, W6, T6, far, fuel, power = p.y.T
    assert (power > before[:, -1] * 1.03).all()
    war = 0.02 / W2
    entering = W2 * GAS.enthalpy(T2, DRY_AIR) + fuel * 0.995 * 42.8e6 + 0.02 * vapour(600.0)
    leaving = W6 * GAS.enthalpy(T6, Mixture(far, war)) + power / 0.95
    assert np.allclose(entering, leaving, atol=1e-7 * power.max())
    assert np.allclose(W6, W2 + fuel + 0.02, rtol=1e-12)
