"""The score test against what it stands for: exact falls of χ², generalised least squares, and brute force."""

import numpy as np
import pytest
from concealed import WholeRows, carried, evidence, flights, turbofan
from scipy import stats

from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.held_out import held_out_objectives
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.options import effect_option, option_scores
from enginediag_cli.mismatch.fit.projection import DenseRows, Projection
from enginediag_cli.mismatch.fit.scores import critical_surprise, surprise
from enginediag_cli.physics.registry import effect


def _fit(recorded, **settings):
    e = evidence(recorded, **settings)
    along = nuisance(e)
    found = identify_with(e, NULL_HYPOTHESIS, along)
    assert found.converged
    return found, along, Projection(found)


@pytest.fixture(scope="module")
def small_effect():
    rng = np.random.default_rng(11)
    return _fit(flights(carried(("reynolds_efficiency", "hpc", {"exponent": 0.03})), rng))


def test_the_score_foretells_the_fall_of_the_objective(small_effect):
    found, along, projection = small_effect
    option = effect_option(effect(turbofan(), "reynolds_efficiency", "hpc"))
    (score,) = option_scores(found, projection, [option])
    refitted = attempt([option], found, along)
    fall = projection.objective - refitted.objective
    assert score.score.statistic == pytest.approx(fall, rel=0.08, abs=0.3)
    value, error = refitted.coefficients["reynolds_efficiency.hpc.exponent"]
    assert abs(value - 0.03) < 3 * error


def test_whitened_scores_are_those_of_generalised_least_squares():
    rho = 0.7
    recorded = flights([], np.random.default_rng(5), count=2, records=30, rho=rho)
    found, _, projection = _fit(recorded, rho=rho)
    v = np.random.default_rng(6).standard_normal((60, 9, 1))
    rows = projection.frame.rows(v)[:, 0]
    # each record is correlated with the one before it, by as much as their operating points allow
    lag = projection.frame.correlation()[:, 0]
    assert (lag[[0, 30]] == 0).all() and lag.max() == pytest.approx(rho)
    V = np.eye(60)
    for k in range(1, 60):
        V[k, :k] = V[:k, k] = lag[k] * V[k - 1, :k]
    direct = sum(v[:, s, 0] @ np.linalg.solve(V, v[:, s, 0]) / found.problem.sigma[s] ** 2 for s in range(9))
    assert rows @ rows == pytest.approx(direct, rel=1e-12)


def test_held_out_residuals_are_those_of_refits_without_the_flight(small_effect):
    _, _, projection = small_effect
    frame, n = projection.frame, len(projection.frame.record)
    dense = WholeRows(projection)
    A = dense.Q @ dense.R
    direct = []
    for r in range(5):
        out = np.zeros(len(dense.e), bool)
        out[:n] = projection.found.problem.recording[frame.record] == r
        x = np.linalg.lstsq(A[~out], dense.e[~out], rcond=None)[0]
        e = dense.e[out] - A[out] @ x
        direct.append(e @ e)
    np.testing.assert_allclose(held_out_objectives(projection), direct, rtol=1e-7)


def test_the_gate_of_one_block_is_its_chi_square_quantile():
    (gate,) = critical_surprise(np.eye(1), [1], [0.05], np.random.default_rng(2))
    # 2000 draws: the 5 % point is uncertain by sqrt(.05*.95/2000)/.05 = 10 %, 0.3 at three deviations
    assert gate == pytest.approx(-np.log(0.05), abs=0.3)


@pytest.mark.parametrize("dof", [1, 2, 3, 6])
def test_surprise_is_minus_ln_p_and_does_not_underflow(dof):
    T = np.array([0.1, 3.0, 40.0, 600.0])
    np.testing.assert_allclose(surprise(T, dof), -stats.chi2.logsf(T, dof), rtol=1e-9)
    far = surprise(np.array([5e3, 2e4]), dof)
    assert np.isfinite(far).all() and far[1] > far[0] > 2000


def test_the_objective_without_anything_missing_is_chi_square():
    _, _, projection = _fit(flights([], np.random.default_rng(21)))
    # sd of χ² over its dof is sqrt(2/2700) = 2.7 %: three deviations
    assert projection.objective / projection.dof == pytest.approx(1.0, abs=0.082)


def test_a_column_taken_out_of_the_span_leaves_the_basis_of_the_others(small_effect):
    _, _, projection = small_effect
    whole, dense = WholeRows(projection), DenseRows(projection)
    A, column = whole.Q @ whole.R, 7
    dense.free(column)
    others = np.delete(np.delete(A, column, axis=1), projection.dof + column, axis=0)
    Q = np.concatenate([dense.rows[projection.frame.keep], dense.priors])
    np.testing.assert_allclose(Q.T @ Q, np.eye(Q.shape[1]), atol=1e-9)
    np.testing.assert_allclose(Q @ (Q.T @ others), others, atol=1e-9 * np.abs(others).max())
