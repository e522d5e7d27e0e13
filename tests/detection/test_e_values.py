"""E-values of engines, and the list of those that stand out."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from scipy.integrate import dblquad

from enginediag_cli.detection import sequential as e_values
from enginediag_cli.detection.sequential import (
    CONDITIONS,
    LEVEL,
    FlightReadings,
    SuspectDirections,
    _courses,
    _whiten,
    e_path,
    flag_engines,
    onset_posterior,
)
from enginediag_cli.detection.sequential import SCATTER_LAWS as LAWS

M = 4
DIRECTIONS = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [1, -2, 3, 1], [0.5, 1, 0, -1]])
SUSPECTS = SuspectDirections(DIRECTIONS, np.full(4, 0.25))


def rows(z: np.ndarray) -> FlightReadings:
    return FlightReadings(z, np.zeros((len(z), 0)), np.ones(len(z)))


def test_the_list_is_what_the_definition_says():
    rng = np.random.default_rng(1)
    for _ in range(200):
        e = np.exp(rng.normal(1.0, 3.0, 12))
        best = [k for k in range(1, 13) if np.sum(e >= 12 / (k * 0.1)) >= k]
        expected = e >= 12 / (max(best) * 0.1) if best else np.zeros(12, bool)
        np.testing.assert_array_equal(flag_engines(np.log(e), 0.1), expected)


def test_an_engine_without_an_e_value_counts_and_is_not_listed():
    log_e = np.log([500.0, 30.0, 1.0])
    assert flag_engines(log_e, 0.1).tolist() == [True, True, False]
    assert flag_engines(np.append(log_e, [np.nan] * 7), 0.1).tolist() == [True, False] + [False] * 8
    with pytest.raises(ValueError, match="between 0 and 1"):
        flag_engines(log_e, 5.0)


def test_e_knows_neither_level_nor_scatter_of_the_readings():
    rng = np.random.default_rng(2)
    z = rng.standard_normal((80, M))
    z[50:] += DIRECTIONS[2]
    T = np.tril(rng.standard_normal((M, M))) + 3 * np.eye(M)
    found = e_path(rows(z), SUSPECTS, 10)
    moved = e_path(rows(z @ T.T + 100.0), SuspectDirections(DIRECTIONS @ T.T, SUSPECTS.weights), 10)
    assert found.log_e[-1] > 2.0
    np.testing.assert_allclose(moved.log_e, found.log_e, atol=2e-2)  # the level has a variance of a million
    np.testing.assert_allclose(moved.suspect, found.suspect, atol=1e-3)


def test_the_ratio_along_a_direction_is_that_of_the_regression_with_the_right_haar_prior():
    """Two readings, the second of which does not see the change: z₁ on z₂ and the course, by numerical integration."""
    rng = np.random.default_rng(3)
    n, kappa = 9, 0.4
    v, h = rng.standard_normal((n, 2)), (np.arange(n) >= 5).astype(float)
    A, c, gamma = v.T @ v, h @ v, h @ h
    inverse = np.linalg.inv(A)
    a, b = inverse[0, 0], (c @ inverse)[0]
    left = gamma - c @ inverse @ c + b**2 / a
    explained = b**2 / a
    closed = -0.5 * np.log(1 + kappa * left) - 0.5 * (n - 1) * np.log(1 - kappa * explained / (1 + kappa * left))

    def density(delta: float, log_sigma: float, beta_integrated: bool, with_change: bool) -> float:
        sigma = np.exp(log_sigma)
        y, x = v[:, 0] - (delta * h if with_change else 0.0), v[:, 1]
        rss = y @ y - (y @ x) ** 2 / (x @ x)
        prior = np.exp(-0.5 * delta**2 / (kappa * sigma**2)) / np.sqrt(2 * np.pi * kappa * sigma**2)
        return float(sigma ** -(n - 1) * np.exp(-0.5 * rss / sigma**2) * prior)

    with_change = dblquad(lambda d, s: density(d, s, True, True), -3, 3, -12, 12)[0]
    without = dblquad(lambda d, s: density(d, s, True, False), -3, 3, -60, 60)[0]
    assert closed == pytest.approx(np.log(with_change / without), abs=1e-3)


@pytest.mark.parametrize("baseline", [6, 15])
def test_e_has_mean_one_at_most_when_nothing_changes_whatever_the_scatter(baseline):
    rng = np.random.default_rng(4)
    found = []
    for _ in range(250):
        T = rng.standard_normal((M, M)) * np.exp(rng.normal(0, 1, M))
        found.append(e_path(rows(rng.standard_normal((40, M)) @ T.T), SUSPECTS, baseline).log_e)
    e, highest = np.exp([x[-1] for x in found]), np.max(found, axis=1)
    assert np.mean(e) < 1 + 3 * np.std(e) / np.sqrt(len(e))
    assert np.sum(highest >= np.log(20)) <= 20  # 12.5 expected at most, Ville


def test_nothing_is_concluded_from_a_single_flight():
    rng = np.random.default_rng(5)
    z = rng.standard_normal((40, M))
    z[-1] += 50.0
    assert e_path(rows(z), SUSPECTS, 20).log_e[-1] < np.log(1000)


def test_the_onset_and_the_suspect_of_a_change_are_found():
    rng = np.random.default_rng(6)
    z = rng.standard_normal((80, M))
    z[50:] += 4 * DIRECTIONS[1]
    found = e_path(rows(z), SUSPECTS, 20)
    assert found.log_e[-1] > 6 and found.log_e[45] < 2
    assert abs(int(np.argmax(found.onset)) - 50) <= 4 and found.growing < 0.5
    assert int(np.argmax(found.suspect)) == 1


def test_until_there_are_more_flights_than_readings_e_is_one():
    z = np.random.default_rng(7).standard_normal((8, M))
    z[3:] += 30.0
    found = e_path(rows(z), SUSPECTS, 2)
    np.testing.assert_array_equal(found.log_e[: M + 1], 0.0)
    with pytest.raises(ValueError, match="finite"):
        e_path(rows(np.full((8, M), np.nan)), SUSPECTS, 2)


def test_the_weights_of_onsets_sum_to_one():
    assert np.sum(e_values.onset_weight(np.arange(1e6), e_values.FROM_FIRST_FLIGHT)) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("law", LAWS)
def test_whitening_in_steps_is_the_factor_of_the_whole_covariance(law):
    rng = np.random.default_rng(5)
    n, m, c = 90, 4, 3
    rows = FlightReadings(rng.standard_normal((n, m)), rng.standard_normal((n, c)), rng.uniform(0.4, 1.0, n))
    among, (share, length, _) = _courses(n, 12), law
    t = np.arange(n)
    K = (1 - share) * np.eye(n) + share * np.exp(-np.abs(t[:, None] - t) / length)
    K += LEVEL + CONDITIONS * rows.conditions @ rows.conditions.T
    L = np.linalg.cholesky(K * rows.weight * rows.weight[:, None])
    found = _whiten(rows, among, share, length)
    np.testing.assert_allclose(L @ found.v, rows.z * rows.weight[:, None], rtol=0, atol=1e-6)
    np.testing.assert_allclose(L @ found.h.T, among.g.T * rows.weight[:, None], rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.log_scale, np.log(np.diag(L)), rtol=0, atol=1e-7)


@pytest.mark.parametrize(("onset", "size"), [(300, 1.5), (21, 2.0), (495, 3.0), (250, 0.6)])
def test_since_when_is_the_same_whether_all_onsets_are_looked_at_or_few_and_then_those_nearby(onset, size, monkeypatch):
    z = np.random.default_rng(8).standard_normal((500, M))
    z[onset:, 1] += size
    few = onset_posterior(rows(z), SUSPECTS, 20)
    monkeypatch.setattr(e_values, "ONSETS", 1000)
    every = onset_posterior(rows(z), SUSPECTS, 20)
    assert np.abs(np.cumsum(few - every)).max() < 0.1  # where it is wide, every third onset says as much
    assert few.sum() == pytest.approx(1.0)


def test_memory_of_a_long_history_grows_with_its_flights_and_not_with_their_square():
    rng = np.random.default_rng(6)
    suspects = SuspectDirections(np.eye(3), np.full(3, 1 / 3))

    def peak(n: int) -> int:
        rows = FlightReadings(rng.standard_normal((n, 3)), rng.standard_normal((n, 2)), np.ones(n))
        tracemalloc.start()
        try:
            e_path(rows, suspects, 10)
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    peak(100)  # what is imported on the way
    assert peak(6000) < 4 * peak(2000)  # three times the flights, and somewhat more onsets
