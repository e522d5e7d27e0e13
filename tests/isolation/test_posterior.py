"""The posterior over sets against brute force, and its calibration."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from parameter_makers import meaning_of
from scipy.stats import multivariate_normal
from score_makers import linear_score, sensitivities
from white_statistics import local_statistics, white_noise

from enginediag_cli.isolation.methods import isolate
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.subsets import size_limit
from enginediag_cli.residuals.score import fisher_score
from enginediag_cli.residuals.statistics import ParameterFrame


def test_probabilities_equal_the_marginal_likelihoods_of_all_sets():
    rng = np.random.default_rng(1)
    N, m, p = 6, 3, 4
    prior = SetPrior(0.2, slabs=(0.5, 2.0))
    J = sensitivities(rng, N, m, p)
    change = np.array([0.05, 0, 0, -0.05])
    e_rng = np.random.default_rng(2)
    e = (e_rng.standard_normal((N, m)) + J @ change).ravel()
    score = linear_score(np.random.default_rng(2), J, change, sigma=0.05)
    G = J.reshape(-1, p)
    logs = {}
    for size in range(p + 1):
        for chosen in combinations(range(p), size):
            each = [
                multivariate_normal(cov=np.eye(N * m) + (0.05 * slab) ** 2 * G[:, chosen] @ G[:, chosen].T).logpdf(e)
                for slab in prior.slabs
            ]
            logs[chosen] = np.logaddexp(*each) + prior.log_size_probability(p)[size]
    weights = np.exp(np.array(list(logs.values())) - max(logs.values()))
    expected = dict(zip(logs, weights / weights.sum(), strict=True))
    found = set_posterior(score, prior)
    assert len(found.probabilities) == 16
    for mask, probability in zip(found.masks, found.probabilities, strict=True):
        assert probability == pytest.approx(expected[tuple(np.flatnonzero(mask))], rel=1e-8)
    assert found.inclusion[0] == pytest.approx(sum(q for s, q in expected.items() if 0 in s), rel=1e-8)
    something = sum(q for s, q in expected.items() if s)
    assert found.log_evidence == pytest.approx(np.log(something / expected[()]), rel=1e-8)


def test_stated_probabilities_are_the_realised_frequencies():
    rng = np.random.default_rng(3)
    J = sensitivities(rng, N=15, p=6)
    prior = SetPrior(0.2)
    claimed = right = covered = 0.0
    trials = 400
    for truth, size in zip(*prior.draw(rng, trials, 6), strict=True):
        found = set_posterior(linear_score(rng, J, 0.02 * size), prior)
        claimed += found.probabilities[0]
        right += np.array_equal(found.masks[0], truth)
        covered += any(np.array_equal(mask, truth) for mask in found.masks[: found.credible_count(0.9)])
    # standard error of either rate is at most 0.025; three of them
    assert right / trials == pytest.approx(claimed / trials, abs=0.075)
    assert covered / trials > 0.9 - 0.045


def test_answers_do_not_depend_on_units_or_order_of_parameters():
    rng = np.random.default_rng(4)
    J = sensitivities(rng, p=5)
    change = np.array([0.03, 0, 0, 0.03, 0])
    plain = set_posterior(linear_score(np.random.default_rng(5), J, change))
    order = [3, 1, 4, 0, 2]
    turned = set_posterior(linear_score(np.random.default_rng(5), J[:, :, order], change[order]))
    np.testing.assert_allclose(turned.inclusion, plain.inclusion[order], rtol=1e-9)
    np.testing.assert_allclose(turned.probabilities, plain.probabilities, rtol=1e-7)


def test_a_known_number_of_faults_leaves_only_sets_of_that_size():
    rng = np.random.default_rng(6)
    found = set_posterior(linear_score(rng, sensitivities(rng), [0.03, 0, 0, 0.03, 0, 0]), faults=2)
    assert np.all(found.masks.sum(axis=1) == 2) and len(found.masks) == 15
    assert found.names(0) == ("p0", "p3")
    assert found.probabilities.sum() == pytest.approx(1)


def test_two_parameters_that_imitate_each_other_share_the_probability():
    rng = np.random.default_rng(7)
    J = sensitivities(rng)
    J[:, :, 5] = J[:, :, 0]
    found = set_posterior(linear_score(rng, J, [0.05, 0, 0, 0, 0, 0]))
    assert found.probabilities[0] == pytest.approx(found.probabilities[1])
    assert {found.names(0), found.names(1)} == {("p0",), ("p5",)}
    assert found.credible_count(0.95) >= 2


def test_the_size_limit_keeps_the_number_of_sets_in_hand():
    assert size_limit(11) == 11
    assert size_limit(20) == 20
    assert size_limit(40) == 5
    assert size_limit(11, 3) == 3
    rng = np.random.default_rng(8)
    assert len(set_posterior(linear_score(rng, sensitivities(rng), np.zeros(6)), largest=2).masks) == 1 + 6 + 15


def test_a_healthy_engine_is_most_probably_unchanged():
    rng = np.random.default_rng(9)
    J = sensitivities(rng, N=200)
    assert sum(set_posterior(linear_score(rng, J, np.zeros(6))).names(0) == () for _ in range(50)) >= 48


def test_of_sensors_no_more_than_the_prior_allows_are_taken_together():
    assert size_limit(20, sensors=9, wrong_sensors=2) == 20
    rng = np.random.default_rng(9)
    score = linear_score(rng, sensitivities(rng, p=7), [0.05, 0, 0, 0, 0.05, 0.05, 0])
    names = ("a.x", "b.x", "c.x", "d.x", "sensor.p.bias", "sensor.q.bias", "sensor.r.bias")
    found = set_posterior(replace(score, parameters=names, meaning=meaning_of(names)), SetPrior(0.2))
    assert len(found.masks) == 16 * 7 and (found.masks[:, 4:].sum(axis=1) <= 2).all()
    assert found.names(0) == ("a.x", "sensor.p.bias", "sensor.q.bias")
    note = isolate(replace(score, parameters=names, meaning=meaning_of(names))).note
    assert note == "more than 2 wrong sensors were not considered"


def test_of_many_sets_the_negligible_are_compared_and_not_listed(monkeypatch):
    rng = np.random.default_rng(10)
    score = linear_score(rng, sensitivities(rng, p=14), [0.01, 0, 0, 0.02, *np.zeros(10)])
    found = set_posterior(score)
    monkeypatch.setattr("enginediag_cli.isolation.posterior.ALL_LISTED", 10**9)
    every = set_posterior(score)
    assert len(every.masks) == 2**14 > len(found.masks)
    assert np.allclose(found.inclusion, every.inclusion, atol=1e-5)
    assert found.log_evidence == pytest.approx(every.log_evidence, abs=1e-5)
    assert np.allclose(found.probabilities[:50], every.probabilities[:50], rtol=1e-5)
    assert np.array_equal(found.masks[:50], every.masks[:50])
    assert (~found.masks.any(axis=1)).sum() == 1  # that of no change is always listed


def readings_of_one_record(noise, fault=0.0, bias=0.0, sensor="sensor.y1.bias"):
    """Score of one record of four readings: one parameter that acts on all, and the bias of each, plausible to 3
    noise."""
    names = ("hpc.efficiency", *(f"sensor.y{i + 1}.bias" for i in range(4)))
    effect = np.array([500.0, -400.0, 300.0, 200.0])
    J = np.concatenate([effect[:, None], np.eye(4)], axis=1)[None]
    e = noise + effect * fault + bias * (np.arange(4) == names.index(sensor) - 1)
    frame = ParameterFrame(names, np.zeros(5), np.array([0.02, 3.0, 3.0, 3.0, 3.0]), meaning_of(names))
    return fisher_score(local_statistics(e[None], J, white_noise(np.ones(4)), frame))


def test_a_record_without_a_wrong_instrument_speaks_against_one():
    rng, prior = np.random.default_rng(8), SetPrior()
    found = [set_posterior(readings_of_one_record(rng.standard_normal(4), fault=-0.02), prior) for _ in range(100)]
    left = np.mean([f.inclusion[1:].sum() for f in found])
    assert left < 0.6 * 4 * prior.sensor  # with errors as narrow as changes of the engine nine tenths are left
    narrow = SetPrior(instrument_width=1.0)
    rng = np.random.default_rng(8)
    found = [set_posterior(readings_of_one_record(rng.standard_normal(4), fault=-0.02), narrow) for _ in range(100)]
    assert np.mean([f.inclusion[1:].sum() for f in found]) > 1.3 * left


def test_a_probe_that_is_off_by_many_times_its_noise_is_believed_to_be():
    rng = np.random.default_rng(9)
    for bias in (15.0, 25.0, 40.0):
        found = set_posterior(readings_of_one_record(rng.standard_normal(4), bias=bias))
        assert found.names(0) == ("sensor.y1.bias",) and found.probabilities[0] > 0.7
