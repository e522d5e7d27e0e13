"""Smallest detectable changes are those that the tests then detect with the stated power."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.detection.glr import power
from enginediag_cli.detection.minimum_change import minimum_change, required_noncentrality
from enginediag_cli.residuals.score import Score


def score_of(information, sigma=0.02):
    p = len(information)
    return Score(
        tuple("abcdef"[:p]),
        np.ones(p),
        np.full(p, sigma),
        np.zeros(p),
        information,
        0.0,
        int(np.linalg.matrix_rank(information)),
    )


def random_information(p=4, seed=1):
    A = np.random.default_rng(seed).standard_normal((20, p)) * 50
    return A.T @ A


def test_the_global_test_sees_the_smallest_change_with_the_stated_power():
    score = score_of(random_information())
    for i, size in enumerate(minimum_change(score, false_alarm=0.01, power=0.8)):
        change = np.zeros(4)
        change[i] = size
        assert power(score, change, 0.01) == pytest.approx(0.8, abs=1e-8)


def test_one_degree_of_freedom_matches_the_normal_distribution():
    # Cohen's textbook value: (1.95996 + 0.84162)² = 7.849 for 5 %, two-sided, power 80 %
    assert required_noncentrality(1, 0.05, 0.8) == pytest.approx(7.849, abs=2e-3)


def test_knowing_the_direction_and_ignoring_the_others_make_smaller_changes_visible():
    score = score_of(random_information())
    one, two = (minimum_change(score, test="directed", sides=s) for s in (1, 2))
    assert np.all(one < two)
    assert np.all(two < minimum_change(score))
    assert np.all(two < minimum_change(score, test="minmax"))


def test_a_parameter_that_is_not_excited_has_no_smallest_change():
    information = random_information()
    information[3] = information[:, 3] = 0.0
    sizes = minimum_change(score_of(information))
    assert np.isinf(sizes[3]) and np.isfinite(sizes[:3]).all()


def test_parameters_that_imitate_each_other_are_detectable_but_not_separable():
    information = random_information(3)
    twin = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2.0]]).T
    score = score_of(twin @ information @ twin.T)
    assert np.isfinite(minimum_change(score)).all()
    alone = minimum_change(score, test="minmax")
    assert np.isinf(alone[2:]).all() and np.isfinite(alone[:2]).all()


@pytest.mark.parametrize(
    "options", [{"test": "other"}, {"sides": 1}, {"sides": 3, "test": "directed"}, {"power": 0.001}]
)
def test_impossible_choices_are_refused(options):
    with pytest.raises(ValueError, match="must"):
        minimum_change(score_of(random_information()), **options)
