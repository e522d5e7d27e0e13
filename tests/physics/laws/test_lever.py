"""Laws at the size of an effect that the engine does not carry: the effect acts with what the formula gives."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.engine import Engine
from enginediag_cli.engine.load import EngineDescription
from enginediag_cli.errors import ConfigError
from enginediag_cli.physics.engine_file import law_entry, load_engine
from enginediag_cli.physics.law import formula_variables
from enginediag_cli.physics.registry import effect

CONFIGS = Path(__file__).parents[3] / "configs"
SIZES = {
    "customer_bleed.hpc.fraction": ("1", 0.05),
    "power_offtake.hp.fraction": ("1", 0.02),
    "tat_probe_heating.ambient.error_K": ("K", 3.0),
    "humidity.ambient.relative_humidity": ("1", 0.5),
    "fuel_heating_value.burner.deviation": ("1", 0.02),
}
"""Levers of a turbofan with the units of their sizes and an amplitude."""
FORMULA = "a * ((power - 1) ** 2 + 0.5 * mach)"  # of an input and of what lies at the far end of the gas path


def carrying(block: str, name: str = "turbofan") -> Engine:
    path = CONFIGS / f"{name}.yaml"
    return load_engine(EngineDescription(str(path), f"{path.read_text(encoding='utf-8')}\nphysics:{block}", {}))


def entry(at: str, unit: str, a: float, formula: str = FORMULA) -> str:
    return f"""
  - law: varying
    at: {at}
    expression: {formula}
    coefficients:
      a: {{value: {a}, unit: "{unit}", absent: 0, prior_sigma: {a}}}
"""


def points(engine: Engine, n: int = 40) -> dict[str, np.ndarray]:
    r = np.random.default_rng(0)
    u = {c: r.uniform(*engine.envelope[c], n) for c in engine.inputs if c in engine.envelope}
    u[engine.power_setting] = engine.power_from_fraction(r.uniform(0.4, 1.0, n), u)
    return u


@pytest.mark.parametrize("at", SIZES)
def test_the_law_is_the_term_with_that_size_in_every_record(at: str) -> None:
    unit, a = SIZES[at]
    law = carrying(entry(at, unit, a))
    u = points(law)
    power = formula_variables(law.network)["power"]
    columns = dict(zip(power.columns, law.predict(u, sensors=power.columns).y.T, strict=True))
    f = a * ((power.values(columns) - 1.0) ** 2 + 0.5 * u["mach"])
    plain = load_engine(CONFIGS / "turbofan.yaml")
    name, site, _ = at.split(".")
    term = plain.replace_effects((effect(plain, name, site),))
    one, other = law.predict(u), term.predict(u, {at: f})
    assert one.ok.all() and other.ok.all()
    assert np.allclose(one.y, other.y, rtol=1e-9)
    assert not np.allclose(one.y, plain.predict(u).y, rtol=1e-6)


@pytest.mark.parametrize("at", SIZES)
def test_its_derivative_is_exact_and_absent_it_changes_nothing(at: str) -> None:
    unit, a = SIZES[at]
    law = carrying(entry(at, unit, a))
    u, own = points(law), f"varying.{at}.a"
    p = law.predict(u, wrt=(own,))
    h = 1e-3 * a
    y = {k: law.predict(u, {own: a + k * h}).y for k in (-2, -1, 1, 2)}
    D = (8.0 * (y[1] - y[-1]) - (y[2] - y[-2])) / (12.0 * h)
    size = np.abs(p.jacobian[:, :, 0]).max(axis=0)
    assert (np.abs(D - p.jacobian[:, :, 0]) <= 1e-6 * size + 1e-10).all()
    plain = load_engine(CONFIGS / "turbofan.yaml")
    assert np.allclose(law.predict(u, {own: 0.0}).y, plain.predict(u).y, rtol=1e-11)
    # sought from nothing, it has a derivative
    assert np.abs(law.predict(u, {own: 0.0}, wrt=(own,)).jacobian).max() > 0.0


def test_beside_the_effect_that_the_file_carries_it_is_a_further_one() -> None:
    both = "\n  - {term: power_offtake, at: hp, coefficients: {fraction: 0.01}}" + entry(
        "power_offtake.hp.fraction", "1", 0.02, "a * mach"
    )
    engine = carrying(both)
    u = points(engine)
    plain = load_engine(CONFIGS / "turbofan.yaml")
    term = plain.replace_effects((effect(plain, "power_offtake", "hp"),))
    expected = term.predict(u, {"power_offtake.hp.fraction": 0.01 + 0.02 * u["mach"]})
    assert np.allclose(engine.predict(u).y, expected.y, rtol=1e-9)


def test_written_by_refine_it_is_read_as_it_was() -> None:
    (law,) = carrying(entry("customer_bleed.hpc.fraction", "1", 0.05)).effects
    block = law_entry(law)
    assert block["at"] == "customer_bleed.hpc.fraction"
    assert block["coefficients"]["a"]["value"] == 0.05


@pytest.mark.parametrize(
    ("at", "formula", "unit", "told"),
    [
        ("humidity.ambient.relative_humidity", "a * humidity", "1", "is what a law at"),
        ("tat_probe_heating.ambient.error_K", "a * mach", "1", "is in 1, and what is added"),
        ("tat_probe_heating.ambient.mach_scale", "a * mach", "1", "is none"),
        ("customer_bleed.fan.fraction", "a * mach", "1", "is none"),
        ("bleed_valve_hysteresis.hpc.fraction", "a * mach", "1", "is none"),
    ],
)
def test_what_cannot_be_is_refused(at: str, formula: str, unit: str, told: str) -> None:
    with pytest.raises(ConfigError, match=told):
        carrying(entry(at, unit, 0.1, formula))
