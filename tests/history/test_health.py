"""The path of health: what wear, washes and wrong instruments are for a margin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_history import PARAMETERS, T, make_history

from enginediag_cli.history.background import History
from enginediag_cli.history.engines import add_engine_level, add_shifts
from enginediag_cli.history.posterior import HealthPath, judge_history

SLOPE = np.array([-20.0, -5.0, -15.0])
"""Kelvins of margin used per unit of each health parameter: what falls uses margin."""


def path(history: History) -> HealthPath:
    found = judge_history(history, health=True).health
    assert found is not None
    return found


def used_by(found: HealthPath, *, total: bool = False) -> tuple[np.ndarray, np.ndarray]:
    return found.project_level(found.reading_slope(SLOPE), total=total)


def wear(size: float, onset: int = 8) -> np.ndarray:
    change = np.zeros((T, len(PARAMETERS)))
    change[onset:, 0] = size * np.arange(1, T - onset + 1) / (T - onset)
    return change


@pytest.mark.parametrize("size", [0.0, -0.05, -0.3, -1.5])
def test_margin_used_is_slope_times_health_within_its_interval(size: float) -> None:
    inside = []
    for seed in range(12):
        found = path(make_history(np.random.default_rng([seed, 5]), wear(size)))
        used, error = used_by(found)
        inside.append(abs(used[-1] - SLOPE[0] * size) < 1.96 * error[-1])
        assert error[-1] < 3.0 + 0.05 * abs(SLOPE[0] * size)  # no effect is known better than to a twentieth
    assert sum(inside) >= 9  # of twelve at 95 %: fewer have a chance of 1 in 5000


@pytest.mark.parametrize("size", [-0.05, -0.1, -0.4])
def test_wear_before_the_first_flight_is_counted_where_nominal_is_the_reference(size: float) -> None:
    """Event or not: what was there from the start is no zero that is known for certain."""
    inside = []
    for seed in range(12):
        change = np.zeros((T, len(PARAMETERS)))
        change[:, 0] = size
        used, error = used_by(path(make_history(np.random.default_rng([seed, 15]), change)))
        inside.append(abs(used[-1] - SLOPE[0] * size) < 1.96 * error[-1])
    assert sum(inside) >= 9  # of twelve at 95 %: fewer have a chance of 1 in 5000


def test_a_mixture_of_paths_has_the_mean_and_the_spread_of_both() -> None:
    """Moments of two normal laws: E C = Σ w C + Σ w (x − x̄)(x − x̄)ᵀ."""
    one, other = (path(make_history(np.random.default_rng([seed, 16]), wear(-1.0))) for seed in (0, 1))
    both = HealthPath.mixture([0.25, 0.75], [one, other])
    np.testing.assert_allclose(both.level, 0.25 * one.level + 0.75 * other.level)
    far = one.level[-1] - other.level[-1]
    expected = 0.25 * one.covariance[-1] + 0.75 * other.covariance[-1] + 0.25 * 0.75 * np.outer(far, far)
    np.testing.assert_allclose(both.covariance[-1], expected)
    np.testing.assert_allclose(HealthPath.mixture([0.5, 0.5], [one, one]).total_covariance, one.total_covariance)


def test_an_error_of_a_sensor_uses_no_margin() -> None:
    change = np.zeros((T, len(PARAMETERS)))
    change[8:, 4] = 3.0 * np.arange(1, T - 7) / (T - 8)
    found = path(make_history(np.random.default_rng([1, 6]), change))
    used, error = used_by(found)
    assert np.all(np.abs(used) < 2.5 * error) and error.max() < 3.0
    each, covariance = found.project_stretches(SLOPE)
    assert np.all(np.abs(each) < 4.0 * np.sqrt(np.diag(covariance)))


def test_maintenance_gives_back_what_it_restored() -> None:
    change = wear(-1.0, 2)
    change[14:, 0] += 0.6
    history = replace(make_history(np.random.default_rng([2, 7]), change), maintenance=(14,))
    found = path(history)
    (step,) = found.steps
    assert step.epoch == 14
    assert step.before[0] == pytest.approx(change[13, 0], abs=4 * 0.05)
    slope = found.reading_slope(SLOPE)
    gained, error = step.change @ slope, np.sqrt(slope @ step.covariance @ slope)
    assert abs(gained - SLOPE[0] * (change[14, 0] - change[13, 0])) < 2.5 * error


def test_stretches_are_the_flights_without_a_prior_of_the_course() -> None:
    found = path(make_history(np.random.default_rng([3, 8]), wear(-1.0)))
    each, covariance = found.project_stretches(SLOPE)
    truth = SLOPE[0] * wear(-1.0)[found.knots, 0]
    off = each - truth
    assert off @ np.linalg.solve(covariance, off) < 60.0  # χ² of 24


def test_the_total_has_the_level_that_the_engine_had_from_the_first_flight() -> None:
    change = wear(-1.0)
    change[:, 0] -= 0.4
    history = make_history(np.random.default_rng([4, 9]), change)
    found = path(add_engine_level(history))
    used, error = used_by(found)
    total, whole_error = used_by(found, total=True)
    assert abs(used[-1] - 20.0) < 2.5 * error[-1]
    assert abs(total[-1] - 28.0) < 2.5 * whole_error[-1] < 20.0  # its instruments may be wrong from the start, too


def test_what_is_known_to_have_moved_is_in_what_maintenance_brought() -> None:
    change = wear(-0.6, 2)
    change[14:, 0] += 0.5
    history = replace(make_history(np.random.default_rng([5, 10]), change), maintenance=(14,))
    moved = add_shifts(add_engine_level(history), (np.arange(T) >= 14).astype(float), {0: 0.5, 1: 0.5})
    found = path(moved)
    (step,) = found.steps
    slope = found.reading_slope(SLOPE)
    gained, error = step.change @ slope, np.sqrt(slope @ step.covariance @ slope)
    assert gained < -3.0 * error
    assert abs(gained - SLOPE[0] * (change[14, 0] - change[13, 0])) < 2.5 * error
