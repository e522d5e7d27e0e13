"""The least noise that rounding of the readings leaves."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.noise import quantisation_sigma


def test_rounding_to_a_step_leaves_the_scatter_of_a_uniform_error():
    rng = np.random.default_rng(1)
    exact = rng.uniform(100, 110, 4000)
    rounded = np.round(exact / 0.05) * 0.05
    assert quantisation_sigma(rounded[:, None])[0] == pytest.approx(np.std(rounded - exact), rel=0.03)


def test_fine_readings_are_not_held_back_and_missing_ones_do_not_count():
    readings = np.random.default_rng(2).normal(300.0, 1.0, (2000, 1))
    readings[::7] = np.nan
    assert quantisation_sigma(readings)[0] < 1e-3


def test_the_same_number_written_twice_is_not_a_step():
    readings = np.array([[0.1 + 0.2], [0.3], [0.4], [np.nan]])
    assert quantisation_sigma(readings)[0] == pytest.approx(0.1 / np.sqrt(12))


def test_a_reading_that_never_changes_has_no_known_step():
    assert quantisation_sigma(np.full((5, 1), 7.0))[0] == 0.0
    assert quantisation_sigma(np.full((5, 1), np.nan))[0] == 0.0
