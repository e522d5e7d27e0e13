"""Local statistics of linear Gaussian data against closed forms, and their invariances."""

from __future__ import annotations

import numpy as np
import pytest
from white_statistics import local_statistics, white_noise

from enginediag_cli.residuals.instruments import NoiseModel
from enginediag_cli.residuals.score import fisher_score, marginalise
from enginediag_cli.residuals.statistics import LocalStatistics, ParameterFrame, block_statistics

NAMES = ("a", "b", "c")
N, M, P = 60, 4, 3


def draw(rng, n=N):
    J = rng.standard_normal((n, M, P))
    e = rng.standard_normal((n, M))
    return e, J


def statistics(e, J, noise, **options) -> LocalStatistics:
    p = J.shape[2]
    return local_statistics(e, J, noise, ParameterFrame(tuple("abcdefgh"[:p]), np.ones(p), np.full(p, 0.02)), **options)


def test_white_statistics_are_the_sums_of_the_definition():
    rng = np.random.default_rng(1)
    e, J = draw(rng)
    sigma = np.array([0.5, 1.0, 2.0, 3.0])
    found = statistics(e, J, white_noise(sigma))
    R = np.diag(sigma**-2.0)
    np.testing.assert_allclose(found.s, sum(Jk.T @ R @ ek for Jk, ek in zip(J, e, strict=True)))
    np.testing.assert_allclose(found.F, sum(Jk.T @ R @ Jk for Jk in J))
    np.testing.assert_array_equal(found.V, found.F)
    assert found.chi2 == pytest.approx(np.sum((e / sigma) ** 2))
    assert (found.n, found.dof) == (N, N * M)


def test_a_missing_reading_drops_its_row_and_nothing_else():
    rng = np.random.default_rng(2)
    e, J = draw(rng)
    e[5, 2] = np.nan
    e[7] = np.nan
    found = statistics(e, J, white_noise(np.ones(M)))
    keep = np.isfinite(e)
    np.testing.assert_allclose(found.F, J[keep].T @ J[keep])
    assert (found.n, found.dof) == (N - 1, N * M - 5)


def test_a_full_noise_covariance_weights_with_its_inverse_also_when_a_sensor_is_missing():
    rng = np.random.default_rng(3)
    e, J = draw(rng)
    A = rng.standard_normal((M, M))
    R = A @ A.T + np.eye(M)
    e[4, 1] = np.nan
    found = statistics(e, J, NoiseModel(np.sqrt(np.diag(R)), np.zeros(M), R))
    F = np.zeros((P, P))
    for k in range(N):
        there = np.flatnonzero(np.isfinite(e[k]))
        F += J[k, there].T @ np.linalg.inv(R[np.ix_(there, there)]) @ J[k, there]
    np.testing.assert_allclose(found.F, F)


def test_V_of_correlated_noise_is_the_double_sum_over_all_pairs_of_records():
    rng = np.random.default_rng(4)
    e, J = draw(rng, 40)
    e[10:12, 0] = np.nan
    lags = np.ones(40)
    lags[20], lags[30] = 3, np.inf
    noise = NoiseModel(np.array([0.5, 1.0, 2.0, 3.0]), np.array([0.9, 0.0, 0.5, 0.99]))
    found = statistics(e, J, noise, lags=lags)
    time = np.cumsum(np.where(np.isinf(lags), 1e9, lags))
    V = np.zeros((P, P))
    for j in range(M):
        g = np.where(np.isfinite(e[:, j, None]), J[:, j], 0) / (noise.sigma[j] * np.sqrt(noise.inflation[j]))
        correlation = noise.rho[j] ** np.abs(time[:, None] - time)
        V += g.T @ correlation @ g / noise.inflation[j]
    np.testing.assert_allclose(found.V, V, rtol=1e-10)


def test_V_tends_to_F_for_correlated_noise_at_a_constant_operating_point():
    rng = np.random.default_rng(5)
    J = np.tile(rng.standard_normal((1, M, P)), (20_000, 1, 1))
    found = statistics(np.zeros((20_000, M)), J, NoiseModel(np.ones(M), np.array([0.9, 0.5, 0.0, 0.8])))
    np.testing.assert_allclose(found.V, found.F, rtol=3e-3)


def test_blocks_add_up_exactly_to_the_whole_however_they_are_cut():
    rng = np.random.default_rng(6)
    e, J = draw(rng)
    e[13, 0] = np.nan
    noise = NoiseModel(np.ones(M), np.array([0.95, 0.5, 0.0, 0.7]))
    whole = statistics(e, J, noise)
    frame = ParameterFrame(NAMES, np.ones(P), np.full(P, 0.02))
    blocks = list(block_statistics(e, J, noise, np.array([0, 1, 2, 17, 40]), frame))
    together = blocks[0] + (blocks[1] + blocks[2]) + (blocks[3] + blocks[4])
    for name in ("s", "F", "V", "n", "chi2", "dof"):
        np.testing.assert_allclose(getattr(together.statistics, name), getattr(whole, name), rtol=1e-10)


def test_statistics_of_two_recordings_add_to_those_of_both():
    rng = np.random.default_rng(7)
    e, J = draw(rng)
    noise = NoiseModel(np.ones(M), np.full(M, 0.8))
    lags = np.ones(N)
    lags[30] = np.inf
    whole = statistics(e, J, noise, lags=lags)
    halves = statistics(e[:30], J[:30], noise) + statistics(e[30:], J[30:], noise)
    np.testing.assert_allclose(halves.V, whole.V, rtol=1e-12)
    np.testing.assert_allclose(halves.s, whole.s, rtol=1e-12)


def test_statistics_about_different_points_do_not_add():
    rng = np.random.default_rng(8)
    e, J = draw(rng)
    here = statistics(e, J, white_noise(np.ones(M)))
    there = local_statistics(e, J, white_noise(np.ones(M)), ParameterFrame(NAMES, np.full(P, 1.1), np.full(P, 0.02)))
    with pytest.raises(ValueError, match="nominal"):
        here + there


def test_the_test_statistic_does_not_depend_on_units_or_order():
    rng = np.random.default_rng(9)
    e, J = draw(rng)
    noise = NoiseModel(np.ones(M), np.array([0.9, 0.5, 0.0, 0.8]))
    t = fisher_score(statistics(e, J, noise)).glr
    unit = np.array([1e-5, 1.0, 1e6])  # parameters in other units
    rescaled = local_statistics(e, J / unit, noise, ParameterFrame(NAMES, unit, 0.02 * unit))
    assert fisher_score(rescaled).glr == pytest.approx(t, rel=1e-9)
    sensor = np.array([1e5, 1.0, 0.01, 3.0])  # sensors in other units
    other = NoiseModel(noise.sigma * sensor, noise.rho)
    assert fisher_score(statistics(e * sensor, J * sensor[:, None], other)).glr == pytest.approx(t, rel=1e-9)
    order = [2, 0, 1]
    assert fisher_score(statistics(e, J[:, :, order], noise)).glr == pytest.approx(t, rel=1e-9)


def test_t_equals_s_Vinv_s_when_all_parameters_are_excited():
    rng = np.random.default_rng(10)
    e, J = draw(rng)
    found = statistics(e, J, NoiseModel(np.ones(M), np.array([0.9, 0.5, 0.0, 0.8])))
    score = fisher_score(found)
    assert score.rank == P
    assert score.glr == pytest.approx(found.s @ np.linalg.solve(found.V, found.s), rel=1e-9)
    Vinv = np.linalg.inv(found.V)
    np.testing.assert_allclose(score.information, found.F @ Vinv @ found.F, rtol=1e-8)
    np.testing.assert_allclose(score.b, found.F @ Vinv @ found.s, rtol=1e-8)


def test_parameters_that_are_not_excited_leave_the_degrees_of_freedom_and_are_named():
    rng = np.random.default_rng(11)
    e, J = draw(rng)
    J[:, :, 2] = 2 * J[:, :, 0]
    found = statistics(e, J, white_noise(np.ones(M) * 1e-3))
    score = fisher_score(found)
    plain = fisher_score(statistics(e, J[:, :, :2], white_noise(np.ones(M) * 1e-3)))
    assert score.rank == 2
    assert score.glr == pytest.approx(plain.glr, rel=1e-8)
    (dark,) = found.unexcited()
    assert set(dark.weights) == {"a", "c"}
    assert dark.weights["a"] / dark.weights["c"] == pytest.approx(-2.0)
    assert dark.information < 1e-6


def test_uncertainty_of_nominal_is_the_same_as_noise_of_its_covariance():
    rng = np.random.default_rng(12)
    e, J = draw(rng)
    found = statistics(e, J, white_noise(np.ones(M)))
    A = rng.standard_normal((P, P)) * 0.1
    C = A @ A.T
    score = fisher_score(found, monitored=("a", "b"), uncertainty=C)
    G = J.reshape(-1, P)
    R = np.eye(N * M) + G @ C @ G.T  # covariance of all residuals at once
    Ga = G[:, :2]
    np.testing.assert_allclose(score.b, Ga.T @ np.linalg.solve(R, e.ravel()), rtol=1e-8)
    np.testing.assert_allclose(score.information, Ga.T @ np.linalg.solve(R, Ga), rtol=1e-8)
    reduced = marginalise(found, ("a", "b"), C)
    assert reduced.chi2 == pytest.approx(e.ravel() @ np.linalg.solve(R, e.ravel()), rel=1e-9)
    assert fisher_score(reduced).glr == pytest.approx(score.glr, rel=1e-9)


def test_units_of_uncertain_parameters_do_not_matter():
    rng = np.random.default_rng(12)
    e, J = draw(rng)
    A = rng.standard_normal((P, P)) * 0.1
    C = A @ A.T
    unit = np.array([1.0, 1.0, 1e9])[:P]  # a heating value in J/kg beside efficiencies
    plain, scaled = (
        marginalise(
            local_statistics(
                e,
                J / u,
                white_noise(np.ones(M)),
                ParameterFrame(NAMES, np.zeros(P), u),
            ),
            ("a", "b"),
            C * u * u[:, None],
        )
        for u in (np.ones(P), unit)
    )
    assert scaled.chi2 == pytest.approx(plain.chi2, rel=1e-9)


def test_a_sensor_offset_of_unknown_size_takes_that_sensor_out_of_the_test():
    rng = np.random.default_rng(13)
    J = np.tile(rng.standard_normal((1, M, P)), (N, 1, 1))
    offset = np.zeros((N, M, 1))
    offset[:, 0] = 1.0
    e = rng.standard_normal((N, M))
    found = local_statistics(
        e,
        np.concatenate([J, offset], axis=2),
        white_noise(np.ones(M)),
        ParameterFrame((*NAMES, "offset"), np.zeros(4), np.ones(4)),
    )
    C = np.diag([0, 0, 0, 1e8])
    without = e.copy()
    without[:, 0] = np.nan
    alone = fisher_score(statistics(without, J, white_noise(np.ones(M))))
    assert fisher_score(found, monitored=NAMES, uncertainty=C).glr == pytest.approx(alone.glr, rel=1e-4)
