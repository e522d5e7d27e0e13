"""The root of a covariance in mixed units."""

from __future__ import annotations

import numpy as np

from enginediag_cli.residuals.statistics import covariance_root

SCALE = np.array([3e-3, 2e-2, 3e5])
"""Error of a map, of an efficiency, and of a heating value in J/kg."""


def test_what_is_uncertain_in_a_small_unit_stays_beside_what_is_in_a_large_one():
    correlation = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.3], [0.2, 0.3, 1.0]])
    C = SCALE[:, None] * correlation * SCALE
    L = covariance_root(C, SCALE)
    np.testing.assert_allclose(L @ L.T / SCALE / SCALE[:, None], correlation, atol=1e-12)


def test_what_is_certain_has_no_column():
    L = covariance_root(np.diag([0.0, 4e-4, 9e10]), SCALE)
    assert L.shape == (3, 2) and not L[0].any()
    assert covariance_root(np.zeros((3, 3)), SCALE).shape == (3, 0)
