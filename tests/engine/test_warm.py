"""The engine that begins where it ended."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from enginediag_cli.engine.wrapped import WarmEngine, warm_start
from enginediag_cli.physics.engine_file import load_engine

CONFIG = Path(__file__).resolve().parents[2] / "configs" / "citation_jt15d.yaml"


@pytest.fixture(scope="module")
def engine():
    return load_engine(CONFIG)


@pytest.fixture
def flight():
    rng = np.random.default_rng(3)
    n = 40  # so few that no start is fitted
    return {
        "altitude_m": rng.uniform(500, 3000, n),
        "mach": rng.uniform(0.2, 0.4, n),
        "dT_isa_K": rng.uniform(-8, 8, n),
        "N1_rpm": rng.uniform(9000, 15000, n),
    }


def test_the_answer_does_not_depend_on_the_memory(engine, flight):
    warmed = WarmEngine(engine)
    parameters = {"hpc.efficiency": 0.97, "lpt.flow_capacity": 1.02}
    warmed.predict(flight)
    found = warmed.predict(flight, parameters, wrt=("hpc.efficiency",))
    fresh = engine.predict(flight, parameters, wrt=("hpc.efficiency",))
    assert np.array_equal(found.status, fresh.status) and found.ok.all()
    np.testing.assert_allclose(found.y, fresh.y, rtol=1e-8)
    np.testing.assert_allclose(found.jacobian, fresh.jacobian, rtol=1e-6, atol=1e-9)


def test_the_same_records_again_take_fewer_passes(engine, flight):
    warmed = WarmEngine(engine)
    first = warmed.predict(flight)
    again = warmed.predict(flight, {"hpc.efficiency": 0.9999})
    assert again.ok.all()
    assert again.passes.mean() < 0.7 * first.passes.mean()


def test_records_that_are_read_a_little_otherwise_begin_at_their_own_solution(engine, flight, monkeypatch):
    warmed = WarmEngine(engine)
    first = warmed.predict(flight)
    monkeypatch.setattr(warmed, "_nearest_start", lambda points: pytest.fail("they were sought among all points"))
    moved = {**flight, "N1_rpm": flight["N1_rpm"] * 1.003}
    found = warmed.predict(moved)
    np.testing.assert_allclose(found.y, engine.predict(moved).y, rtol=1e-8)
    assert found.passes.mean() < 0.7 * first.passes.mean()


def test_new_records_begin_at_the_nearest_point_solved(engine, flight):
    warmed = WarmEngine(engine)
    first = warmed.predict(flight)
    half = {c: v[::2] + 1e-4 for c, v in flight.items()}
    found = warmed.predict(half)
    np.testing.assert_allclose(found.y, engine.predict(half).y, rtol=1e-8)
    assert found.passes.mean() < 0.7 * first.passes.mean()


def test_a_missing_input_is_flagged_and_leaves_the_other_records_their_start(engine, flight):
    warmed = WarmEngine(engine)
    broken = {**flight, "mach": np.where(np.arange(40) == 7, np.nan, flight["mach"])}
    for _ in range(2):
        found = warmed.predict(broken)
        assert found.status[7] == 3 and found.ok.sum() == 39
    assert warmed.predict(flight).ok.all()


def test_only_engines_get_a_memory(engine):
    class Toy:
        inputs = ("x",)

    toy = Toy()
    assert warm_start(toy) is toy
    assert warm_start(engine).inputs == engine.inputs


def test_what_was_predicted_last_is_known_and_nothing_else_is(engine, flight):
    warmed = WarmEngine(engine)
    first = warmed.predict(flight, {"hpc.efficiency": 0.97}, wrt=("hpc.efficiency",))
    assert warmed.predict(dict(flight), {"hpc.efficiency": 0.97}, wrt=("hpc.efficiency",)) is first
    other = warmed.predict(flight, {"hpc.efficiency": 0.96}, wrt=("hpc.efficiency",))
    assert other is not first and not np.allclose(other.y, first.y, rtol=1e-6)
    assert warmed.predict(flight, {"hpc.efficiency": 0.96}).jacobian.shape[2] == 0
