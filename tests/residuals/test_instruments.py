"""Instruments that are stuck or scatter: found by laws that have closed forms, and never in good readings."""

from __future__ import annotations

import numpy as np
import pytest
from white_statistics import white_noise

from enginediag_cli.recordings.repeated import StuckRun, append_runs, list_stuck_runs
from enginediag_cli.residuals.instruments import (
    NoiseModel,
    ScatterEstimate,
    apply_weights,
    find_scatter,
    find_stuck_faults,
    find_stuck_inputs,
    find_stuck_outputs,
    identical_runs,
    scatter_weights,
)

SIGMA = np.array([2.0, 0.5, 30.0, 1.0])
M = len(SIGMA)
ALONG = np.array([3.0, -0.5, 40.0, 2.0])
"""What a unit of the only input does to the four readings."""


def effects(n: int) -> np.ndarray:
    """Of the four sensors and the input: (n, 4, 5)."""
    return np.tile(np.column_stack([np.eye(M), ALONG]), (n, 1, 1))


def found(e: np.ndarray, noise: NoiseModel | None = None, nominal: float | np.ndarray = 0.0) -> list[ScatterEstimate]:
    n = len(e)
    level = np.linspace(1.0, 2.0, n)[:, None] * 100 * SIGMA
    known = np.broadcast_to(nominal, (n - 1, M))
    return find_scatter(e, level, noise or white_noise(SIGMA), np.ones(n), lambda: effects(n), lambda: known)


def autoregressive(rng: np.random.Generator, n: int, rho: float) -> np.ndarray:
    e = rng.standard_normal((n, M))
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * e[k]
    return SIGMA * e


@pytest.mark.parametrize("of", range(M))
def test_the_sensor_that_scatters_is_found_with_the_size_of_its_scatter(of):
    rng = np.random.default_rng(of)
    e = SIGMA * rng.standard_normal((200, M))
    e[:, of] *= 4.0
    (one,) = found(e)
    assert one.instrument == of and one.probability > 0.99
    # √15 σ are added; a standard deviation of 200 differences is known to a sixteenth
    assert one.size == pytest.approx(np.sqrt(15) * SIGMA[of], rel=4 / 16)


def test_what_is_uncertain_about_nominal_between_two_operating_points_is_no_scatter():
    rng = np.random.default_rng(17)
    maps = np.array([6.0, 1.0, 90.0, 2.0])  # standard deviations of the model's error, another at every record
    e = np.hypot(SIGMA, maps) * rng.standard_normal((200, M))
    assert not found(e, nominal=2 * maps**2)
    e[:, 3] *= 4.0
    (one,) = found(e, nominal=2 * maps**2)
    assert one.instrument == 3


def test_an_input_that_scatters_is_found_although_every_reading_does():
    rng = np.random.default_rng(1)
    e = SIGMA * rng.standard_normal((200, M)) + 2.0 * rng.standard_normal((200, 1)) * ALONG
    (one,) = found(e)
    assert one.instrument == M and one.probability > 0.99
    assert one.size == pytest.approx(2.0, rel=4 / 16)


def test_two_that_scatter_are_both_found_and_three_are_the_model():
    rng = np.random.default_rng(2)
    e = SIGMA * rng.standard_normal((300, M))
    assert {one.instrument for one in found(e * [5, 1, 5, 1])} == {0, 2}
    assert found(e * [5, 5, 5, 1]) == []


@pytest.mark.parametrize("rho", [0.0, 0.8])
def test_good_readings_do_not_scatter_whatever_their_correlation(rho):
    noise = NoiseModel(SIGMA, np.full(M, rho))
    for seed in range(60):
        rng = np.random.default_rng(100 + seed)
        assert found(autoregressive(rng, int(rng.integers(9, 400)), rho), noise) == []


def test_biases_scales_drifts_and_noise_of_half_as_much_again_are_no_scatter():
    rng = np.random.default_rng(3)
    n = 300
    e = 1.3 * SIGMA * rng.standard_normal((n, M))
    e[:, 0] += 50 * SIGMA[0]
    e[:, 1] += 0.05 * np.linspace(1.0, 2.0, n) * 100 * SIGMA[1]
    e[:, 2] += 20 * SIGMA[2] * np.linspace(0, 1, n)
    assert found(e) == []


def test_the_order_of_sensors_does_not_matter():
    rng = np.random.default_rng(4)
    e = SIGMA * rng.standard_normal((100, M)) * [1, 6, 1, 1]
    order = np.array([3, 1, 0, 2])
    (one,) = found(e)
    S = effects(100)[:, order][:, :, [*order, M]]
    level = np.linspace(1.0, 2.0, 100)[:, None] * 100 * SIGMA[order]
    (other,) = find_scatter(
        e[:, order], level, white_noise(SIGMA[order]), np.ones(100), lambda: S, lambda: np.zeros((99, M))
    )
    assert order[other.instrument] == one.instrument
    assert other.size == pytest.approx(one.size, rel=1e-9)


def test_weighed_readings_scatter_as_stated():
    """W (R + τ²SSᵀ) Wᵀ = R, also of two instruments and where a reading is missing."""
    noise = NoiseModel(SIGMA, np.array([0.0, 0.5, 0.0, 0.2]))
    R = np.diag(SIGMA**2 * noise.inflation)
    present = np.ones((2, M), bool)
    present[1, 2] = False
    W = scatter_weights(present, noise, effects(2), [ScatterEstimate(M, 2.0, 1.0), ScatterEstimate(0, 7.0, 1.0)])
    for k in range(2):
        seen = present[k]
        S = np.column_stack([2.0 * ALONG, 7.0 * np.eye(M)[0]])[seen]
        R_seen = R[np.ix_(seen, seen)]
        mine = W[k][np.ix_(seen, seen)]
        np.testing.assert_allclose(mine @ (R_seen + S @ S.T) @ mine.T, R_seen, atol=1e-8 * SIGMA.max() ** 2)
    y = np.array([[1.0, 2.0, 3.0, 4.0], [1.0, 2.0, np.nan, 4.0]])
    assert np.array_equal(np.isnan(apply_weights(W, y)), np.isnan(y))
    np.testing.assert_array_equal(apply_weights(None, y), y)


def test_a_sensor_that_repeats_itself_is_stuck_where_the_model_moves():
    level = np.column_stack([np.linspace(0, 100, 50), np.zeros(50), np.linspace(0, 100, 50)])
    readings = np.column_stack([np.full(50, 812.0), np.full(50, 1.0), np.linspace(5, 6, 50)])
    stuck = find_stuck_outputs(readings, level)
    assert stuck[:, 0].all() and not stuck[:, 1:].any()
    readings[30:, 0] = np.linspace(900, 950, 20)
    assert find_stuck_outputs(readings, level)[:, 0].tolist() == [True] * 30 + [False] * 20


def test_records_with_a_wrong_input_make_no_sensor_stuck():
    """A coarse recorder writes one value for minutes on the ground, and the fuel flow of one record is wrong."""
    level = np.zeros((8, 1))
    level[5] = 40.0
    assert not find_stuck_outputs(np.full((8, 1), 990610.3), level).any()


def test_an_input_is_stuck_where_the_readings_move_as_its_error_would_make_them():
    rng = np.random.default_rng(5)
    n = 60
    truth = np.linspace(1.0, 2.0, n)
    unit = ALONG / SIGMA
    readings = truth[:, None] ** 2 * 10 * unit + rng.standard_normal((n, M))

    def free(column, rows, values):
        slope = {"u": 20 * values[:, None] * unit, "w": np.tile([0.0, 1.0, 0.0, 0.0], (len(rows), 1))}[column]
        u = values if column == "u" else read[rows]
        return readings[rows] - u[:, None] ** 2 * 10 * unit, -slope

    read = np.where(np.arange(n) < 20, truth, truth[20])
    z = readings - read[:, None] ** 2 * 10 * unit
    stuck = find_stuck_inputs(z, {"u": read, "w": np.zeros(n)}, free)
    assert list(stuck) == ["u"]
    assert stuck["u"].tolist() == [False] * 20 + [True] * 40
    # one record with another wrong input moves nothing but itself, whichever input it looks like
    calm = np.full(n, 1.5)
    readings = calm[:, None] ** 2 * 10 * unit + rng.standard_normal((n, M))
    readings[7] += 40 * unit
    read = calm
    assert find_stuck_inputs(readings - calm[:, None] ** 2 * 10 * unit, {"u": calm}, free) == {}
    # commands and cruise stand still for hours: an input that does so while nothing moves is none
    still = np.full(n, 1.5)
    readings = still[:, None] ** 2 * 10 * unit + rng.standard_normal((n, M)) + [5.0, 0.0, 0.0, 0.0]
    read = still
    assert find_stuck_inputs(readings - still[:, None] ** 2 * 10 * unit, {"u": still}, free) == {}


def test_runs_are_the_same_in_one_piece_and_in_blocks():
    x = np.array([1.0, 5, 5, 5, 5, 2, 7, np.nan, 7, 7, 3, 7, 7])
    mask, line = np.array([0, 1, 1, 1, 1, 0, 1, 0, 1, 1, 0, 1, 1], bool), np.arange(10, 23)
    whole = list(list_stuck_runs("T", x, line, mask))
    again = StuckRun("T", 7.0, 21, 22, 2)  # the same value, but it has moved between
    assert whole == [StuckRun("T", 5.0, 11, 14, 4), StuckRun("T", 7.0, 16, 19, 3), again]
    for cut in range(1, 13):
        known: list[StuckRun] = []
        for part in (slice(0, cut), slice(cut, None)):
            append_runs(known, list_stuck_runs("T", x[part], line[part], mask[part]))
        assert known == whole


def test_a_window_sees_the_part_of_a_run_that_lies_in_it():
    run = StuckRun("T45_K", 812.0, 120, 400, 281)
    (fault,) = find_stuck_faults([run], (), (101, 300), 200)
    assert (fault.first, fault.count, fault.records, fault.throughout) == (20, 181, 200, False)
    assert fault.name == "sensor.T45.stuck"
    assert list(find_stuck_faults([run], (), (401, 500), 100)) == []


def test_identical_values_in_a_row():
    x = np.array([1, 1, 1, np.nan, np.nan, np.nan, 2, 2, 3, 3, 3, 3.0])
    assert list(identical_runs(x, 3)) == [(0, 3), (8, 12)]
    assert list(identical_runs(x[:0], 3)) == []
