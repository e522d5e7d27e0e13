"""Sums by the fixed tree: the same to the last digit in any order, and the sum."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest

from enginediag_cli.fleets.run import TreeSum, tree_sum


@pytest.mark.parametrize("n", [1, 2, 3, 5, 6, 7, 8, 13])
def test_the_sum_does_not_depend_on_the_order_in_which_its_parts_come(n):
    rng = np.random.default_rng(n)
    values = rng.standard_normal(n) * 10.0 ** rng.integers(-8, 8, n)
    orders = list(permutations(range(n))) if n < 6 else [rng.permutation(n) for _ in range(50)]
    totals = set()
    for order in orders:
        tree = TreeSum[float](n)
        for k in order:
            tree.add(int(k), float(values[k]))
        totals.add(tree.total)
    assert len(totals) == 1
    assert totals.pop() == pytest.approx(values.sum(), rel=1e-9)


def test_parts_without_a_value_add_nothing_and_memory_holds_a_node_per_level():
    tree = TreeSum[float](1000)
    most = 0
    for k in range(1000):
        tree.add(k, None if k % 3 else 1.0)
        most = max(most, len(tree._waiting))
    assert tree.total == 334.0
    assert most <= 10
    assert tree_sum([]) is None
