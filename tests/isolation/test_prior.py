"""The prior over sets of changed parameters and over the sizes of changes."""

from __future__ import annotations

from math import comb

import numpy as np
import pytest

from enginediag_cli.isolation.prior import SetPrior


@pytest.mark.parametrize("prior", [SetPrior(), SetPrior(0.3, 0.0), SetPrior(0.05, 1.0)])
def test_the_probabilities_of_all_sets_sum_to_one_and_have_the_stated_mean(prior):
    p = 11
    sizes = np.array([comb(p, k) for k in range(p + 1)]) * np.exp(prior.log_of_size(p))
    assert sizes.sum() == pytest.approx(1)
    assert sizes @ np.arange(p + 1) == pytest.approx(p * ((1 - prior.worn) * prior.inclusion + prior.worn / 2))


def test_on_a_worn_engine_every_number_of_changes_is_equally_probable():
    sizes = np.array([comb(8, k) for k in range(9)]) * np.exp(SetPrior(worn=1.0).log_of_size(8))
    np.testing.assert_allclose(sizes, 1 / 9)


def test_drawn_engines_follow_the_prior():
    prior = SetPrior(0.2, 0.3, (0.5, 2.0))
    changed, size = prior.draw(np.random.default_rng(1), 20_000, 5)
    assert np.array_equal(changed, size != 0)
    counts = np.bincount(changed.sum(axis=1), minlength=6) / 20_000
    expected = np.array([comb(5, k) for k in range(6)]) * np.exp(prior.log_of_size(5))
    np.testing.assert_allclose(counts, expected, atol=0.015)  # four standard errors at most
    assert np.mean(size[changed] ** 2) == pytest.approx((0.5**2 + 2.0**2) / 2, rel=0.1)


@pytest.mark.parametrize(
    "wrong", [{"inclusion": 0.0}, {"inclusion": 1.0}, {"worn": -0.1}, {"slabs": ()}, {"slabs": (0.5, -1.0)}]
)
def test_an_impossible_prior_is_refused(wrong):
    with pytest.raises(ValueError, match="must"):
        SetPrior(**wrong)
