"""Knowledge of the sign of changes in the posterior over sets."""

from __future__ import annotations

import numpy as np
import pytest
from parameter_makers import described
from scipy.stats import multivariate_normal
from score_makers import linear_score, sensitivities

from enginediag_cli.faults.catalogue import ComponentFault
from enginediag_cli.isolation.catalogue import (
    known_signs,
    one_sided_posterior,
    orthant_moments,
    orthant_probability,
    sign_factors,
)
from enginediag_cli.isolation.posterior import set_posterior
from enginediag_cli.isolation.prior import SetPrior


def covariances(rng, w, d):
    half = rng.standard_normal((w, d, d + 2))
    return half @ np.swapaxes(half, 1, 2)


@pytest.mark.parametrize(("d", "error"), [(1, 1e-12), (2, 1e-3), (3, 3e-3), (5, 4e-3)])
def test_orthant_probabilities_agree_with_scipy(d, error):
    rng = np.random.default_rng(d)
    mean, covariance = rng.standard_normal((6, d)), covariances(rng, 6, d)
    found = orthant_probability(mean, covariance)
    for k in range(6):
        exact = multivariate_normal.cdf(mean[k], mean=np.zeros(d), cov=covariance[k], rng=0, abseps=1e-5)
        assert found[k] == pytest.approx(exact, abs=error)


def test_the_orthant_of_an_equicorrelated_pair_has_its_arcsine_probability():
    rho = np.array([-0.9, -0.3, 0.0, 0.5, 0.95])
    C = np.array([[[1, r], [r, 1]] for r in rho])
    exact = 0.25 + np.arcsin(rho) / (2 * np.pi)
    assert orthant_probability(np.zeros((5, 2)), C) == pytest.approx(exact, abs=3e-3)


def test_moments_of_a_cut_pair_agree_with_sampling():
    rng = np.random.default_rng(11)
    mean, C = np.array([[0.5, -0.3]]), np.array([[[1.0, -0.6], [-0.6, 1.0]]])
    x = rng.multivariate_normal(mean[0], C[0], 400_000)
    x = x[(x > 0).all(axis=1)]
    _, centre, spread = orthant_moments(mean, C, points=2000)
    assert centre[0] == pytest.approx(x.mean(axis=0), abs=0.01)
    assert spread[0] == pytest.approx(np.cov(x.T), abs=0.01)


def test_one_signed_parameter_has_the_marginal_likelihood_of_a_half_normal_prior():
    rng = np.random.default_rng(3)
    score = linear_score(rng, sensitivities(rng, p=2), [0.001, 0.0])
    prior = SetPrior(slabs=(0.5,))
    b, information = score.scaled()
    # 2 ∫_{x<0} N(x; 0, slab²) exp(b x − ½ I x²) dx over the same integral on both sides
    x = np.linspace(-8, 8, 400000)
    density = np.exp(b[0] * x - 0.5 * information[0, 0] * x**2 - 0.5 * (x / 0.5) ** 2)
    factor = sign_factors(score, np.array([[True, False]]), np.array([-1.0, 0.0]), prior)
    assert factor[0] == pytest.approx(2 * density[x < 0].sum() / density.sum(), rel=1e-4)


def test_signs_that_nobody_knows_change_nothing():
    rng = np.random.default_rng(4)
    score = linear_score(rng, sensitivities(rng), [0.004, 0, 0, 0, 0, 0])
    plain = set_posterior(score)
    cut = one_sided_posterior(score, plain, np.zeros(6))
    np.testing.assert_allclose(cut.probabilities, plain.probabilities, rtol=1e-12)
    assert (cut.masks == plain.masks).all()


def test_right_signs_raise_the_true_set_and_wrong_signs_lower_it():
    rng = np.random.default_rng(5)
    change = np.array([-0.003, 0, 0, -0.003, 0, 0])
    truth = change != 0

    def of_truth(posterior):
        return posterior.probabilities[(posterior.masks == truth).all(axis=1)][0]

    gains = []
    for _ in range(20):
        score = linear_score(rng, sensitivities(rng), change)
        plain = set_posterior(score)
        right = of_truth(one_sided_posterior(score, plain, np.full(6, -1.0)))
        wrong = of_truth(one_sided_posterior(score, plain, np.full(6, 1.0)))
        assert wrong < of_truth(plain)
        gains.append(right - of_truth(plain))
    assert np.mean(gains) > 0


def test_a_clear_change_against_its_sign_is_still_isolated():
    rng = np.random.default_rng(6)
    score = linear_score(rng, sensitivities(rng), [0.03, 0, 0, 0, 0, 0])
    assert one_sided_posterior(score, set_posterior(score), np.full(6, -1.0)).names(0) == ("p0",)


def test_efficiencies_fall_and_capacities_follow_the_catalogue_where_it_agrees_with_itself():
    names = tuple(
        map(
            described,
            ("hpc.efficiency", "hpc.flow_capacity", "hpt.flow_capacity", "core_nozzle.area", "sensor.T3.bias"),
        )
    )
    faults = [
        ComponentFault("fouling", {"hpc.flow_capacity": -0.03, "hpc.efficiency": -0.01}),
        ComponentFault("erosion", {"hpt.flow_capacity": 0.02}),
        ComponentFault("opened", {"core_nozzle.area": 0.02}),
        ComponentFault("dented", {"core_nozzle.area": -0.02}),
    ]
    assert known_signs(names, faults).tolist() == [-1, -1, 1, 0, 0]
    assert known_signs(names).tolist() == [-1, 0, 0, 0, 0]
