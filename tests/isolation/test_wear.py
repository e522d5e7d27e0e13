"""Efficiencies fall: what that does to the posterior over sets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from parameter_makers import meaning_of
from scipy.special import ndtr
from score_makers import linear_score, sensitivities

from enginediag_cli.isolation.catalogue import sign_factors
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import REACH, RISE, SetPrior
from enginediag_cli.isolation.subsets import log_bound_factors, log_leading_factors, wear_signs

NAMES = ("fan.efficiency", "fan.flow_capacity", "hpc.efficiency", "hpc.flow_capacity", "hpt.efficiency", "nozzle.area")
SURE = 1e-9
"""As good as no doubt about signs."""


def engine_score(rng, change):
    score = linear_score(rng, sensitivities(rng), change)
    return replace(score, parameters=NAMES, meaning=meaning_of(NAMES))


def of_set(posterior, names):
    truth = [n in names for n in NAMES]
    return float(posterior.probabilities[(posterior.masks == truth).all(axis=1)].sum())


def test_one_efficiency_has_the_marginal_likelihood_of_its_lopsided_prior():
    score = engine_score(np.random.default_rng(3), [0.001, 0, 0, 0, 0, 0])
    prior = SetPrior(slabs=(0.5,), p_recovery=0.1)
    b, information = score.scaled()
    x = np.linspace(-8, 8, 400000)
    density = np.exp(b[0] * x - 0.5 * information[0, 0] * x**2 - 0.5 * (x / 0.5) ** 2)
    within = 2 * np.where(x < 0, 0.9, np.where(x < RISE, 0.1 / (2 * ndtr(RISE / 0.5) - 1), 0.0))
    expected = np.log(within @ density / density.sum())
    mask = np.arange(6)[None] == 0
    assert log_bound_factors(score, mask, prior)[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("change", [-0.3, 0.08])
def test_a_change_beyond_what_a_component_can_do_has_the_likelihood_of_the_bound(change):
    """Of a fall to 70 % and of a rise by 8 %: as many nats lost as the nearest possible change leaves of χ²."""
    score = engine_score(np.random.default_rng(4), [change, 0, 0, 0, 0, 0])
    prior = SetPrior(slabs=(5.0,))
    b, information = score.scaled()
    bound = RISE if change > 0 else -REACH
    short = (b[0] / information[0, 0] - bound) * np.sqrt(information[0, 0])
    (found,) = log_bound_factors(score, np.arange(6)[None] == 0, prior)
    assert found == pytest.approx(-0.5 * short**2, rel=0.06) and found < -100


def test_an_instrument_has_the_marginal_likelihood_of_a_prior_that_ends_where_instruments_do():
    score = engine_score(np.random.default_rng(5), [0.01, 0, 0, 0, 0, 0])
    first = replace(score.described[0], family="sensor", wear=0, reach=1.5)
    score = replace(score, meaning={**score.meaning, NAMES[0]: first})
    prior = SetPrior(slabs=(0.5,), instrument_width=3.0)
    b, information = score.scaled()
    x = np.linspace(-1.5, 1.5, 400001)
    at_nominal = np.trapezoid(np.exp(-0.5 * (x / 1.5) ** 2), x)
    with_data = np.trapezoid(np.exp(b[0] * x - 0.5 * information[0, 0] * x**2 - 0.5 * (x / 1.5) ** 2), x)
    b, information = prior.scaled(score)
    A = 1 + 0.25 * information[0, 0]
    unbounded = 0.5 * 0.25 * b[0] ** 2 / A - 0.5 * np.log(A)
    (found,) = log_bound_factors(score, np.arange(6)[None] == 0, prior)
    assert unbounded + found == pytest.approx(np.log(with_data / at_nominal), abs=1e-4)


def test_of_several_efficiencies_it_is_nearly_the_orthant_integral():
    rng = np.random.default_rng(7)
    masks = np.array([[1, 0, 1, 0, 0, 0], [1, 1, 1, 0, 0, 0], [1, 0, 1, 0, 1, 0], [1, 1, 1, 1, 1, 1]], bool)
    for change in ([-0.002, 0, -0.001, 0, 0, 0], [0.001, 0, 0, -0.002, -0.001, 0]):
        score, prior = engine_score(rng, change), SetPrior(p_recovery=SURE)
        exact = np.log(sign_factors(score, masks, wear_signs(score, prior), prior))
        np.testing.assert_allclose(log_bound_factors(score, masks, prior), exact, atol=0.15)


def test_even_chances_and_sets_without_efficiencies_change_nothing():
    score = engine_score(np.random.default_rng(1), [0, -0.002, 0, 0, 0, 0])
    masks = np.array([[0, 1, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0]], bool)
    np.testing.assert_allclose(log_leading_factors(score, masks, np.zeros(2), SetPrior()), 0, atol=1e-6)
    even = set_posterior(score, SetPrior(p_recovery=0.5))
    plain = set_posterior(replace(score, meaning={}), SetPrior())
    np.testing.assert_allclose(even.inclusion, plain.inclusion, atol=0.02)  # rises have a nearer bound


def test_a_fall_is_held_more_probable_and_a_rise_less_and_a_clear_rise_is_still_named():
    rng = np.random.default_rng(5)
    falls, rises = [], []
    for _ in range(20):
        for size, found in ((-0.003, falls), (0.003, rises)):
            score = engine_score(rng, [size, 0, 0, 0, size, 0])
            known, even = set_posterior(score), set_posterior(score, SetPrior(p_recovery=0.5))
            names = (NAMES[0], NAMES[4])
            found.append(of_set(known, names) - of_set(even, names))
    assert np.mean(falls) > 0 > np.mean(rises)
    clear = engine_score(rng, [0.03, 0, 0, 0, 0, 0])
    assert set_posterior(clear).names(0) == (NAMES[0],)


def test_engines_drawn_from_the_prior_get_worse_by_wear_as_often_as_it_says():
    prior, wear = SetPrior(p_recovery=0.05), np.array([-1, 0, 1])
    changed, size = prior.draw(np.random.default_rng(2), 20_000, 3, wear=wear)
    share = [float(np.mean(size[changed[:, i], i] < 0)) for i in range(3)]
    assert share == pytest.approx([0.95, 0.5, 0.05], abs=0.02)


def test_stated_probabilities_are_right_for_engines_drawn_from_the_prior():
    rng, prior = np.random.default_rng(8), SetPrior(inclusion=0.2, slabs=(0.15,))
    stated, right = [], []
    wear = wear_signs(engine_score(rng, np.zeros(6)), prior)
    for truth, size in zip(*prior.draw(rng, 400, 6, wear=wear), strict=True):
        score = engine_score(rng, 0.02 * size)
        found = set_posterior(score, prior)
        stated.append(found.probabilities[0])
        right.append((found.masks[0] == truth).all())
    error = np.sqrt(np.sum(np.array(stated) * (1 - np.array(stated)))) / len(stated)
    assert np.mean(right) == pytest.approx(np.mean(stated), abs=3 * error)
