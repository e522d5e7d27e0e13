"""Statistics about the re-estimated point."""

from __future__ import annotations

import numpy as np
import pytest
from white_statistics import local_statistics, white_noise

from enginediag_cli.residuals.relinearise import EstimatePrior, Stop, bounded_steps, relinearise
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame

SIGMA = np.array([0.01, 0.01, 0.02])


def curved(u):
    """A model with strong curvature: y = [a·u + 5(a−1)², b·u², a·b·u] at theta = (a, b)."""

    def predict(theta, rows):
        a, b, x = theta[:, 0], theta[:, 1], u[rows]
        y = np.stack([a * x + 5 * (a - 1) ** 2, b * x**2, a * b * x], axis=1)
        zero = np.zeros_like(x)
        J = np.stack(
            [np.stack([x + 10 * (a - 1), zero], 1), np.stack([zero, x**2], 1), np.stack([b * x, a * x], 1)],
            axis=1,
        )
        return y, J, np.ones(len(x), bool)

    return predict


def test_a_linear_model_gives_the_same_statistics_at_the_estimate_as_at_nominal():
    rng = np.random.default_rng(1)
    A = rng.standard_normal((50, 3, 2))
    y = rng.standard_normal((50, 3)) * SIGMA + A @ np.array([1.02, 0.97])

    def predict(theta, rows):
        return np.einsum("kjp,kp->kj", A[rows], theta), A[rows], np.ones(len(rows), bool)

    result = relinearise(predict, y, EstimatePrior(np.ones(2), np.eye(2) / 0.02**2), white_noise(SIGMA))
    assert result.converged.all()
    np.testing.assert_allclose(result.e, y - A @ np.ones(2), atol=1e-12)


def test_a_large_change_is_estimated_without_bias_only_when_relinearised():
    rng = np.random.default_rng(2)
    u = rng.uniform(0.5, 2.0, 400)
    predict = curved(u)
    truth = np.array([1.05, 0.96])
    y = predict(np.tile(truth, (400, 1)), np.arange(400))[0] + rng.standard_normal((400, 3)) * SIGMA
    noise, frame = (
        white_noise(SIGMA),
        ParameterFrame(("a", "b"), np.ones(2), np.full(2, 0.05)),
    )
    result = relinearise(predict, y, EstimatePrior(np.ones(2), np.eye(2) / 0.05**2), noise)
    assert result.converged.all()
    score = fisher_score(local_statistics(result.e, result.J, noise, frame))
    error = np.sqrt(np.diag(np.linalg.inv(score.information)))
    estimate = 1 + np.linalg.solve(score.information, score.b)
    assert np.all(np.abs(estimate - truth) < 4 * error)
    y0, J0, _ = predict(np.ones((400, 2)), np.arange(400))
    linear = fisher_score(local_statistics(y - y0, J0, noise, frame))
    assert np.any(np.abs(1 + np.linalg.solve(linear.information, linear.b) - truth) > 4 * error)


def test_windows_estimated_together_equal_windows_estimated_alone():
    rng = np.random.default_rng(3)
    u = rng.uniform(0.5, 2.0, 60)
    predict = curved(u)
    y = predict(np.tile([1.03, 0.98], (60, 1)), np.arange(60))[0] + rng.standard_normal((60, 3)) * SIGMA
    window = np.repeat([0, 1, 2], 20)
    precision, noise = np.eye(2) / 0.05**2, white_noise(SIGMA)
    together = relinearise(
        predict, y, EstimatePrior(np.ones(2), precision), noise, window=window, stop=Stop(tolerance=1e-6)
    )
    for w in range(3):
        rows = np.flatnonzero(window == w)
        alone = relinearise(
            curved(u[rows]), y[rows], EstimatePrior(np.ones(2), precision), noise, stop=Stop(tolerance=1e-6)
        )
        np.testing.assert_allclose(together.theta[w], alone.theta[0], rtol=1e-8)


def test_records_that_the_model_cannot_compute_are_left_out_and_marked():
    u = np.linspace(0.5, 2, 30)
    inner = curved(u)

    def predict(theta, rows):
        y, J, ok = inner(theta, rows)
        bad = rows == 4
        y[bad] = np.nan
        J[bad] = np.nan
        return y, J, ok & ~bad

    y = inner(np.tile([1.02, 1.0], (30, 1)), np.arange(30))[0]
    result = relinearise(predict, y, EstimatePrior(np.ones(2), np.eye(2) / 0.05**2), white_noise(SIGMA))
    assert result.converged.all() and not result.ok[4] and result.ok.sum() == 29
    assert np.isnan(result.e[4]).all()
    assert result.theta[0, 0] == pytest.approx(1.02, abs=2e-3)


def test_a_record_that_fails_only_at_the_estimate_is_given_up_when_it_is_one_of_many():
    u = np.linspace(0.5, 2, 60)
    inner = curved(u)

    def predict(theta, rows):
        y, J, ok = inner(theta, rows)
        return y, J, ok & ~((rows == 4) & (theta[:, 0] > 1.01))

    y = inner(np.tile([1.03, 0.99], (60, 1)), np.arange(60))[0]
    y[4] += 5.0  # must not matter
    result = relinearise(predict, y, EstimatePrior(np.ones(2), np.eye(2) / 0.05**2), white_noise(SIGMA))
    assert result.converged.all() and result.ok.sum() == 59 and not result.ok[4]
    np.testing.assert_allclose(result.theta[0], [1.03, 0.99], atol=2e-3)


def test_parameters_that_do_not_move_are_eliminated_as_linear_nuisance():
    rng = np.random.default_rng(4)
    A = rng.standard_normal((50, 3, 3))
    y = rng.standard_normal((50, 3)) * SIGMA + A @ np.array([1.02, 0.97, 1.01])

    def predict(theta, rows):
        return np.einsum("kjp,kp->kj", A[rows], theta), A[rows], np.ones(len(rows), bool)

    precision = np.diag([1, 1, 4]) / 0.02**2
    moved = relinearise(predict, y, EstimatePrior(np.ones(3), precision), white_noise(SIGMA))
    eliminated = relinearise(predict, y, EstimatePrior(np.ones(3), precision, moving=2), white_noise(SIGMA))
    np.testing.assert_allclose(eliminated.theta[0, :2], moved.theta[0, :2], rtol=1e-6)
    assert eliminated.theta[0, 2] == 1.0
    np.testing.assert_allclose(eliminated.e, moved.e, atol=1e-9)


def test_a_model_that_fails_away_from_nominal_is_reported_as_not_converged():
    def predict(theta, rows):
        fine = np.abs(theta[:, 0] - 1) < 1e-12
        return theta.copy(), np.ones((len(rows), 1, 1)), fine

    result = relinearise(
        predict, np.full((5, 1), 1.5), EstimatePrior(np.ones(1), np.eye(1)), white_noise(np.array([0.01]))
    )
    assert not result.converged.any()


def test_an_estimate_stays_within_the_physical_bounds():
    u = np.linspace(0.5, 2, 30)
    predict = curved(u)
    y = predict(np.tile([1.2, 1.0], (30, 1)), np.arange(30))[0]
    result = relinearise(
        predict,
        y,
        EstimatePrior(np.ones(2), np.eye(2) / 0.05**2, bounds=(np.full(2, 0.9), np.full(2, 1.1))),
        white_noise(SIGMA),
        stop=Stop(max_iterations=30),
    )
    assert result.theta[0, 0] == 1.1
    assert result.converged.all()


def test_a_step_beyond_a_bound_ends_there_and_the_others_follow_without_it():
    coupled = np.array([[[1.0, 0.9], [0.9, 1.0]]])
    step = bounded_steps(np.array([[10.0, 8.0]]), coupled, np.array([[-5.0, -20.0]]), np.array([[1.0, 20.0]]))
    assert step == pytest.approx(np.array([[1.0, 8.0 - 0.9]]))  # the second solves its own equation with the first at 1
    free = bounded_steps(np.array([[10.0, 8.0]]), coupled, np.full((1, 2), -np.inf), np.full((1, 2), np.inf))
    assert free == pytest.approx(np.linalg.solve(coupled[0], [10.0, 8.0])[None])
    alone = bounded_steps(
        np.array([[4.0, -6.0]]), np.array([np.diag([2.0, 2.0])]), np.full((1, 2), -1.0), np.full((1, 2), 3.0)
    )
    assert alone == pytest.approx(np.array([[2.0, -1.0]]))
