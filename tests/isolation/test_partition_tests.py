"""Sensitivity and min-max tests: equations (13) and (14) and how they belong together."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import kstest
from score_makers import linear_score, sensitivities

from enginediag_cli.isolation.methods import (
    holm_minmax,
    minmax_test,
    rejection_test,
    sensitivity_test,
    single_minmax,
    single_sensitivities,
)


@pytest.fixture
def score():
    rng = np.random.default_rng(1)
    return linear_score(rng, sensitivities(rng), [0.02, 0, 0, -0.03, 0, 0])


def test_sensitivity_of_all_parameters_is_the_glr_test(score):
    assert sensitivity_test(score, score.parameters) == (pytest.approx(score.glr), score.rank)


def test_sensitivity_is_equation_13(score):
    a = [0, 3]
    b, F = score.b[a], score.information[np.ix_(a, a)]
    assert sensitivity_test(score, ("p0", "p3"))[0] == pytest.approx(b @ np.linalg.solve(F, b))


def test_minmax_is_equation_14(score):
    a, b = [0, 3], [1, 2, 4, 5]
    F, s = score.information, score.b
    regression = F[np.ix_(a, b)] @ np.linalg.inv(F[np.ix_(b, b)])
    r = s[a] - regression @ s[b]
    reduced = F[np.ix_(a, a)] - regression @ F[np.ix_(b, a)]
    assert minmax_test(score, ("p0", "p3"))[0] == pytest.approx(r @ np.linalg.solve(reduced, r))


def test_glr_splits_into_minmax_of_a_and_sensitivity_of_b(score):
    t, dof = minmax_test(score, ("p0", "p3"))
    t_b, dof_b = sensitivity_test(score, ("p1", "p2", "p4", "p5"))
    assert t + t_b == pytest.approx(score.glr, rel=1e-9)
    assert dof + dof_b == score.rank
    assert rejection_test(score, ("p1", "p2", "p4", "p5")) == (pytest.approx(t, rel=1e-8), dof)


def test_the_split_holds_when_operating_points_excite_too_few_combinations():
    rng = np.random.default_rng(2)
    J = np.tile(sensitivities(rng, N=1), (30, 1, 1))  # one operating point: 4 combinations of 6 parameters
    score = linear_score(rng, J, np.zeros(6))
    assert score.rank == 4
    for names in (("p0",), ("p0", "p1", "p2"), ("p1", "p2", "p3", "p4", "p5")):
        others = tuple(n for n in score.parameters if n not in names)
        (t, dof), (t_b, dof_b) = minmax_test(score, names), sensitivity_test(score, others)
        assert t + t_b == pytest.approx(score.glr, rel=1e-6)
        assert dof + dof_b == 4
    assert minmax_test(score, ("p0",))[1] == 0


def test_minmax_ignores_whatever_the_other_parameters_do():
    rng = np.random.default_rng(3)
    J = sensitivities(rng)
    one, other = (
        minmax_test(linear_score(np.random.default_rng(4), J, change), ("p0",))[0]
        for change in (np.zeros(6), [0, 0.5, -0.2, 0.1, 0.3, 0.0])
    )
    assert one == pytest.approx(other, rel=1e-6)


def test_minmax_of_an_unchanged_parameter_is_chi2_though_others_changed():
    rng = np.random.default_rng(5)
    J = sensitivities(rng)
    values = [minmax_test(linear_score(rng, J, [0, 0.05, 0, 0, 0.05, 0]), ("p0",))[0] for _ in range(300)]
    assert kstest(values, "chi2", args=(1,)).pvalue > 0.001


def test_single_statistics_are_the_tests_one_by_one(score):
    np.testing.assert_allclose(single_sensitivities(score), [sensitivity_test(score, [n])[0] for n in score.parameters])
    np.testing.assert_allclose(single_minmax(score)[0], [minmax_test(score, [n])[0] for n in score.parameters])


def test_holm_names_an_unchanged_parameter_no_more_often_than_stated():
    rng = np.random.default_rng(6)
    J = sensitivities(rng)
    wrong = hit = 0
    for _ in range(200):
        named, _ = holm_minmax(linear_score(rng, J, [0.08, 0, 0, -0.08, 0, 0]), 0.05)
        wrong += bool(set(named) - {"p0", "p3"})
        hit += {"p0", "p3"} <= set(named)
    assert wrong <= 22  # P(more than 22 of 200 at 5 %) < 0.1 %
    assert hit > 100


def test_an_unknown_parameter_is_named_in_the_error(score):
    with pytest.raises(KeyError, match="p9"):
        sensitivity_test(score, ["p9"])
