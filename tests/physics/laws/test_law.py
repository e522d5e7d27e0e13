"""Laws in engine files: an effect that no library holds, by a formula."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.components.base import scalar
from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.errors import ConfigError
from enginediag_cli.identification.identify import identify
from enginediag_cli.identification.problem import IdentificationSettings, TrainingRecording
from enginediag_cli.physics.engine_file import load_engine

CONFIGS = Path(__file__).parents[3] / "configs"
ENGINES = ("turbofan", "turbojet", "turboshaft", "power_plant", "naval_gas_generator")
THIN_AIR = """
  - law: thin_air
    at: {at}.efficiency
    expression: -loss * (reynolds_index_{station} ** -n - 1)
    coefficients:
      n: {{value: 0.1, absent: 0, lower: 0, upper: 0.3, prior_sigma: 0.1}}
      loss: {{value: {loss!r}}}
"""
DROOP = """
  - law: droop
    at: {at}.efficiency
    expression: a * ln(power) + b * (compressor_pressure - 1) ** 2
    coefficients:
      a: {{value: 0.05, absent: 0, prior_sigma: 0.02}}
      b: {{value: -0.3, absent: 0, prior_sigma: 0.3}}
"""
HOT = """
  - law: hot_streak
    at: {at}
    expression: a * (power - 1)
    coefficients:
      a: {{value: 12, unit: K, absent: 0, lower: 0, upper: 60, prior_sigma: 20}}
"""


def carrying(name: str, block: str) -> Engine:
    path = CONFIGS / f"{name}.yaml"
    text = path.read_text(encoding="utf-8")
    assert "\nphysics:" not in text
    return load_engine(EngineDescription(str(path), f"{text}\nphysics:{block}", {}))


def points(engine: Engine, n: int, seed: int = 0) -> dict[str, np.ndarray]:
    r = np.random.default_rng(seed)
    u = {c: r.uniform(*engine.envelope[c], n) for c in engine.inputs if c in engine.envelope}
    u[engine.power_setting] = engine.power_from_fraction(r.uniform(0.4, 1.0, n), u)
    return u


def compressor(engine: Engine) -> tuple[str, str, float]:
    """Name, inlet station and losses of the last one."""
    c = [c for c in engine.network.components if c.TYPE == "compressor"][-1]
    return c.name, c.values["from"], 1.0 / c.values["isentropic_efficiency"] - 1.0


@pytest.mark.parametrize("name", ENGINES)
def test_a_law_and_the_term_that_says_the_same_give_the_same_numbers(name: str) -> None:
    at, station, loss = compressor(load_engine(CONFIGS / f"{name}.yaml"))
    law = carrying(name, THIN_AIR.format(at=at, station=station, loss=loss))
    term = carrying(name, f"\n  - {{term: reynolds_efficiency, at: {at}, coefficients: {{exponent: 0.1}}}}\n")
    u = points(law, 60)
    one = law.predict(u, wrt=(f"thin_air.{at}.efficiency.n", f"{at}.flow_capacity"))
    other = term.predict(u, wrt=(f"reynolds_efficiency.{at}.exponent", f"{at}.flow_capacity"))
    assert one.ok.all()
    assert np.allclose(one.y, other.y, rtol=1e-13)
    assert np.allclose(one.jacobian, other.jacobian, rtol=1e-9, atol=1e-12 * np.abs(other.jacobian).max())


@pytest.mark.parametrize("name", ENGINES)
def test_what_lies_down_the_gas_path_is_solved_for_and_derivatives_are_exact(name: str) -> None:
    at, _, _ = compressor(load_engine(CONFIGS / f"{name}.yaml"))
    engine = carrying(name, DROOP.format(at=at))
    u = points(engine, 40)
    names = (f"droop.{at}.efficiency.a", f"droop.{at}.efficiency.b", f"{at}.efficiency")
    p = engine.predict(u, wrt=names)
    assert p.ok.all()
    for j, parameter in enumerate(names):
        nominal = engine.parameters[parameter].nominal
        h = 1e-3 * abs(nominal)
        y = {k: engine.predict(u, {parameter: nominal + k * h}).y for k in (-2, -1, 1, 2)}
        D = (8.0 * (y[1] - y[-1]) - (y[2] - y[-2])) / (12.0 * h)
        size = np.abs(p.jacobian[:, :, j]).max(axis=0)
        assert (np.abs(D - p.jacobian[:, :, j]) <= 1e-6 * size + 1e-12).all(), parameter


def test_a_law_takes_what_its_formula_says_of_the_solution_itself() -> None:
    at, _, _ = compressor(load_engine(CONFIGS / "turbofan.yaml"))
    engine = carrying("turbofan", DROOP.format(at=at))
    u = points(engine, 50)
    solved = engine.predict(u, sensors=("T4_K", "T2_K", "P3_Pa"))
    design = engine.network.design_point
    assert design is not None
    T4, T2, P3 = solved.y.T
    power = (T4 / T2) / scalar(design.flows["4"].T / design.flows["2"].T)
    pressure = P3 / scalar(design.flows["3"].P)
    f = 0.05 * np.log(power) - 0.3 * (pressure - 1.0) ** 2
    plain = load_engine(CONFIGS / "turbofan.yaml")
    assert np.allclose(plain.predict(u, {f"{at}.efficiency": 1.0 + f}).y, engine.predict(u).y, rtol=1e-9)


@pytest.mark.parametrize("block", [THIN_AIR, DROOP])
def test_an_absent_law_changes_nothing(block: str) -> None:
    plain = load_engine(CONFIGS / "turbojet.yaml")
    at, station, loss = compressor(plain)
    engine = carrying("turbojet", block.format(at=at, station=station, loss=loss))
    u = points(plain, 60)
    absent = {n: 0.0 for e in engine.effects for n in e.sizes}
    assert np.allclose(engine.predict(u, absent).y, plain.predict(u).y, rtol=1e-11)


def test_a_reading_is_moved_in_its_own_unit_and_the_engine_is_not() -> None:
    engine, plain = carrying("turbofan", HOT.format(at="T45_K")), load_engine(CONFIGS / "turbofan.yaml")
    u = points(plain, 50)
    off = engine.predict(u).y - plain.predict(u).y
    at = list(plain.sensors).index("T45_K")
    assert np.abs(np.delete(off, at, axis=1)).max() == 0.0
    assert (off[:, at] < 0.0).any()  # at low power the streak is colder


def test_a_switched_law_is_there_where_it_is_on() -> None:
    block = HOT.format(at="T45_K").rstrip() + "\n    switch: lit\n"
    engine, plain = carrying("turbofan", block), load_engine(CONFIGS / "turbofan.yaml")
    u = points(plain, 40)
    on = np.arange(40) % 2
    off = np.abs(engine.predict({**u, "lit": on.astype(float)}).y - plain.predict(u).y).max(axis=1)
    assert (off[on == 0] == 0.0).all() and (off[on == 1] > 0.0).all()


def test_identification_finds_the_coefficients_of_a_law() -> None:
    engine = carrying("turbojet", DROOP.format(at="compressor"))
    names = ("droop.compressor.efficiency.a", "droop.compressor.efficiency.b")
    r = np.random.default_rng(4)
    flights = []
    for k in range(3):
        u = points(engine, 60, seed=k)
        y = engine.predict(u, dict(zip(names, (0.03, -0.2), strict=True))).y
        noisy = {c: y[:, j] + r.normal(0.0, s.noise_sigma, 60) for j, (c, s) in enumerate(engine.sensors.items())}
        flights.append(TrainingRecording(f"flight {k}", {**u, **noisy}))
    settings = IdentificationSettings(parameters=(*names, "compressor.flow_capacity", "turbine.efficiency"))
    found = {e.name: e for e in identify(engine, flights, settings=settings).estimates}
    for name, truth in zip(names, (0.03, -0.2), strict=True):
        assert abs(found[name].value - truth) < 3.0 * found[name].standard_error < 0.2 * abs(truth) + 0.05


def bad(
    expression: str, coefficients: str = "a: {value: 0.1, absent: 0, prior_sigma: 1}", at: str = "hpc.efficiency"
) -> str:
    return f"\n  - law: it\n    at: {at}\n    expression: {expression}\n    coefficients: {{{coefficients}}}\n"


@pytest.mark.parametrize(
    ("block", "told"),
    [
        (bad("a * (powr - 1)"), "did you mean 'power'"),
        (bad("a * (power - 1)", at="hpc.eficiency"), "did you mean 'hpc.efficiency'"),
        (bad("a * power"), "where it must be 0 (there power = 1)"),
        (bad("a * (power - 1) / (power - 1)"), "no finite value at the design point"),
        (bad("a * mach * (0 - 8) ** 0.5"), "no finite value (letter 12)"),
        (bad("a * mach + mach ** 2"), "absent"),
        (bad("a * mach", "a: {value: 1, unit: K, absent: 0, prior_sigma: 1}"), "the formula is in K"),
        (bad("a * mach", at="T45_K"), "what is added at T45_K in K"),
        (bad("a * mach", "a: {value: 1}"), "no coefficient says `absent`"),
        (bad("a * mach", "a: {value: 1, absent: 0}"), "no prior_sigma"),
        (bad("a * mach", "a: {value: 2, absent: 0, upper: 1, prior_sigma: 1}"), "outside its bounds"),
        (bad("a * mach", "a: {value: 1, absent: 0, prior_sigma: 1}, b: {value: 1}"), "does not have 'b'"),
        (bad("mach.real"), "nothing else"),
        (bad("a * mach") + bad("a * mach"), "listed twice"),
        ("\n  - {at: hpc.efficiency}\n", "one of term, law says what it is"),
    ],
)
def test_a_law_that_cannot_be_says_where_and_how_to_mend(block: str, told: str) -> None:
    with pytest.raises(ConfigError) as error:
        carrying("turbofan", block)
    assert told in str(error.value)
