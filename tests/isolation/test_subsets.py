"""Enumeration and branch and bound find what exhaustive search finds."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from score_makers import linear_score, sensitivities

from enginediag_cli.isolation.subsets import ENUMERATED, best_subsets


def exhaustive(score, size):
    def value(chosen):
        i = list(chosen)
        return score.b[i] @ np.linalg.solve(score.information[np.ix_(i, i)], score.b[i])

    return max(combinations(range(len(score.parameters)), size), key=value)


@pytest.mark.parametrize("p", [10, ENUMERATED + 1])
@pytest.mark.parametrize("seed", range(3))
def test_the_best_set_of_every_size_equals_exhaustive_search(seed, p):
    rng = np.random.default_rng(seed)
    score = linear_score(rng, sensitivities(rng, p=p), 0.02 * rng.standard_normal(p) * (rng.random(p) < 0.4))
    found = best_subsets(score, p)
    assert found.exact
    for size in range(1, p + 1):
        assert found.sets[size - 1] == exhaustive(score, size)
    assert found.values[-1] == pytest.approx(score.glr, rel=1e-6)
    assert np.all(np.diff(found.values) > -1e-9)


def test_twenty_parameters_agree_with_exhaustive_search():
    rng = np.random.default_rng(9)
    score = linear_score(rng, sensitivities(rng, p=20), [0.02] * 3 + [0.0] * 17)
    found = best_subsets(score, 3)
    assert [found.sets[size - 1] for size in (1, 2, 3)] == [exhaustive(score, size) for size in (1, 2, 3)]


def test_forty_parameters_and_eight_faults_need_a_small_part_of_77_million_sets():
    rng = np.random.default_rng(10)
    change = np.zeros(40)
    true = rng.choice(40, 8, replace=False)
    change[true] = 0.05
    found = best_subsets(linear_score(rng, sensitivities(rng, N=140, p=40), change), 8)
    assert found.exact and found.nodes < 100_000
    assert set(found.sets[-1]) == set(true)


def test_parameters_that_imitate_each_other_do_no_harm():
    rng = np.random.default_rng(11)
    J = sensitivities(rng, p=6)
    J[:, :, 5] = J[:, :, 4]
    score = linear_score(rng, J, [0.05, 0, 0, 0, 0.05, 0])
    found = best_subsets(score, 6)
    assert found.exact
    assert found.sets[1] in ((0, 4), (0, 5))
    assert found.values[-1] == pytest.approx(score.glr, rel=1e-6)


def test_parameters_that_are_not_excited_are_never_chosen():
    rng = np.random.default_rng(12)
    J = sensitivities(rng, p=5)
    J[:, :, 2] = 0.0
    found = best_subsets(linear_score(rng, J, np.zeros(5)), 5)
    assert len(found.sets) == 4
    assert all(2 not in s for s in found.sets)


def test_a_search_that_is_cut_short_says_so():
    rng = np.random.default_rng(13)
    assert not best_subsets(linear_score(rng, sensitivities(rng, p=25), np.zeros(25)), 8, max_nodes=10).exact
