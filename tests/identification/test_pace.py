"""Correlation by elapsed time and operating point: gaps, sums over correlated records, and κ."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.noise import (
    correlated_sum,
    correlations,
    estimate_noise,
    inflation,
    record_gaps,
    record_positions,
)


def autoregression(n, rho, seed):
    rng = np.random.default_rng(seed)
    e = np.empty(n)
    e[0] = rng.standard_normal()
    for k in range(1, n):
        e[k] = rho * e[k - 1] + np.sqrt(1 - rho**2) * rng.standard_normal()
    return e


def test_a_recording_without_time_counts_its_records():
    assert record_positions({"N1_rpm": np.arange(5.0)}, ["N1_rpm"], 5).tolist() == [0, 1, 2, 3, 4]


def test_a_pause_counts_as_the_steps_that_it_lasts():
    time = np.array([0.0, 10.0, 20.0, 320.0, 330.0])
    assert record_positions({"time_s": time, "mach": np.full(5, 0.5)}, ["mach"], 5).tolist() == [0, 1, 2, 32, 33]


def test_a_jump_of_the_operating_point_counts_as_steps():
    columns = {"time_s": np.arange(4.0), "N1_rpm": np.array([3000.0, 3000.0, 4000.0, 4000.0])}
    assert record_positions(columns, ["N1_rpm"], 4) == pytest.approx([0, 1, 12, 13])


def test_a_flight_that_moves_on_with_every_record_counts_time_alone():
    time = 30.0 * np.arange(40.0)
    climbing = {"time_s": time, "altitude_m": 200.0 * np.arange(40.0), "mach": np.tile([0.3, 0.6], 20)}
    assert record_positions(climbing, ["altitude_m", "mach"], 40).tolist() == list(range(40))
    cruising = {**climbing, "mach": np.where(np.arange(40) < 30, 0.6, 0.3)}
    assert record_positions(cruising, ["altitude_m", "mach"], 40)[-1] > 45


def test_correlation_of_a_flight_that_moves_on_with_every_record_is_found():
    e, inputs = autoregression(400, 0.6, 5), {"time_s": 30.0 * np.arange(400.0), "mach": np.tile([0.3, 0.6], 200)}
    gap = record_gaps(record_positions(inputs, ["mach"], 400), np.zeros(400, int))
    found = estimate_noise(e[:, None], gap, np.zeros(1), np.full(1, 1e-9))
    assert found.rho1[0] == pytest.approx(0.6, abs=0.1)


def test_records_that_were_left_out_still_lie_between_those_that_were_not():
    steps = record_positions({}, [], 6)[[0, 1, 4, 5]]
    assert record_gaps(steps, np.zeros(4, int)).tolist() == [np.inf, 1, 3, 1]


def test_the_sum_over_correlated_records_is_that_of_the_full_matrix():
    rng = np.random.default_rng(0)
    gap = record_gaps(np.cumsum(rng.uniform(0.5, 4.0, 30)), np.repeat([0, 1, 2], 10))
    rho = np.array([0.9, 0.0, 0.4])
    g, r = rng.standard_normal((30, 3, 2)), correlations(gap, rho)
    C = np.zeros((30, 30, 3))
    for k in range(30):
        for l in range(k + 1):
            C[k, l] = C[l, k] = np.prod(r[l + 1 : k + 1], axis=0)
    assert correlated_sum(g, r) == pytest.approx(np.einsum("kls,lsp->ksp", C, g))


def test_kappa_is_bayley_and_hammersleys_for_records_at_equal_steps():
    gap = record_gaps(np.arange(50.0), np.zeros(50, int))
    assert inflation(gap, np.array([0.8, 0.0, -0.1])) == pytest.approx([9.0, 1.0, 0.9 / 1.1])


def test_records_far_apart_are_independent_whatever_the_correlation_of_neighbours():
    gap = record_gaps(np.arange(50.0) * 200.0, np.zeros(50, int))
    assert inflation(gap, np.array([0.9])) == pytest.approx([1.0], abs=1e-6)


def test_gaps_in_a_recording_do_not_hide_the_correlation_of_neighbours():
    """Four records out of every fifty: a fifth of what looks like neighbours is minutes apart."""
    e = autoregression(20_000, 0.9, 1)
    kept = np.arange(20_000) % 50 < 4
    where = np.arange(20_000.0)[kept]
    recording = np.zeros(len(where), int)
    by_time = estimate_noise(e[kept, None], record_gaps(where, recording), np.zeros(1), np.full(1, 1e-9))
    by_count = estimate_noise(
        e[kept, None], record_gaps(np.arange(float(len(where))), recording), np.zeros(1), np.full(1, 1e-9)
    )
    assert by_time.rho1[0] == pytest.approx(0.9, abs=0.02)
    assert by_count.rho1[0] < 0.75
    # four records of a run of ρ = 0.9: their mean varies by Σ ρ^|k−l|/4 = 3.6 of one
    lag = np.abs(np.subtract.outer(np.arange(4), np.arange(4)))
    assert by_time.inflation[0] == pytest.approx(np.sum(0.9**lag) / 4, rel=0.05)
