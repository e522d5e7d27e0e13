"""The isolation methods as `isolate` offers them."""

from __future__ import annotations

import numpy as np
import pytest
from score_makers import linear_score, sensitivities

from enginediag_cli.isolation.methods import METHODS, IsolationOptions, incremental_diagnosis, isolate
from enginediag_cli.isolation.results import estimate_sizes

CHANGE = np.array([0.03, 0, 0, -0.04, 0, 0])


def faulty(seed, **options):
    rng = np.random.default_rng(seed)
    return linear_score(rng, sensitivities(rng, **options), CHANGE)


@pytest.mark.parametrize("method", METHODS)
def test_every_method_finds_two_clear_faults_and_their_sizes(method):
    options = IsolationOptions(faults=2) if method == "sensitivity" else IsolationOptions()
    result = isolate(faulty(1), method, options)
    assert (result.method, result.isolated) == (method, ("p0", "p3"))
    assert result.complete
    for size, truth in zip(result.sizes, (0.03, -0.04), strict=True):
        assert abs(size.change - truth) < 4 * size.standard_error
        assert size.percent == pytest.approx(100 * size.change)


@pytest.mark.parametrize("method", ["posterior", "incremental", "minmax"])
def test_a_healthy_engine_has_nothing_isolated(method):
    rng = np.random.default_rng(2)
    assert isolate(linear_score(rng, sensitivities(rng), np.zeros(6)), method).isolated == ()


def test_the_incremental_algorithm_takes_one_parameter_more_at_each_step_until_the_rest_is_noise():
    found = incremental_diagnosis(faulty(3))
    assert [len(step.parameters) for step in found.steps] == [1, 2]
    assert found.steps[0].rejection > found.steps[0].rejection_threshold
    assert found.steps[1].rejection <= found.steps[1].rejection_threshold
    assert found.accepted and found.exact


def test_the_incremental_algorithm_stops_too_late_as_often_as_its_false_alarm_rate_says():
    rng = np.random.default_rng(4)
    J = sensitivities(rng)
    sizes = [len(incremental_diagnosis(linear_score(rng, J, CHANGE), false_alarm=0.05).isolated) for _ in range(200)]
    assert sum(size > 2 for size in sizes) <= 22  # P(more than 22 of 200 at 5 %) < 0.1 %
    assert min(sizes) == 2


def test_a_method_that_is_not_known_is_refused_with_the_list():
    with pytest.raises(ValueError, match="posterior, incremental, sensitivity, minmax"):
        isolate(faulty(5), "guess")


def test_rivals_are_the_explanations_that_the_data_cannot_exclude():
    rng = np.random.default_rng(6)
    J = sensitivities(rng)
    J[:, :, 5] = 1.5 * J[:, :, 0]
    score = linear_score(rng, J, CHANGE)
    for method in ("posterior", "incremental"):
        result = isolate(score, method)
        sets = [set(result.isolated), *(set(rival.parameters) for rival in result.alternatives)]
        assert {"p0", "p3"} in sets and {"p3", "p5"} in sets
        assert result.alternatives[0].probability > 0.1


def test_answer_and_rivals_hold_the_coverage_asked_for():
    rng = np.random.default_rng(7)
    score = linear_score(rng, sensitivities(rng, N=10, size=10), CHANGE)
    result = isolate(score, options=IsolationOptions(coverage=0.5))
    assert result.probability + sum(r.probability for r in result.alternatives) >= 0.5
    assert result.alternatives_omitted == 0


def test_intervals_of_sizes_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(8)
    J = sensitivities(rng)
    inside = 0
    for _ in range(300):
        for size, truth in zip(
            estimate_sizes(linear_score(rng, J, CHANGE), ("p0", "p3"), 0.9), (0.03, -0.04), strict=True
        ):
            inside += size.lower <= truth <= size.upper
    assert inside / 600 == pytest.approx(0.9, abs=0.045)  # three standard errors, pairs counted as one


def test_a_size_that_the_set_leaves_open_has_an_infinite_interval():
    rng = np.random.default_rng(9)
    J = sensitivities(rng)
    J[:, :, 5] = J[:, :, 0]
    first, clear, last = estimate_sizes(linear_score(rng, J, CHANGE), ("p0", "p3", "p5"))
    assert np.isinf(first.standard_error) and np.isinf(last.upper)
    assert np.isfinite(clear.standard_error)


def test_the_number_of_faults_can_be_given():
    for method in METHODS:
        assert len(isolate(faulty(10), method, IsolationOptions(faults=3)).isolated) == 3
