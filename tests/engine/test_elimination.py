"""Elimination of many small systems at once."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.engine.solver import directly, factors, substituted


def systems(k, n=400, seed=1):
    """Matrices (k, k, n) that need rows exchanged, and right-hand sides (k, n)."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(k, k, n))
    A[0, 0, ::3] = 0.0
    return A, rng.normal(size=(k, n))


@pytest.mark.parametrize("k", [1, 2, 5, 9])
def test_a_system_is_solved_as_lapack_solves_it(k):
    A, B = systems(k)
    if k == 1:
        A[A == 0.0] = 1.0
    expected = np.linalg.solve(A.transpose(2, 0, 1), B.T[:, :, None])[:, :, 0].T
    np.testing.assert_allclose(substituted(*factors(A), B), expected, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(directly(A, B), expected, rtol=1e-12)


def test_several_right_hand_sides_are_solved_as_one_by_one():
    A, B = systems(5)
    C = np.stack([B, 2.0 * B, B**2], axis=1)
    found = substituted(*factors(A), C)
    for j in range(3):
        assert np.array_equal(found[:, j], substituted(*factors(A), C[:, j]))


def test_a_point_does_not_depend_on_the_others():
    A, B = systems(6)
    whole = substituted(*factors(A), B)
    part = substituted(*factors(A[:, :, 7:58]), B[:, 7:58])
    assert np.array_equal(part, whole[:, 7:58])


@pytest.mark.parametrize("solve", [lambda A, B: substituted(*factors(A), B), directly])
def test_a_singular_matrix_spoils_its_own_point_only(solve):
    A, B = systems(4, n=20)
    expected = solve(A, B)
    A[:, :, 11] = 0.0
    found = solve(A, B)
    assert not np.isfinite(found[:, 11]).any()
    others = np.arange(20) != 11
    np.testing.assert_allclose(found[:, others], expected[:, others], rtol=1e-9)


def test_what_is_solved_is_left_as_it_was():
    A, B = systems(5)
    before = A.copy(), B.copy()
    substituted(*factors(A), B)
    directly(A, B)
    assert np.array_equal(A, before[0]) and np.array_equal(B, before[1])
