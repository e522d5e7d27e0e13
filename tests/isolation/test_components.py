"""Isolation to components."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from parameter_makers import described, meaning_of
from scipy.stats import multivariate_normal
from score_makers import sensitivities
from white_statistics import local_statistics, white_noise

from enginediag_cli.isolation.diagnosis import component_posterior, isolate_components, median_model
from enginediag_cli.isolation.methods import IsolationOptions
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import InstrumentForms, SetPrior
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame

NAMES = ("fan.efficiency", "fan.flow_capacity", "hpc.efficiency", "hpc.flow_capacity", "nozzle.area", "sensor.T3.bias")


def score_of(rng, J, change, names=NAMES, sigma=0.02):
    e = rng.standard_normal(J.shape[:2]) + J @ np.asarray(change, float)
    p = len(names)
    return fisher_score(
        local_statistics(
            e,
            J,
            white_noise(np.ones(J.shape[1])),
            ParameterFrame(names, np.ones(p), np.full(p, sigma), meaning_of(names)),
        )
    ), e


def test_the_posterior_is_that_of_the_marginal_likelihoods_of_the_readings():
    rng = np.random.default_rng(1)
    J = sensitivities(rng, N=5, m=3)
    score, e = score_of(rng, J, [0, 0, -0.03, 0.02, 0, 0])
    prior = SetPrior(0.2, slabs=(1.5,), p_recovery=0.5)
    components, sets, probabilities, _ = component_posterior(score, prior)
    assert components == ("fan", "hpc", "nozzle", "sensor.T3") and len(sets) == 16
    wide = J.reshape(-1, 6)
    logs = {}
    for k in range(5):
        for chosen in combinations(components, k):
            own = [i for i, n in enumerate(NAMES) if described(n).component in chosen]
            size = 1.5 * 0.02 * prior.widths(score.described)[own]
            covariance = np.eye(15) + wide[:, own] * size**2 @ wide[:, own].T
            logs[chosen] = multivariate_normal.logpdf(e.ravel(), np.zeros(15), covariance)
            mask = np.array([[c in chosen for c in components]])
            logs[chosen] += prior.log_probability(mask, InstrumentForms(np.array([-1, -1, -1, 0])))[0]
    weights = np.exp(np.array(list(logs.values())) - max(logs.values()))
    direct = dict(zip(logs, weights / weights.sum(), strict=True))
    for row, probability in zip(sets, probabilities, strict=True):
        key = tuple(c for c, member in zip(components, row, strict=True) if member)
        assert probability == pytest.approx(direct[key], rel=1e-6)


def test_with_one_parameter_per_component_it_is_the_posterior_of_parameter_sets():
    rng = np.random.default_rng(2)
    names = tuple(f"part{i}.efficiency" for i in range(6))
    score, _ = score_of(rng, sensitivities(rng), [0.01, 0, -0.005, 0, 0, 0], names)
    _, sets, probabilities, _ = component_posterior(score)
    reference = set_posterior(score)
    np.testing.assert_array_equal(sets[:10], reference.masks[:10])
    np.testing.assert_allclose(probabilities, reference.probabilities, rtol=1e-6)


def test_both_parameters_of_a_component_at_once_are_one_component():
    rng = np.random.default_rng(3)
    score, _ = score_of(rng, sensitivities(rng), [0, 0, -0.02, -0.015, 0, 0])
    found = isolate_components(score)
    assert found.components == ("hpc",) and found.probability > 0.5 and found.complete
    assert found.inclusion["hpc"] > 0.99


def test_nothing_is_named_when_nothing_changed():
    rng = np.random.default_rng(4)
    found = isolate_components(score_of(rng, sensitivities(rng), np.zeros(6))[0])
    assert found.components == () and found.probability > 0.5


def test_answer_and_rivals_hold_the_coverage_asked_for():
    rng = np.random.default_rng(5)
    score, _ = score_of(rng, sensitivities(rng, N=3, size=10.0), [0.03, 0, 0, 0, 0, 0])
    found = isolate_components(score, IsolationOptions(coverage=0.9))
    held = np.cumsum([found.probability, *(r.probability for r in found.alternatives)])
    assert held[-1] >= 0.9 and (len(held) == 1 or held[-2] < 0.9)


def test_a_limit_that_the_answer_reaches_is_told():
    rng = np.random.default_rng(6)
    score, _ = score_of(rng, sensitivities(rng), [-0.05, 0, -0.05, 0, 0, 0])
    assert not isolate_components(score, IsolationOptions(largest=1)).complete
    assert isolate_components(score).components == ("fan", "hpc")


def sets_of(*weights):
    """Sets of the components a to d with their probabilities, likeliest first."""
    order = sorted(weights, key=lambda w: -w[1])
    return np.array([[c in members for c in "abcd"] for members, _ in order]), np.array([w for _, w in order])


def told(*weights):
    sets, probabilities = sets_of(*weights)
    named = sets[median_model(sets, probabilities)]
    return "".join(c for c, member in zip("abcd", named, strict=True) if member)


def test_of_the_most_probable_set_those_are_named_that_are_more_probable_than_not():
    assert told(("abc", 0.46), ("ab", 0.44), ("a", 0.1)) == "ab"
    assert told(("abc", 0.5), ("ab", 0.4), ("a", 0.1)) == "abc"


def test_what_is_more_probable_than_not_without_being_in_the_most_probable_set_is_not_named():
    assert told(("a", 0.4), ("abc", 0.35), ("ab", 0.25)) == "a"
    assert told(("", 0.4), ("a", 0.35), ("ab", 0.25)) == ""


def test_members_that_stand_against_others_by_exchange_are_named_though_none_of_them_is_probable():
    assert told(("a", 0.4), ("b", 0.35), ("c", 0.25)) == "a"
    assert told(("ab", 0.4), ("ac", 0.35), ("ad", 0.24), ("a", 0.01)) == "ab"


def test_an_answer_that_is_more_probable_than_all_others_together_is_the_most_probable_set():
    rng = np.random.default_rng(7)
    sets = np.array([[bool(k >> j & 1) for j in range(4)] for k in range(16)])
    for _ in range(200):
        probabilities = np.sort(rng.dirichlet(np.full(16, 0.1)))[::-1]
        answer = median_model(sets[rng.permutation(16)], probabilities)
        assert answer == 0 or probabilities[0] < 0.5


def test_what_is_not_named_of_the_most_probable_set_is_told_as_perhaps_changed():
    rng = np.random.default_rng(8)
    names = ("fan.efficiency", "fan.flow_capacity", "hpc.efficiency", "hpc.flow_capacity", "lpt.efficiency")
    prior, seen = SetPrior(inclusion=0.3), 0
    for _ in range(400):
        J = sensitivities(rng, N=1, p=5, size=20.0)
        score, _ = score_of(rng, J, [-0.03, -0.02, -0.03, 0, -0.01], names)
        found = isolate_components(score, IsolationOptions(prior=prior))
        _, _, probabilities, _ = component_posterior(score, prior)
        assert not set(found.possible) & set(found.components)
        if found.probability == probabilities[0]:
            continue
        seen += 1
        leading = found.alternatives[0]
        assert leading.probability == probabilities[0] and set(found.components) < set(leading.parameters)
        assert set(leading.parameters) - set(found.components) <= set(found.possible)
        assert all(found.inclusion[c] >= 0.5 for c in found.components)
        assert found.probability + leading.probability <= found.p_all
        assert found.p_all <= min(found.inclusion[c] for c in found.components)
    assert seen > 3
