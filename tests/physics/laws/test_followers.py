"""Laws that remember: what a formula's followers make of the past of a record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.engine.recall import MOMENT
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import load_engine
from enginediag_cli.physics.law import Expression, ExpressionError, formula_variables

TURBOJET = Path(__file__).parents[3] / "configs" / "turbojet.yaml"
SHAPES = {
    "lagged": ("t", "t: {value: 12.0, unit: s, lower: 0, prior_sigma: 10}"),
    "limited": ("t, t", "t: {value: 300.0, unit: s, lower: 0, prior_sigma: 100}"),
    "backlash": ("t", "t: {value: 0.02, lower: 0, prior_sigma: 0.02}"),
}


def carrying(expression: str, *coefficients: str, at: str = "compressor.efficiency") -> Engine:
    lines = "".join(f"      {c}\n" for c in coefficients)
    block = f"""
physics:
  - law: slow
    at: {at}
    expression: {expression}
    coefficients:
{lines}"""
    return load_engine(EngineDescription(str(TURBOJET), TURBOJET.read_text(encoding="utf-8") + block, {}))


def engine_with(name: str, size: float = 0.1) -> Engine:
    by, shape = SHAPES[name]
    text = f"a * (exp(2 * {name}(corrected_N1, {by}) - 2) - 1)"
    return carrying(text, f"a: {{value: {size}, absent: 0, prior_sigma: 0.1}}", shape)


def recording(engine: Engine, seed: int = 0) -> dict[str, np.ndarray]:
    """Two stretches with ramps of power up and down, at sea level."""
    r, N = np.random.default_rng(seed), 160
    time = np.cumsum(r.uniform(0.5, 2.0, N)) + np.where(np.arange(N) < 70, 0.0, 5000.0)
    fraction = np.interp(time - 5000.0 * (np.arange(N) >= 70), np.arange(0.0, 240.0, 12.0), r.uniform(0.4, 0.9, 20))
    columns = {"altitude_m": np.zeros(N), "mach": np.full(N, 0.1), "dT_isa_K": np.zeros(N)}
    columns[engine.power_setting] = engine.power_from_fraction(fraction, columns)
    return {"time_s": time, **columns}


def predicted(engine: Engine, columns, theta=None, wrt=(), sensors=None):
    inputs = {c: columns[c] for c in engine.inputs}
    return engine.predict({**inputs, MOMENT: engine.tapes.add(columns)}, theta or {}, wrt=wrt, sensors=sensors)


def test_a_sensor_that_remembers_leaves_all_others_as_they_are() -> None:
    """Also where it is not asked for: what is remembered is known from that sensor alone."""
    place = "sensor.T3.scale"
    size = "a: {value: 0.01, absent: 0, prior_sigma: 0.1}"
    engine = carrying("a * (lagged(corrected_N1, t) - 1)", size, SHAPES["lagged"][1], at=place)
    plain, columns = load_engine(TURBOJET), recording(engine)
    inputs = {c: columns[c] for c in engine.inputs}
    others = tuple(c for c in engine.sensors if c != "T3_K")
    p = predicted(engine, columns, wrt=(f"slow.{place}.a",), sensors=others)
    assert p.ok.all() and np.allclose(p.y, plain.predict(inputs, sensors=others).y, rtol=1e-9)
    own = predicted(engine, columns, sensors=("T3_K",)).y
    assert np.abs(own / plain.predict(inputs, sensors=("T3_K",)).y - 1.0).max() > 1e-4


@pytest.mark.parametrize("name", SHAPES)
def test_a_law_that_remembers_is_the_filter_of_its_variable(name: str) -> None:
    engine, plain = engine_with(name), load_engine(TURBOJET)
    columns = recording(engine)
    p = predicted(engine, columns, sensors=("N1_rpm", "T2_K"))
    N1, T2 = p.y.T
    (memory,) = engine.network.memories
    u = formula_variables(engine.network)["corrected_N1"].values({"N1_rpm": N1, "T2_K": T2})
    assert p.ok.all()
    coefficients = [engine.nominal[c] for c in memory.coefficients]
    clock = engine.tapes.tapes[0].clock()
    m = u + memory.filter(clock, u, np.zeros((0, len(u))), coefficients).value
    assert np.abs(m - u).max() > 0.01
    f = 0.1 * (np.exp(2.0 * m - 2.0) - 1.0)
    inputs = {c: columns[c] for c in plain.inputs}
    assert np.allclose(
        plain.predict(inputs, {"compressor.efficiency": 1.0 + f}).y, predicted(engine, columns).y, rtol=1e-7
    )


@pytest.mark.parametrize("size", [0.1, 0.0])
@pytest.mark.parametrize("name", SHAPES)
def test_derivatives_are_those_of_differences_also_where_the_law_is_absent(name: str, size: float) -> None:
    engine = engine_with(name, size=size)
    columns = recording(engine, seed=1)
    names = (*(f"slow.compressor.efficiency.{c}" for c in ("a", "t")), "turbine.efficiency")
    p = predicted(engine, columns, wrt=names)
    for j, parameter in enumerate(names):
        nominal = engine.parameters[parameter].nominal
        h = 1e-5 * (abs(nominal) or 1.0)
        y = {k: predicted(engine, columns, {parameter: nominal + k * h}).y for k in (-1, 1)}
        D, size_of = (y[1] - y[-1]) / (2.0 * h), np.abs(p.jacobian[:, :, j]).max(axis=0)
        near = np.abs(D - p.jacobian[:, :, j]) <= 1e-4 * size_of + 1e-9
        assert near.mean() > 0.98, parameter  # at a corner of the past two slopes are right


@pytest.mark.parametrize("name", SHAPES)
def test_without_a_past_a_law_is_in_equilibrium(name: str) -> None:
    engine = engine_with(name)
    columns = recording(engine)
    inputs = {c: columns[c] for c in engine.inputs}
    static = carrying("a * (exp(2 * corrected_N1 - 2) - 1)", "a: {value: 0.1, absent: 0, prior_sigma: 0.1}")
    assert np.allclose(engine.predict(inputs).y, static.predict(inputs).y, rtol=1e-10)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("lagged(mach)", "the name of 1 coefficient"),
        ("lagged(mach, 3)", "the name of 1 coefficient"),
        ("limited(mach, s)", "the names of 2 coefficients"),
        ("lagged(mach, t + 1)", "the name of 1 coefficient"),
    ],
)
def test_what_a_follower_takes_is_told(text: str, told: str) -> None:
    with pytest.raises(ExpressionError, match=told):
        Expression.parse(text)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("a * (backlash(corrected_N1, mach) - 1)", "backlash goes by coefficients, and 'mach' is a variable"),
        ("a * (backlash(h, h) - h) * (power - 1)", "backlash follows no variable"),
        ("a * (backlash(1, h) - 1) + a * h * (power - 1)", "backlash follows no variable"),
    ],
)
def test_what_follows_nothing_or_goes_by_no_coefficient_is_refused(text: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        carrying(text, "a: {value: 0.1, absent: 0, prior_sigma: 0.1}", "h: {value: 0.02}")


def test_a_coefficient_has_no_name_of_a_follower() -> None:
    with pytest.raises(ConfigError, match="'lagged' is the name of something else in formulas"):
        carrying("lagged * (corrected_N1 - 1)", "lagged: {value: 0.1, absent: 0, prior_sigma: 0.1}")


def test_a_time_without_a_unit_is_refused() -> None:
    with pytest.raises(ConfigError, match="lagged takes s, not 1"):
        carrying("a * (lagged(corrected_N1, t) - 1)", "a: {value: 0.1, absent: 0, prior_sigma: 0.1}", "t: {value: 3.0}")
