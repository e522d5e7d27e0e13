"""The size of a named change is averaged over the sets that may be right: unsure sets make intervals wider."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from enginediag_cli.isolation.posterior import absorb_small_changes, average_sizes, least_relevant_change, set_posterior
from enginediag_cli.isolation.prior import SetPrior
from enginediag_cli.isolation.results import estimate_sizes
from enginediag_cli.residuals.score import Score

PRIOR = SetPrior(0.2, slabs=(0.5, 2.0))


def named(score):
    posterior = set_posterior(score, PRIOR)
    return posterior, average_sizes(score, posterior, posterior.names(0), PRIOR)


def score_of(information, change):
    """Score without noise of a change, both in prior standard deviations of 0.02."""
    information, p = np.asarray(information, float), len(information)
    b = information @ np.asarray(change, float)
    names = tuple(f"p{i}" for i in range(p))
    return Score(names, np.ones(p), np.full(p, 0.02), b / 0.02, information / 0.02**2, float(b @ change), p)


def test_a_change_far_above_the_noise_has_the_size_and_interval_of_its_set_alone():
    score = score_of(np.eye(3) * 4e4, [1.0, 0.0, 0.0])
    posterior, (size,) = named(score)
    (alone,) = estimate_sizes(score, posterior.names(0))
    assert size.change == pytest.approx(alone.change, rel=0.01)
    assert (size.lower, size.upper) == pytest.approx((alone.lower, alone.upper), rel=0.01)


def test_sets_that_compete_widen_the_interval_to_hold_the_size_under_each():
    # the second parameter imitates most of the first
    score = score_of(100 * np.array([[1.0, 0.95], [0.95, 1.0]]), [0.9, 0.0])
    posterior, (size,) = named(score)
    (alone,) = estimate_sizes(score, posterior.names(0))
    assert size.upper - size.lower > 1.2 * (alone.upper - alone.lower)


def test_quantiles_are_those_of_draws_from_the_mixture():
    score = score_of(30 * np.array([[1.0, 0.8], [0.8, 1.0]]), [0.7, 0.2])
    posterior = set_posterior(score, PRIOR)
    (size,) = average_sizes(score, posterior, (score.parameters[0],), PRIOR, 0.9)
    b, information = score.scaled()
    rng, weights, draws = np.random.default_rng(0), [], []
    for mask, probability in zip(posterior.masks, posterior.probabilities, strict=True):
        if not mask[0]:
            continue
        s = np.flatnonzero(mask)
        each = []
        for slab in PRIOR.slabs:
            P = np.linalg.inv(information[np.ix_(s, s)] + np.eye(len(s)) / slab**2)
            log = 0.5 * b[s] @ P @ b[s] + 0.5 * np.linalg.slogdet(P)[1] - len(s) * np.log(slab)
            each.append((log, (P @ b[s])[0], P[0, 0] ** 0.5))
        share = np.exp([log for log, _, _ in each])
        weights += list(probability * share / share.sum())
        draws += [rng.normal(mean, spread, 400_000) for _, mean, spread in each]
    chosen = rng.choice(len(weights), 400_000, p=np.array(weights) / np.sum(weights))
    drawn = np.array(draws)[chosen, np.arange(400_000)] * score.prior_sigma[0]
    assert size.change == pytest.approx(drawn.mean(), abs=0.005 * drawn.std())
    assert size.standard_error == pytest.approx(drawn.std(), rel=0.01)
    assert size.reach == pytest.approx(np.quantile(drawn, 0.95) - drawn.mean(), abs=0.02 * drawn.std())
    unchanged = rng.random(400_000) > posterior.inclusion[0]
    every = np.where(unchanged, 0.0, drawn)
    assert 0.895 < np.mean((every >= size.lower) & (every <= size.upper)) < 0.93


def test_an_interval_reaches_to_no_change_where_the_parameter_may_not_have_changed():
    score = score_of(np.eye(2) * 400, [0.17, 0.0])
    posterior, (size,) = named(score)
    assert 0.6 < posterior.inclusion[0] < 0.95
    assert size.lower == 0.0 < size.change < size.upper
    assert size.reach < size.change  # had it changed, it would not have been by nothing


def test_a_change_that_is_nearly_sure_keeps_an_interval_away_from_none():
    score = score_of(np.eye(2) * 400, [0.22, 0.0])
    posterior, (size,) = named(score)
    assert 0.97 < posterior.inclusion[0] < 0.999
    assert 0.0 < size.lower and size.upper - size.change > size.reach


@pytest.mark.slow
def test_intervals_of_what_is_named_hold_the_truth_as_often_as_they_say_where_truths_follow_the_prior():
    rng, information, held = np.random.default_rng(8), 60 * (0.6 * np.eye(4) + 0.4), []
    root = np.linalg.cholesky(information)
    for change in PRIOR.draw(rng, 1500, 4)[1]:
        score = score_of(information, change)
        score = replace(score, b=score.b + root @ rng.standard_normal(4) / 0.02)
        _, sizes = named(score)
        truth = dict(zip(score.parameters, change * 0.02, strict=True))
        held += [s.lower <= truth[s.parameter] <= s.upper for s in sizes]
    assert len(held) > 200
    assert 0.94 < np.mean(held) < 0.985


def test_a_change_that_the_data_do_not_determine_is_as_wide_as_its_prior():
    score = score_of(np.array([[1e-6]]), [0.0])
    posterior = set_posterior(score, PRIOR)
    (size,) = average_sizes(score, posterior, (score.parameters[0],), PRIOR)
    assert size.standard_error == pytest.approx(score.prior_sigma[0] * np.mean(np.square(PRIOR.slabs)) ** 0.5, rel=0.02)


def test_the_fit_of_the_full_model_counts_for_the_set_that_was_fitted():
    score = score_of(np.eye(2) * 1e4, [1.0, 0.0])
    posterior = set_posterior(score, PRIOR)
    own = replace(score, b=0.5 * score.b)
    (size,) = average_sizes(score, posterior, posterior.names(0), PRIOR, about={posterior.masks[0].tobytes(): own})
    (plain,) = average_sizes(score, posterior, posterior.names(0), PRIOR)
    assert size.change < 0.7 * plain.change


def test_nothing_named_has_no_size():
    score = score_of(np.eye(2), [0.0, 0.0])
    assert average_sizes(score, set_posterior(score, PRIOR), (), PRIOR) == ()


def test_an_answer_is_as_probable_as_that_nothing_else_matters_in_engines_drawn_from_the_prior():
    prior, rng, p = SetPrior(0.15), np.random.default_rng(11), 6
    J = rng.standard_normal((60, p)) / np.sqrt(60)
    information = (J.T @ J) / 0.15**2  # a change of a prior standard deviation is seen at six or seven times its error
    stated, true = [], []
    changed, sizes = prior.draw(rng, 400, p)
    for members, size in zip(changed, sizes, strict=True):
        b = information @ size + np.linalg.cholesky(information) @ rng.standard_normal(p)
        names = tuple(f"p{i}" for i in range(p))
        glr = float(b @ np.linalg.solve(information, b))
        score = Score(names, np.ones(p), np.full(p, 0.02), b / 0.02, information / 0.02**2, glr, p)
        posterior = absorb_small_changes(score, set_posterior(score, prior), prior)
        assert posterior.probabilities.sum() == pytest.approx(1.0)
        least = least_relevant_change(score.described, score.prior_sigma)
        answer = posterior.masks[0]
        stated.append(posterior.probabilities[0])
        true.append(bool(np.all(members[answer])) and bool(np.all(np.abs(0.02 * size[~answer]) < least[~answer])))
    assert abs(np.mean(true) - np.mean(stated)) < 0.07  # three standard errors of 400, and slabs wider than the widest
    sure = np.array(stated) > 0.9
    assert np.mean(np.array(true)[sure]) > 0.9 and sure.mean() > 0.4


def test_a_change_that_the_data_do_not_show_may_matter_and_what_they_show_small_does_not():
    # the third parameter is hardly seen, the second to a tenth of what matters
    score = score_of(np.diag([4e4, 4e4, 1e-3]), [1.0, 0.0, 0.0])
    exactly = set_posterior(score, PRIOR)
    posterior = absorb_small_changes(score, exactly, PRIOR)
    assert posterior.names(0) == exactly.names(0) == ("p0",)
    both, unseen = (exactly.masks == [[True, True, False]]).all(axis=1), (exactly.masks[:, 2]).sum()
    assert exactly.probabilities[both] > 0.001 and unseen
    gained = posterior.probabilities[0] - exactly.probabilities[0]
    assert gained > 0.99 * exactly.probabilities[both][0]
    assert posterior.probabilities[0] < 1 - 0.5 * exactly.inclusion[2]
