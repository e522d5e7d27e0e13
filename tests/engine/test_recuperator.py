"""Recuperator: effectiveness by its definition and by Kays and London, limits, energy, one loop in an engine."""

from __future__ import annotations

import re

import numpy as np
import pytest
from engine_makers import GAS
from recuperated import RECUPERATED, WITHOUT

from enginediag_cli.engine.components.passages import counterflow, transfer_units
from enginediag_cli.engine.dual import Dual
from enginediag_cli.engine.gas import DRY_AIR, Mixture
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine

NTU = RECUPERATED.replace("effectiveness: 0.87", "effectiveness: 0.87, effectiveness_law: ntu")
DESIGN = {"ambient_pressure_Pa": 101325.0, "ambient_temperature_K": 288.15, "N1_rpm": 70000.0, "T4_K": 1200.0}
STATES = ("T3_K", "T35_K", "T5_K", "T6_K", "W3_kg_s", "W5_kg_s", "FAR5")


def made(tmp_path, text, name="engine"):
    path = tmp_path / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return load_engine(path)


def points(n=60, seed=1):
    rng = np.random.default_rng(seed)
    return {
        "ambient_pressure_Pa": rng.uniform(85e3, 103e3, n),
        "ambient_temperature_K": rng.uniform(255.0, 313.0, n),
        "N1_rpm": rng.uniform(48000.0, 71000.0, n),
        "T4_K": rng.uniform(1000.0, 1210.0, n),
    }


def heats(y):
    """W_c Δh of the cold side, and the most that either side could take or give (N,)."""
    T3, T35, T5, T6, W3, W5, far = y.T
    burnt = Mixture(far)

    def air(T):
        return GAS.enthalpy(T, DRY_AIR)

    taken = W3 * (air(T35) - air(T3))
    given = W5 * (GAS.enthalpy(T5, burnt) - GAS.enthalpy(T6, burnt))
    most = W3 * (air(T5) - air(T3)), W5 * (GAS.enthalpy(T5, burnt) - GAS.enthalpy(T3, burnt))
    return taken, given, most


def test_the_design_point_has_its_effectiveness_and_is_a_solution(tmp_path):
    engine = made(tmp_path, RECUPERATED)
    p = engine.predict(DESIGN, sensors=STATES)
    assert p.status[0] == 0
    taken, _, most = heats(p.y)
    assert (taken / np.minimum(*most))[0] == pytest.approx(0.87, rel=1e-9)
    assert p.x.ravel() == pytest.approx(np.ones(len(engine.unknowns)), abs=1e-9)


@pytest.mark.parametrize("text", [RECUPERATED, NTU], ids=["constant", "ntu"])
def test_what_the_gas_gives_the_air_takes(tmp_path, text):
    p = made(tmp_path, text).predict(points(), sensors=STATES)
    assert p.status.max() == 0
    taken, given, _ = heats(p.y)
    assert np.allclose(taken, given, rtol=1e-9)


def test_the_whole_engine_conserves_energy(tmp_path):
    U = points()
    columns = ("W2_kg_s", "T2_K", "W6_kg_s", "T6_K", "FAR6", "Wf_kg_s", "generator_power_W")
    W2, T2, W6, T6, far, fuel, power = made(tmp_path, RECUPERATED).predict(U, sensors=columns).y.T
    entering = W2 * GAS.enthalpy(T2, DRY_AIR) + fuel * 0.995 * 42.8e6
    leaving = W6 * GAS.enthalpy(T6, Mixture(far)) + power / 0.95
    assert np.allclose(entering, leaving, atol=1e-8 * np.abs(power).max())


def test_with_no_effectiveness_it_is_two_ducts(tmp_path):
    U, columns = points(), ("T5_K", "P3_Pa", "Wf_kg_s", "generator_power_W", "W2_kg_s")
    with_, without = made(tmp_path, RECUPERATED.replace("0.87", "0")), made(tmp_path, WITHOUT, "without")
    a, b = with_.predict(U, sensors=columns), without.predict(U, sensors=columns)
    assert a.status.max() == b.status.max() == 0
    assert np.allclose(a.y, b.y, rtol=1e-8)


def test_with_effectiveness_1_the_air_leaves_as_hot_as_the_gas_enters(tmp_path):
    p = made(tmp_path, RECUPERATED.replace("0.87", "1")).predict(points(), sensors=("T35_K", "T5_K"))
    assert p.status.max() == 0
    assert np.allclose(p.y[:, 0], p.y[:, 1], atol=1e-6)


def test_it_saves_fuel_at_nearly_the_same_power(tmp_path):
    U, columns = points(), ("Wf_kg_s", "generator_power_W")
    with_, without = made(tmp_path, RECUPERATED), made(tmp_path, WITHOUT, "without")
    a, b = (m.predict(U, sensors=columns).y for m in (with_, without))
    assert (a[:, 0] < 0.75 * b[:, 0]).all()
    assert np.allclose(a[:, 1], b[:, 1], rtol=0.05)


def test_constant_conductance_makes_effectiveness_fall_with_flow(tmp_path):
    U = {**points(3), "N1_rpm": np.array([50000.0, 60000.0, 70000.0]), "T4_K": 1150.0}
    U |= {"ambient_pressure_Pa": 101325.0, "ambient_temperature_K": 288.15}
    found = []
    for name, text in (("a", NTU), ("b", NTU.replace("law: ntu", "law: ntu, conductance_exponent: 0.8"))):
        taken, _, most = heats(made(tmp_path, text, name).predict(U, sensors=STATES).y)
        found.append(taken / np.minimum(*most))
    assert (np.diff(found[0]) < -0.005).all()
    assert (np.abs(np.diff(found[1])) < 0.5 * np.abs(np.diff(found[0]))).all()


@pytest.mark.parametrize(("ntu", "ratio", "expected"), [(1.0, 0.0, 0.632), (2.0, 1.0, 0.667), (3.0, 0.5, 0.874)])
def test_counterflow_is_that_of_kays_and_london(ntu, ratio, expected):
    assert counterflow(np.array([ntu]), np.array([ratio]))[0] == pytest.approx(expected, abs=6e-4)


@pytest.mark.parametrize("ratio", [0.3, 0.9, 0.99995, 1.0])
def test_transfer_units_are_the_inverse(ratio):
    ntu = transfer_units(0.87, ratio)
    assert counterflow(np.array([ntu]), np.array([ratio]))[0] == pytest.approx(0.87, rel=1e-10)


def test_counterflow_and_its_slope_are_continuous_where_the_series_takes_over():
    ratio = 1.0 - np.array([0.999e-3, 1.001e-3]) / 4.0
    r = Dual(ratio, np.ones((1, 2)))
    e = counterflow(np.full(2, 4.0), r)
    assert e.v[1] - e.v[0] == pytest.approx(e.d[0, 0] * (ratio[1] - ratio[0]), rel=1e-3)
    assert e.d[0, 0] == pytest.approx(e.d[0, 1], rel=1e-5)


@pytest.mark.parametrize("text", [RECUPERATED, NTU], ids=["constant", "ntu"])
def test_sensitivities_match_differences_of_full_solves(tmp_path, text):
    engine, U = made(tmp_path, text), points(20)
    names = ("recuperator.effectiveness", "recuperator.pressure_loss", "gas_side.pressure_loss", "turbine.efficiency")
    columns = ("Wf_kg_s", "T35_K", "T6_K", "generator_power_W", "P3_Pa")
    p = engine.predict(U, wrt=(*names, "T4_K"), sensors=columns)
    step = 1e-3
    for k, name in enumerate((*names, "T4_K")):

        def moved(t, name=name):
            if name in U:
                return engine.predict({**U, name: U[name] * (1.0 + t)}, start=p.x, sensors=columns).y
            return engine.predict(U, {name: engine.parameters[name].nominal * (1.0 + t)}, start=p.x, sensors=columns).y

        numeric = (moved(-2 * step) - 8 * moved(-step) + 8 * moved(step) - moved(2 * step)) / (12 * step)
        scale = U[name][:, None] if name in U else engine.parameters[name].nominal
        error = np.abs(p.jacobian[:, :, k] * scale - numeric).max(axis=0)
        assert (error <= 1e-6 * np.abs(numeric).max(axis=0)).all(), name


def test_ten_thousand_points_all_converge(tmp_path):
    p = made(tmp_path, NTU).predict(points(10_000, 5), sensors=("T5_K",))
    assert p.status.max() == 0


def test_a_recuperator_without_its_other_side_is_told(tmp_path):
    alone = RECUPERATED.replace("type: recuperator_hot, ", "type: duct, ").replace("recuperator: recuperator, ", "")
    with pytest.raises(ConfigError, match="nothing heats it"):
        made(tmp_path, alone)
    with pytest.raises(ConfigError, match="there is no recuperator 'other'"):
        made(tmp_path, RECUPERATED.replace("recuperator: recuperator,", "recuperator: other,"))


def test_gas_that_is_colder_than_the_air_cannot_heat_it(tmp_path):
    text = RECUPERATED.replace("pressure_ratio: 4.2", "pressure_ratio: 30").replace(
        "pressure_ratio: 3.7", "pressure_ratio: 25"
    )
    with pytest.raises(ConfigError, match="cannot heat the air") as raised:
        made(tmp_path, text)
    hint = raised.value.problems[0].hint
    needed = int(re.search(r"exit_temperature_K: (\d+)", hint).group(1))
    assert made(tmp_path, text.replace("exit_temperature_K: 1200", f"exit_temperature_K: {needed + 1}")).sensors
    with pytest.raises(ConfigError, match="cannot heat the air"):
        made(tmp_path, text.replace("exit_temperature_K: 1200", f"exit_temperature_K: {needed - 1}"))


def test_endless_conductance_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="endless conductance"):
        made(tmp_path, NTU.replace("0.87", "1"))
