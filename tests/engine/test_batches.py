"""What an engine says of a point does not depend on the batch that it comes in."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import operating_points, take, turbofan
from mixed_flow import MIXED_FLOW

from enginediag_cli.engine import solver
from enginediag_cli.engine import start as anchors
from enginediag_cli.engine.engine import Engine
from enginediag_cli.physics.engine_file import load_engine

N = 420
WRT = ("hpc.efficiency", "lpt.flow_capacity")


@pytest.fixture(scope="module")
def engine() -> Engine:
    return turbofan().replace_nominals({"hpc.efficiency": 0.985})


@pytest.fixture(scope="module")
def points(engine):
    return operating_points(engine, N, 5, power=(0.2, 1.0))


@pytest.fixture(scope="module")
def mixed(tmp_path_factory) -> Engine:
    path = tmp_path_factory.mktemp("mixed") / "mixed.yaml"
    path.write_text(MIXED_FLOW, encoding="utf-8")
    return load_engine(path)


@pytest.mark.parametrize("size", [solver.FEW_POINTS + 1, 97, 210])
def test_values_and_sensitivities_are_the_same_to_the_last_digit_in_batches_of_any_size(engine, points, size):
    whole = engine.predict(points, wrt=WRT)
    assert whole.ok.all()
    engine.forget_start()
    for first in range(0, N - solver.FEW_POINTS, size):
        rows = slice(first, first + size)
        part = engine.predict(take(points, rows), wrt=WRT)
        assert np.array_equal(part.x, whole.x[:, rows])
        assert np.array_equal(part.y, whole.y[rows])
        assert np.array_equal(part.jacobian, whole.jacobian[rows])


@pytest.mark.parametrize("wrt", [(), WRT])
def test_few_points_are_the_same_to_the_last_digit_one_by_one_and_together(wrt):
    fresh = turbofan()
    points = operating_points(fresh, solver.FEW_POINTS, 6)
    together = fresh.predict(points, wrt=wrt)
    for size in (1, 7):
        for first in range(0, 3 * size, size):
            rows = slice(first, first + size)
            part = fresh.predict(take(points, rows), wrt=wrt)
            assert np.array_equal(part.y, together.y[rows]) and np.array_equal(part.jacobian, together.jacobian[rows])


def test_the_answer_to_a_point_knows_nothing_of_rows_that_fail_or_lie_elsewhere(engine, points):
    strange = {c: v.copy() for c, v in points.items()}
    strange["Wf_kg_s"][::7] *= np.geomspace(1e-3, 30.0, N)[::7]
    strange["mach"][3] = np.nan
    others = np.ones(N, dtype=bool)
    others[::7] = others[3] = False
    engine.forget_start()
    found = engine.predict(strange, wrt=WRT)
    assert (~found.ok).sum() > 10
    engine.forget_start()
    expected = engine.predict(points, wrt=WRT)
    assert np.array_equal(found.y[others], expected.y[others])
    assert np.array_equal(found.jacobian[others], expected.jacobian[others])


def test_what_was_asked_before_does_not_change_the_answer_to_many_points(engine, points):
    expected = engine.predict(points)
    engine.forget_start()
    engine.predict(operating_points(engine, 700, 1, power=(0.9, 1.3)))
    assert np.array_equal(engine.predict(points).y, expected.y)


def test_flows_that_mix_leave_their_own_iteration_one_by_one(mixed):
    points = operating_points(mixed, 120, 3, altitude=(0.0, 10000.0), mach=(0.2, 0.8), power=(0.3, 1.0))
    whole = mixed.predict(points, wrt=("fan.efficiency",))
    part = mixed.predict(take(points, slice(30, 75)), wrt=("fan.efficiency",))
    assert whole.ok.all()
    assert np.array_equal(part.y, whole.y[30:75]) and np.array_equal(part.jacobian, whole.jacobian[30:75])


def test_a_failing_row_costs_a_bounded_number_of_passes_of_few_points(engine, points, monkeypatch):
    engine.predict(points)
    seen: list[int] = []
    evaluate = solver.evaluate

    def counted(network, inputs, parameters, x, wrt):
        seen.append(x.shape[1])
        return evaluate(network, inputs, parameters, x, wrt)

    monkeypatch.setattr(solver, "evaluate", counted)
    engine.predict(points)
    before = len(seen), sum(seen)
    seen.clear()
    broken = {c: v.copy() for c, v in points.items()}
    broken["Wf_kg_s"][11] = 200.0
    found = engine.predict(broken)
    assert (~found.ok).sum() == 1
    assert len(seen) < before[0] + 150
    assert sum(seen) < before[1] + 150 * (len(engine.unknowns) + 1)


def test_the_order_of_the_records_orders_the_answers_only(engine, points):
    order = np.random.default_rng(2).permutation(N)
    assert np.array_equal(engine.predict(take(points, order)).y, engine.predict(points).y[order])


def test_values_hardly_depend_on_what_is_differentiated(engine, points):
    plain = engine.predict(points)
    np.testing.assert_allclose(engine.predict(points, wrt=engine.monitored).y, plain.y, rtol=2e-11)


def test_few_points_give_what_many_give_to_the_precision_of_the_solver(engine, points):
    whole = engine.predict(points)
    for k in range(0, N, 60):
        np.testing.assert_allclose(engine.predict(take(points, slice(k, k + 1))).y[0], whole.y[k], rtol=1e-9)


def test_a_point_that_is_asked_from_its_solution_stays_there(engine, points):
    whole = engine.predict(points)
    again = engine.predict(points, start=whole.x)
    assert np.array_equal(again.x, whole.x) and (again.passes == 1).all()


def test_anchors_fill_the_ranges_and_are_always_the_same():
    ranges = {"a": (0.0, 1.0), "b": (-3.0, 5.0), "c": (10.0, 11.0)}
    found = anchors.anchor_points(ranges, ("a", "b", "c"))
    for column, (low, high) in ranges.items():
        share = (found[column] - low) / (high - low)
        assert 0.0 <= share.min() < 0.02 and 0.98 < share.max() <= 1.0
        assert abs(np.mean(share) - 0.5) < 0.02
        assert np.array_equal(found[column], anchors.anchor_points(ranges, ("a", "b", "c"))[column])
    assert abs(np.corrcoef(np.stack(list(found.values())))[np.triu_indices(3, 1)]).max() < 0.1
