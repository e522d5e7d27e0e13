"""How large map errors are: against closed forms and differences."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from enginediag_cli.error_model.sizes import COMMON, LARGEST, SPREAD, expected_factors, likeliest_factors

STATED = np.array([0.003])


def objective(log_t, H, b, group, centre):
    """−ln L(t) less the prior, from dense matrices."""
    t = np.where(group >= 0, np.exp(log_t)[group], 1.0)
    V = np.eye(len(t)) + (t[:, None] * H * t)
    gain = 0.5 * (t * b) @ np.linalg.solve(V, t * b) - 0.5 * np.linalg.slogdet(V)[1]
    away = log_t - centre
    alike = SPREAD**2 * ((1 - COMMON) * np.eye(len(centre)) + COMMON)
    return -(gain - 0.5 * away @ np.linalg.solve(alike, away))


def drawn(rng, p, size, strength=50.0):
    """Information H (p, p) of well-conditioned data and the pull b (p,) of amounts of `size` in prior units."""
    A = rng.normal(size=(3 * p, p)) * np.sqrt(strength / (3 * p))
    H = A.T @ A
    x = size * rng.normal(size=p)
    return H, H @ x + A.T @ rng.normal(size=3 * p)


def test_one_group_with_diagonal_information_has_a_closed_form():
    """h ≫ 1: mean square of the amounts t̂², held by the prior of its logarithm: n (m²/t² − 1) = ln t."""
    n, h, x = 200, 1e6, 3.0
    t = likeliest_factors(h * np.eye(n), np.full(n, h * x), np.zeros(n, int), STATED, STATED)
    (found,) = t
    variance = x**2 + 1 / h  # of an amount, as the data have it
    assert n * (variance / found**2 - 1) == pytest.approx(np.log(found), rel=1e-3)
    assert found == pytest.approx(x, rel=0.02)


def test_sizes_are_never_below_what_is_stated():
    n = 20
    nothing = likeliest_factors(100 * np.eye(n), np.zeros(n), np.zeros(n, int), STATED, STATED)
    assert nothing == pytest.approx(1.0)
    # also when they stood higher before
    back = likeliest_factors(100 * np.eye(n), np.zeros(n), np.zeros(n, int), 5 * STATED, STATED)
    assert back == pytest.approx(0.2)


def test_no_size_is_beyond_the_largest_that_a_map_error_has():
    n = 20
    (t,) = likeliest_factors(1e4 * np.eye(n), np.full(n, 1e4 * 1e3), np.zeros(n, int), STATED, STATED)
    assert t == pytest.approx(LARGEST)


def test_no_information_leaves_what_is_stated():
    t = likeliest_factors(np.zeros((4, 4)), np.zeros(4), np.array([0, 0, 1, 1]), np.full(2, 0.003), np.full(2, 0.003))
    np.testing.assert_allclose(t, 1.0)
    assert likeliest_factors(np.zeros((0, 0)), np.zeros(0), np.zeros(0, int), np.zeros(0), np.zeros(0)).shape == (0,)


@pytest.mark.parametrize("seed", range(4))
def test_factors_are_where_the_marginal_likelihood_is_largest_and_its_slope_is_that_of_differences(seed):
    rng = np.random.default_rng(seed)
    group = np.array([0] * 5 + [1] * 5 + [2] * 5 + [-1] * 4)
    x = np.repeat([0.2, 3.0, 8.0, 1.0], [5, 5, 5, 4])
    H, b = drawn(rng, len(group), x)
    stated = np.full(3, 0.003)
    present = stated * np.array([1.0, 1.5, 2.0])
    centre = np.log(stated / present)
    t = likeliest_factors(H, b, group, present, stated)
    direct = minimize(
        objective,
        np.maximum(np.zeros(3), centre),
        (H, b, group, centre),
        method="Powell",
        bounds=list(zip(centre, centre + np.log(LARGEST), strict=True)),
        options={"xtol": 1e-8, "ftol": 1e-14},
    )
    np.testing.assert_allclose(np.log(t), direct.x, atol=1e-3)
    step = 1e-5
    for g in range(3):
        away = np.eye(3)[g] * step
        slope = (
            objective(np.log(t) + away, H, b, group, centre) - objective(np.log(t) - away, H, b, group, centre)
        ) / (2 * step)
        low, high = np.isclose(t[g], np.exp(centre[g])), np.isclose(t[g], LARGEST * np.exp(centre[g]))
        assert abs(slope) < 1e-3 or (low and slope > 0) or (high and slope < 0)


def known_beside_unknown(maps):
    """Likeliest sizes of a map that is wrong by three times what is stated, and of one of which the data tell nothing,
    over what is stated. maps: how many of them are of one engine."""
    n, h = 200, 1e6
    H = np.diag(np.append(np.full(n, h), np.zeros(5)))
    b = np.append(np.full(n, 3.0 * h), np.zeros(5))
    stated = np.full(2, 0.003)
    return likeliest_factors(H, b, np.repeat([0, 1], [n, 5]), stated, stated, maps=maps)


def test_a_map_of_which_nothing_is_known_is_expected_to_be_as_wrong_as_others_of_its_engine():
    """Given the others, the mean of a Gaussian: COMMON of the logarithm by which they exceed what is stated."""
    wrong, unknown = known_beside_unknown(2)
    assert wrong == pytest.approx(3.0, rel=0.02)
    assert np.log(unknown) == pytest.approx(COMMON * np.log(wrong), abs=1e-3)


def test_what_is_missed_at_operating_points_says_nothing_of_maps():
    wrong, unknown = known_beside_unknown(1)
    assert wrong == pytest.approx(3.0, rel=0.02) and unknown == pytest.approx(1.0, abs=1e-3)


def test_what_keeps_its_prior_takes_its_share_of_the_pull():
    """A parameter beside the amounts that explains the readings as well leaves less for them."""
    H = 100 * np.array([[1.0, 1.0], [1.0, 1.0]]) + 1e-9 * np.eye(2)
    b = np.full(2, 100 * 4.0)
    alone = likeliest_factors(H[:1, :1], b[:1], np.array([0]), STATED, STATED)
    beside = likeliest_factors(H, b, np.array([0, -1]), STATED, STATED)
    assert 1.0 <= beside[0] < alone[0]


def test_the_answer_does_not_depend_on_the_units_in_which_it_is_asked():
    """Present sizes are units: halving them halves the standard deviation that a factor of one stands for."""
    rng = np.random.default_rng(9)
    group = np.array([0] * 6 + [1] * 6)
    H, b = drawn(rng, 12, np.repeat([2.0, 5.0], 6))
    stated = np.full(2, 0.003)
    one = likeliest_factors(H, b, group, stated, stated) * stated
    other = likeliest_factors(4 * H, 2 * b, group, 2 * stated, stated) * 2 * stated
    np.testing.assert_allclose(other, one, rtol=1e-3)


def test_beyond_training_an_error_is_as_wide_as_all_sizes_that_are_possible():
    """No data: √E[s²] of a logarithm normal about ln stated from 0 to ln LARGEST. Many well known: theirs."""
    group, none = np.zeros(4, int), np.zeros((4, 4))
    v = np.linspace(0.0, np.log(LARGEST), 10_001)
    weight = np.exp(-0.5 * (v / SPREAD) ** 2)
    expected = np.sqrt(np.sum(weight * np.exp(2 * v)) / np.sum(weight))
    (found,) = expected_factors(none, np.zeros(4), group, STATED, STATED)
    assert found == pytest.approx(expected, rel=0.02) and found > 2.0
    n, h = 400, 1e6
    amounts = 3.0 * np.random.default_rng(7).standard_normal(n)
    H, b = h * np.eye(n), h * amounts
    (t,) = likeliest_factors(H, b, np.zeros(n, int), STATED, STATED)
    (sure,) = expected_factors(H / (1 / t**2), b * t, np.zeros(n, int), t * STATED, STATED)
    assert sure == pytest.approx(1.0, abs=0.03)


def test_beyond_training_an_error_is_wider_where_other_maps_of_the_engine_are_wrong():
    """Two groups without data: that beside a size of LARGEST is expected above what it would be alone."""
    none, group, stated = np.zeros((8, 8)), np.repeat([0, 1], 4), np.full(2, 0.003)
    alone = expected_factors(none, np.zeros(8), group, stated, stated)
    beside = expected_factors(none, np.zeros(8), group, stated * [1.0, LARGEST], stated)
    assert 1.2 * alone[0] < beside[0] < LARGEST
