"""How much something may change, and how fast, before nobody believes it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from engine_makers import turbofan

from enginediag_cli.mismatch.fit.believable import (
    FAST_S,
    INSTRUMENT_SHARE,
    LEAST,
    SLOW_SHARE,
    along_driver,
    hidden,
    switching,
    with_belief,
)
from enginediag_cli.mismatch.fit.projection import Score
from enginediag_cli.parameters import Parameter
from enginediag_cli.physics.registry import effect

ACCURACY = 0.003
PARAMETERS = {
    "hpc.efficiency": Parameter("hpc.efficiency", "health", 1.0, 0.7, 1.3, 0.02),
    "hpc.bleed.fraction": Parameter("hpc.bleed.fraction", "health", 0.0, 0.0, 0.2, 0.05, switches=True),
}


def place(parameter="", scale=0.02, through=None, belongs_to_sensor=False):
    return SimpleNamespace(parameter=parameter, scale=scale, through=through, belongs_to_sensor=belongs_to_sensor)


BLEED = place("", 0.02, effect(turbofan(), "customer_bleed", "hpc"))
AIR = place("", 0.01, effect(turbofan(), "reynolds_efficiency", "hpc"))
SENSOR = place("sensor.T3.scale", 0.01, None, True)
EFFICIENCY = place("hpc.efficiency", 0.02)
COMMANDED = place("hpc.bleed.fraction", 0.01)


def test_what_is_commanded_may_come_and_go_within_seconds_and_the_rest_hardly():
    assert switching(BLEED, PARAMETERS) and switching(COMMANDED, PARAMETERS)
    assert not any(switching(p, PARAMETERS) for p in (AIR, SENSOR, EFFICIENCY))
    assert hidden(BLEED, PARAMETERS, ACCURACY, 10.0) == 0.02
    assert hidden(AIR, PARAMETERS, ACCURACY, 10.0) == pytest.approx(SLOW_SHARE * 0.01)
    assert hidden(SENSOR, PARAMETERS, ACCURACY, 10.0) == pytest.approx(INSTRUMENT_SHARE * 0.01)
    assert hidden(EFFICIENCY, PARAMETERS, ACCURACY, 10.0) == ACCURACY


def test_a_part_breathes_a_little_though_the_maps_are_exact_and_never_more_than_along_a_driver():
    assert hidden(EFFICIENCY, PARAMETERS, 0.0, 10.0) == LEAST
    assert hidden(EFFICIENCY, PARAMETERS, 0.5, 10.0) == EFFICIENCY.scale


@pytest.mark.parametrize("step", [np.nan, FAST_S * 1.01, np.inf])
def test_where_records_are_not_known_to_be_seconds_apart_speed_limits_nothing(step):
    assert all(np.isinf(hidden(p, PARAMETERS, ACCURACY, step)) for p in (BLEED, AIR, SENSOR, EFFICIENCY))


def test_along_a_driver_what_is_commanded_may_reach_its_prior():
    assert along_driver(COMMANDED, PARAMETERS) == 0.05
    assert along_driver(EFFICIENCY, PARAMETERS) == 0.02
    assert along_driver(BLEED, PARAMETERS) == 0.02


def blocks(rng, k=3):
    A = rng.normal(size=(40, k)) * np.array([3.0, 1.0, 0.2])[:k]
    return A, A.T @ A


def score(dof=3):
    return Score(0.0, dof, 0.0, np.zeros(dof), 1.0, 1.0)


def test_a_free_size_gives_raos_statistic_and_the_least_squares_coefficients():
    rng = np.random.default_rng(1)
    A, gram = blocks(rng)
    pull = A.T @ rng.normal(size=40)
    found = with_belief(score(), gram, pull, 1e9)
    assert found.statistic == pytest.approx(pull @ np.linalg.solve(gram, pull))
    np.testing.assert_allclose(found.coefficients, np.linalg.solve(gram, pull))


def test_a_believed_size_gives_the_posterior_mean_and_never_a_larger_statistic():
    rng = np.random.default_rng(2)
    A, gram = blocks(rng)
    pull = A.T @ (A @ np.array([0.5, -0.2, 1.0]) + rng.normal(size=40))
    last = np.inf
    for scale in (10.0, 1.0, 0.1, 1e-3):
        found = with_belief(score(), gram, pull, scale)
        held = gram + np.eye(3) / scale**2
        np.testing.assert_allclose(found.coefficients, np.linalg.solve(held, pull))
        assert found.statistic == pytest.approx(pull @ np.linalg.solve(held, pull))
        assert found.statistic < last
        last = found.statistic
    assert last < 0.1


def test_its_surprise_is_no_bolder_than_chance_where_nothing_is_missing():
    """−ln p of T under the null: at most 5 in 100 draws reach −ln 0.05."""
    rng = np.random.default_rng(3)
    A, gram = blocks(rng)
    for scale in (1.0, 0.2):
        hits = np.mean(
            [with_belief(score(), gram, A.T @ rng.normal(size=40), scale).surprise > -np.log(0.05) for _ in range(4000)]
        )
        assert hits <= 0.05 + 3 * np.sqrt(0.05 * 0.95 / 4000)


def test_a_block_that_nothing_is_left_of_stays_as_it_is():
    empty = score(0)
    assert with_belief(empty, np.zeros((0, 0)), np.zeros(0), 1.0) is empty
