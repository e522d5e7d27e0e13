"""The prior over sets of changed parameters and over the sizes of changes."""

from __future__ import annotations

from itertools import product
from math import comb

import numpy as np
import pytest

from enginediag_cli.isolation.prior import InstrumentForms, SetPrior


@pytest.mark.parametrize("prior", [SetPrior(), SetPrior(0.3, 0.0), SetPrior(0.05, 1.0)])
def test_the_probabilities_of_all_sets_sum_to_one_and_have_the_stated_mean(prior):
    p = 11
    sizes = np.array([comb(p, k) for k in range(p + 1)]) * np.exp(prior.log_size_probability(p))
    assert sizes.sum() == pytest.approx(1)
    assert sizes @ np.arange(p + 1) == pytest.approx(
        p * ((1 - prior.p_uniform_wear) * prior.change_probabilities.mean() + prior.p_uniform_wear / 2)
    )


def test_on_a_worn_engine_every_number_of_changes_is_equally_probable():
    sizes = np.array([comb(8, k) for k in range(9)]) * np.exp(SetPrior(p_uniform_wear=1.0).log_size_probability(8))
    np.testing.assert_allclose(sizes, 1 / 9)


def test_drawn_engines_follow_the_prior():
    prior = SetPrior(0.2, 0.3, (0.5, 2.0))
    changed, size = prior.draw(np.random.default_rng(1), 20_000, 5)
    assert np.array_equal(changed, size != 0)
    counts = np.bincount(changed.sum(axis=1), minlength=6) / 20_000
    expected = np.array([comb(5, k) for k in range(6)]) * np.exp(prior.log_size_probability(5))
    np.testing.assert_allclose(counts, expected, atol=0.015)  # four standard errors at most
    assert np.mean(size[changed] ** 2) == pytest.approx((0.5**2 + 2.0**2) / 2, rel=0.1)


def sets_and_sensors(p, m):
    """All sets of p health parameters and m sensors, and which are sensors."""
    return np.array(list(product([False, True], repeat=p + m))), np.arange(p + m) >= p


def test_sensors_are_wrong_apart_from_the_engine_and_few_at_once():
    prior, (masks, sensors) = SetPrior(0.2, 0.3, sensor=0.1), sets_and_sensors(3, 4)
    probability = np.exp(prior.log_probability(masks, InstrumentForms.single_form(sensors)))
    wrong = (masks & sensors).sum(axis=1)
    assert probability.sum() == pytest.approx(1) and np.all(probability[wrong > 2] == 0)
    expected = np.array([comb(4, j) * 0.1**j * 0.9 ** (4 - j) for j in range(3)])
    np.testing.assert_allclose([probability[wrong == j].sum() for j in range(3)], expected / expected.sum())
    healthy = masks[:, :3].sum(axis=1) == 0
    assert probability[healthy].sum() == pytest.approx(np.exp(prior.log_size_probability(3)[0]))


def test_a_valve_is_as_probable_as_a_parameter_of_the_engine_and_an_instrument_is_not():
    """All sets of an engine's parameter, a valve and two instruments of two forms each: their sum and their odds."""
    instruments = InstrumentForms(np.array([-1, 0, 1, 1, 2, 2]), valves=frozenset({0}))
    prior, masks = SetPrior(0.2, 0.0, sensor=0.01, odds_factors=(1.0,)), sets_and_sensors(6, 0)[0]
    logs = prior.log_probability(masks, instruments)
    assert np.exp(logs).sum() == pytest.approx(1)
    of = {tuple(np.flatnonzero(mask).tolist()): log for mask, log in zip(masks, logs, strict=True)}
    assert of[1,] == pytest.approx(of[0,])
    assert np.exp(of[1,] - of[()]) == pytest.approx(0.2 / 0.8)
    assert np.exp(of[2,] - of[()]) == pytest.approx(0.01 / 0.99 / 2)
    assert of[2, 3] == of[1, 2, 4] == -np.inf
    changed, _ = prior.draw(np.random.default_rng(4), 40_000, 6, instruments)
    assert changed[:, 1].mean() == pytest.approx(np.exp(logs[masks[:, 1]]).sum(), abs=0.01)  # five standard errors


def test_without_sensors_the_prior_is_that_of_the_size():
    prior, (masks, sensors) = SetPrior(), sets_and_sensors(4, 0)
    np.testing.assert_allclose(
        prior.log_probability(masks, InstrumentForms.single_form(sensors)),
        prior.log_size_probability(4)[masks.sum(axis=1)],
    )


def test_drawn_sensors_follow_the_prior():
    prior, (masks, sensors) = SetPrior(0.2, 0.3, sensor=0.2), sets_and_sensors(2, 4)
    changed, _ = prior.draw(np.random.default_rng(2), 20_000, 6, InstrumentForms.single_form(sensors))
    wrong = np.bincount((changed & sensors).sum(axis=1), minlength=5) / 20_000
    own = (masks & sensors).sum(axis=1)
    expected = [
        np.exp(prior.log_probability(masks, InstrumentForms.single_form(sensors)))[own == j].sum() for j in range(5)
    ]
    np.testing.assert_allclose(wrong, expected, atol=0.015)  # four standard errors at most


def test_errors_of_instruments_are_drawn_wider_than_changes_of_the_engine():
    prior, sensors = SetPrior(0.9, sensor=0.5, slabs=(1.0,), instrument_width=4.0), np.array([False, True])
    changed, size = prior.draw(np.random.default_rng(3), 20_000, 2, InstrumentForms.single_form(sensors))
    spread = [np.std(size[changed[:, i], i]) for i in range(2)]
    np.testing.assert_allclose(spread, [1.0, 4.0], rtol=0.05)


@pytest.mark.parametrize(
    "wrong",
    [
        {"inclusion": 0.0},
        {"inclusion": 1.0},
        {"p_uniform_wear": -0.1},
        {"slabs": ()},
        {"slabs": (0.5, -1.0)},
        {"sensor": 0.0},
        {"max_sensor_faults": -1},
        {"instrument_width": 0.0},
    ],
)
def test_an_impossible_prior_is_refused(wrong):
    with pytest.raises(ValueError, match="must"):
        SetPrior(**wrong)
