"""A linear model of normal sizes is a normal distribution of readings, and the mean of its sizes a ridge regression."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from enginediag_cli.mismatch.laws.linear import linear_evidence, linear_means, ln_mean


@pytest.fixture
def readings() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns (n, k), readings (n,) of unit noise, variances (w, k), one of them 0."""
    rng = np.random.default_rng(4)
    C = rng.standard_normal((30, 4))
    return C, C @ np.array([1.0, -2.0, 0.0, 0.5]) + rng.standard_normal(30), np.array([[1.0, 4.0, 0.1, 0.0], [9.0] * 4])


def test_evidence_is_that_of_the_normal_distribution_of_readings(readings) -> None:
    C, y, W = readings
    nothing = multivariate_normal(np.zeros(30), np.eye(30)).logpdf(y)
    for w, found in zip(W, linear_evidence(C.T @ C, C.T @ y, W), strict=True):
        assert found == pytest.approx(multivariate_normal(np.zeros(30), np.eye(30) + (C * w) @ C.T).logpdf(y) - nothing)


def test_means_are_those_of_ridge_regression(readings) -> None:
    C, y, W = readings
    found = linear_means(C.T @ C, C.T @ y, W)
    assert found[0, 3] == 0.0  # of no variance
    for w, a in zip(W, found, strict=True):
        held = w > 0.0
        rows = np.vstack([C[:, held], np.diag(w[held] ** -0.5)])
        assert a[held] == pytest.approx(np.linalg.lstsq(rows, np.r_[y, np.zeros(held.sum())], rcond=None)[0])


def test_the_mean_of_what_is_as_likely_is_the_same() -> None:
    assert ln_mean([-800.0, -800.0]) == pytest.approx(-800.0)
    assert ln_mean(np.log([0.1, 0.3])) == pytest.approx(np.log(0.2))
