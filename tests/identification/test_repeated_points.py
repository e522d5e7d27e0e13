"""Records of one operating point share the model's error there."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.map_error import LEAST_WORTH, assign_cells, misfit_inflation

POINTS = np.array([[300.0, 1e5], [400.0, 2e5], [500.0, 3e5], [600.0, 6e5]])
SIGMA = np.array([1.0, 500.0])


def conditions(n=2000, seed=0):
    """Predictions of n records at four operating points, and which point each is at."""
    rng = np.random.default_rng(seed)
    at = rng.integers(0, 4, n)
    return POINTS[at] * (1 + 1e-4 * rng.standard_normal((n, 2))), at


def test_a_condition_that_is_flown_again_and_again_is_one_cell():
    predicted, at = conditions()
    cell = assign_cells(predicted)
    assert len(np.unique(cell)) == 4
    assert all(len(np.unique(cell[at == k])) == 1 for k in range(4))


def test_a_sweep_of_power_is_cut_into_cells():
    sweep = np.linspace(1.0, 2.0, 1000)[:, None] * POINTS[0]
    assert 9 <= len(np.unique(assign_cells(sweep))) <= 12


def test_records_count_in_full_where_the_model_fits():
    predicted, _ = conditions()
    noise = np.random.default_rng(1).standard_normal(predicted.shape) * SIGMA
    kappa = misfit_inflation(predicted, noise, SIGMA, np.ones(2), np.zeros(2))
    assert kappa == pytest.approx([1.0, 1.0])


def test_an_error_of_each_point_counts_once_whatever_the_number_of_its_records():
    predicted, at = conditions(8000)
    error = np.array([2.0, -1.0, -2.0, 1.0])[at, None] * SIGMA * [0.1, 0.0]
    noise = np.random.default_rng(2).standard_normal(predicted.shape) * SIGMA
    kappa = misfit_inflation(predicted, noise + error, SIGMA, np.ones(2), np.zeros(2))
    assert kappa[0] == pytest.approx(1 + 2000 * 0.025, rel=0.35)  # n̄ = 2000 and σ_m² = 0.025 σ²
    assert kappa[1] == pytest.approx(1.0)


def test_a_cell_is_never_worth_less_than_a_few_readings():
    predicted, at = conditions()
    error = np.array([2.0, -1.0, -2.0, 1.0])[at, None] * 100 * SIGMA
    kappa = misfit_inflation(predicted, error, SIGMA, np.ones(2), np.zeros(2))
    assert kappa == pytest.approx(np.full(2, 500 / LEAST_WORTH), rel=0.02)
