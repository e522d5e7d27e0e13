"""The curves by which a machine's map may be wrong: their size, where they end, and what fixes them."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.error_model.curves import (
    CURVES,
    EDGE,
    END,
    LARGEST,
    POSITION_DEGREE,
    SPEED_DEGREE,
    MapCurves,
    learn_curves,
)

WITHIN = SPEED_DEGREE + POSITION_DEGREE
"""Curves of the range that training covered; the others begin beyond it."""

UNIT = MapCurves("hpc", (0.0, 0.0), (1.0, 1.0), (0.0, 0.0, 0.0, 0.0))


def trained(rng, n=400):
    """Coordinates (n, 2) of a machine that runs along a bent line of its map."""
    speed = rng.uniform(5.0, 5.6, n)
    return np.column_stack([speed, 1.0 + 2.0 * (speed - 5.3) ** 2 + 0.08 * rng.uniform(-1, 1, n)])


def test_each_curve_has_unit_mean_square_over_the_range_covered_and_no_mean():
    grid = np.linspace(-1, 1, 20_001)
    phi = UNIT.at(np.column_stack([grid, grid]))[:, :WITHIN]
    np.testing.assert_allclose(np.mean(phi**2, axis=0), 1.0, atol=1e-3)
    np.testing.assert_allclose(phi.mean(axis=0), 0.0, atol=1e-3)  # a constant is the health parameter itself
    along = phi[:, :3].T @ phi[:, :3] / len(grid)
    np.testing.assert_allclose(along, np.eye(3), atol=1e-3)


def test_learnt_curves_are_about_as_large_over_the_records_that_they_were_learnt_from():
    coordinates = trained(np.random.default_rng(1))
    phi = learn_curves("hpc", coordinates).at(coordinates)
    assert phi.shape == (400, CURVES)
    square = np.mean(phi**2, axis=0)
    assert np.all((0.7 < square[:WITHIN]) & (square[:WITHIN] < 1.3))
    assert np.all(square[WITHIN:] < 0.01)  # training knows next to nothing of what begins beyond it


def test_the_position_is_measured_beyond_its_line_over_speed():
    coordinates = trained(np.random.default_rng(2))
    phi = learn_curves("hpc", coordinates).at(coordinates)
    assert abs(np.corrcoef(phi[:, 0], phi[:, 3])[0, 1]) < 0.1


def test_beyond_the_range_others_begin_up_to_the_end_and_those_of_training_stay():
    far = np.array([[END, END], [2 * END, 2 * END], [1e3, 1e3]])
    phi = UNIT.at(far)
    np.testing.assert_array_equal(phi[1:], np.broadcast_to(phi[0], (2, CURVES)))
    inside = UNIT.at(np.array([[1.0, 1.0]]))
    np.testing.assert_array_equal(phi[0, :WITHIN], inside[0, :WITHIN])
    assert np.all(inside[0, WITHIN:] == 0.0)
    np.testing.assert_allclose(phi[0, WITHIN:], EDGE * (END - 1.0))
    np.testing.assert_allclose(UNIT.at(-far[:1])[0, WITHIN:], -EDGE * (END - 1.0))


def test_no_curve_is_anywhere_larger_than_its_largest_value_and_each_reaches_it():
    grid = np.linspace(-2.0, 2.0, 401)
    found = np.max(np.abs(UNIT.at(np.array([[x, r] for x in grid for r in grid[::10]]))), axis=0)
    np.testing.assert_allclose(found, LARGEST)


def test_curves_are_frozen_at_training_and_survive_a_file():
    coordinates = trained(np.random.default_rng(3))
    curves = learn_curves("hpc", coordinates)
    again = MapCurves.from_mapping("hpc", curves.as_mapping())
    assert again == curves
    # what they are at a record does not depend on the records beside it
    np.testing.assert_array_equal(again.at(coordinates[:7]), curves.at(coordinates)[:7])


def test_one_operating_point_gives_finite_curves():
    coordinates = np.tile([[5.3, 1.0]], (50, 1))
    curves = learn_curves("hpc", coordinates)
    for at in (coordinates, coordinates + 0.02, coordinates - 3.0):
        phi = curves.at(at)
        assert np.isfinite(phi).all() and np.abs(phi).max() < 25
    assert np.abs(curves.at(coordinates)[:, [0, 2, 3]]).max() < 1e-6  # odd in the distance from that point


def test_a_record_without_coordinates_has_no_map_error_and_a_machine_without_any_no_curves():
    coordinates = trained(np.random.default_rng(4), 20)
    coordinates[3, 0] = coordinates[5, 1] = np.nan
    curves = learn_curves("hpc", coordinates)
    phi = curves.at(coordinates)
    assert not phi[[3, 5]].any() and np.all(np.any(phi[[0, 1, 2, 4]] != 0, axis=1))
    assert learn_curves("hpc", np.full((5, 2), np.nan)) is None


@pytest.mark.parametrize("scale", [1e-3, 1.0])
def test_however_narrow_training_was_a_map_bends_over_five_per_cent_at_least(scale):
    rng = np.random.default_rng(5)
    curves = learn_curves("hpc", np.array([5.3, 1.0]) + scale * rng.uniform(-1, 1, (200, 2)))
    assert curves.reach[0] >= 0.05 and curves.reach[1] >= 0.05 * 0.999
