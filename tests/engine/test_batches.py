"""What an engine says of a point does not depend on the batch that it comes in."""

from __future__ import annotations

import numpy as np
import pytest
from engine_makers import operating_points, take, turbofan

from enginediag_cli.engine import anchors, solver
from enginediag_cli.engine.engine import Engine

N = 420


@pytest.fixture(scope="module")
def engine() -> Engine:
    return turbofan().at({"hpc.efficiency": 0.985})


@pytest.fixture(scope="module")
def points(engine):
    return operating_points(engine, N, 5, power=(0.2, 1.0))


@pytest.mark.parametrize("size", [solver.FEW_POINTS + 1, 97, 210])
def test_values_and_sensitivities_are_the_same_to_the_last_digit_in_batches_of_any_size(engine, points, size):
    wrt = ("hpc.efficiency", "lpt.flow_capacity")
    whole = engine.predict(points, wrt=wrt)
    assert whole.ok.all()
    engine.forget_start()
    for first in range(0, N - solver.FEW_POINTS, size):
        rows = slice(first, first + size)
        part = engine.predict(take(points, rows), wrt=wrt)
        assert np.array_equal(part.x, whole.x[:, rows])
        assert np.array_equal(part.y, whole.y[rows])
        assert np.array_equal(part.jacobian, whole.jacobian[rows])


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
    found = anchors.over(ranges, ("a", "b", "c"))
    for column, (low, high) in ranges.items():
        share = (found[column] - low) / (high - low)
        assert 0.0 <= share.min() < 0.02 and 0.98 < share.max() <= 1.0
        assert abs(np.mean(share) - 0.5) < 0.02
        assert np.array_equal(found[column], anchors.over(ranges, ("a", "b", "c"))[column])
    assert abs(np.corrcoef(np.stack(list(found.values())))[np.triu_indices(3, 1)]).max() < 0.1
