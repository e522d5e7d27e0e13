"""The curves by which a machine's map may be wrong: their size, where they end, and what fixes them."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.error_model.maps import (
    CURVES,
    EDGE,
    EDGE_CURVES,
    END,
    FINER,
    LARGEST,
    POSITION_DEGREE,
    SPEED_DEGREE,
    MapCurves,
    learn_curves,
)

SMOOTH = SPEED_DEGREE + POSITION_DEGREE
"""Curves of the range that training covered which are as large as a map's error is stated."""
WITHIN = [j for j in range(CURVES) if j not in EDGE_CURVES]
"""Curves of the range that training covered; the others begin beyond it."""
SIZES = np.where(np.arange(CURVES) < SMOOTH, 1.0, FINER)[WITHIN]
"""Of each of them."""

UNIT = MapCurves("hpc", (0.0, 0.0), (1.0, 1.0), (0.0, 0.0, 0.0, 0.0))


def trained(rng, n=400):
    """Coordinates (n, 2) of a machine that runs along a bent line of its map."""
    speed = rng.uniform(5.0, 5.6, n)
    return np.column_stack([speed, 1.0 + 2.0 * (speed - 5.3) ** 2 + 0.08 * rng.uniform(-1, 1, n)])


def test_each_curve_has_unit_mean_square_over_the_range_covered_the_finer_ones_less_and_no_mean():
    grid = np.linspace(-1, 1, 20_001)
    phi = UNIT.evaluate(np.column_stack([grid, grid]))[:, WITHIN] / SIZES
    np.testing.assert_allclose(np.mean(phi**2, axis=0), 1.0, atol=1e-3)
    np.testing.assert_allclose(phi.mean(axis=0), 0.0, atol=1e-3)  # a constant is the health parameter itself
    speed = np.delete(phi, range(SPEED_DEGREE, SMOOTH), axis=1)
    np.testing.assert_allclose(speed.T @ speed / len(grid), np.eye(speed.shape[1]), atol=1e-3)


def test_learnt_curves_are_about_as_large_over_the_records_that_they_were_learnt_from():
    coordinates = trained(np.random.default_rng(1))
    phi = learn_curves("hpc", coordinates).evaluate(coordinates)
    assert phi.shape == (400, CURVES)
    square = np.mean(phi**2, axis=0)
    within = square[WITHIN] / SIZES**2
    assert np.all((0.7 < within) & (within < 1.3))
    assert np.all(square[EDGE_CURVES] < 0.01)  # training knows next to nothing of what begins beyond it


def test_the_position_is_measured_beyond_its_line_over_speed():
    coordinates = trained(np.random.default_rng(2))
    phi = learn_curves("hpc", coordinates).evaluate(coordinates)
    assert abs(np.corrcoef(phi[:, 0], phi[:, 3])[0, 1]) < 0.1


def test_beyond_the_range_others_begin_up_to_the_end_and_those_of_training_stay():
    far = np.array([[END, END], [2 * END, 2 * END], [1e3, 1e3]])
    phi = UNIT.evaluate(far)
    np.testing.assert_array_equal(phi[1:], np.broadcast_to(phi[0], (2, CURVES)))
    inside = UNIT.evaluate(np.array([[1.0, 1.0]]))
    np.testing.assert_array_equal(phi[0, WITHIN], inside[0, WITHIN])
    assert np.all(inside[0, EDGE_CURVES] == 0.0)
    np.testing.assert_allclose(phi[0, EDGE_CURVES], EDGE * (END - 1.0))
    np.testing.assert_allclose(UNIT.evaluate(-far[:1])[0, EDGE_CURVES], -EDGE * (END - 1.0))


def test_a_gap_in_what_training_flew_is_left_as_open_as_smooth_errors_may_bend_there():
    """Waves of unit mean square, at every phase, known on either side of a gap from forty records with half as
    much noise: what curves say of its middle is right within their own standard deviation."""
    sides = np.concatenate([np.linspace(-1.0, -0.4, 40), np.linspace(0.4, 1.0, 40)])
    waves = np.arange(0.3, 1.21, 0.1)[:, None]  # over the range
    phases = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)
    frequency, phase = (v.ravel() for v in np.broadcast_arrays(waves, phases))

    def error(x):
        return np.sqrt(2.0) * np.sin(np.pi * np.outer(np.atleast_1d(x), frequency) + phase)

    def misses(curves):
        G = np.column_stack([np.ones(80), UNIT.evaluate(np.column_stack([sides, np.zeros(80)]))[:, curves]])
        prior = np.append(1e-4, np.ones(len(curves)))  # the constant is a health parameter
        covariance = np.linalg.inv(np.diag(prior) + 4.0 * G.T @ G)
        at = np.append(1.0, UNIT.evaluate(np.zeros((1, 2)))[0, curves])
        wrong = at @ covariance @ (4.0 * G.T @ error(sides)) - error(0.0)[0]
        return np.sqrt(np.mean(wrong**2) / (at @ covariance @ at))

    assert misses(WITHIN) < 1.0
    assert misses(list(range(SMOOTH))) > 2.0


def test_no_curve_is_anywhere_larger_than_its_largest_value_and_each_reaches_it():
    grid = np.linspace(-2.0, 2.0, 401)
    found = np.max(np.abs(UNIT.evaluate(np.array([[x, r] for x in grid for r in grid[::10]]))), axis=0)
    np.testing.assert_allclose(found, LARGEST)


def test_curves_are_frozen_at_training_and_survive_a_file():
    coordinates = trained(np.random.default_rng(3))
    curves = learn_curves("hpc", coordinates)
    again = MapCurves.from_mapping("hpc", curves.to_mapping())
    assert again == curves
    # what they are at a record does not depend on the records beside it
    np.testing.assert_array_equal(again.evaluate(coordinates[:7]), curves.evaluate(coordinates)[:7])


def test_one_operating_point_gives_finite_curves():
    coordinates = np.tile([[5.3, 1.0]], (50, 1))
    curves = learn_curves("hpc", coordinates)
    for at in (coordinates, coordinates + 0.02, coordinates - 3.0):
        phi = curves.evaluate(at)
        assert np.isfinite(phi).all() and np.abs(phi).max() < 25
    assert np.abs(curves.evaluate(coordinates)[:, [0, 2, 3]]).max() < 1e-6  # odd in the distance from that point


def test_a_record_without_coordinates_has_no_map_error_and_a_machine_without_any_no_curves():
    coordinates = trained(np.random.default_rng(4), 20)
    coordinates[3, 0] = coordinates[5, 1] = np.nan
    curves = learn_curves("hpc", coordinates)
    phi = curves.evaluate(coordinates)
    assert not phi[[3, 5]].any() and np.all(np.any(phi[[0, 1, 2, 4]] != 0, axis=1))
    assert learn_curves("hpc", np.full((5, 2), np.nan)) is None


@pytest.mark.parametrize("scale", [1e-3, 1.0])
def test_however_narrow_training_was_a_map_bends_over_five_per_cent_at_least(scale):
    rng = np.random.default_rng(5)
    curves = learn_curves("hpc", np.array([5.3, 1.0]) + scale * rng.uniform(-1, 1, (200, 2)))
    assert curves.reach[0] >= 0.05 and curves.reach[1] >= 0.05 * 0.999
