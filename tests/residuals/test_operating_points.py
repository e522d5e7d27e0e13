"""Errors that differ from operating point to operating point, in the statistics of a window."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from white_statistics import local_statistics, white_noise

from enginediag_cli.residuals.relinearise import covariance_of_change, point_sums
from enginediag_cli.residuals.score import marginalise
from enginediag_cli.residuals.statistics import ParameterFrame

P, M = 3, 4
NAMES = ("a", "b", "c")
COLUMNS = np.array([0, 2])
VARIANCE = np.array([4e-4, 1e-4])


def window(points, n=30, seed=0):
    """Residuals, sensitivities and predictions of n records at each of so many operating points, none twice alike."""
    rng = np.random.default_rng(seed)
    at = np.repeat(np.arange(points), n)
    predicted = np.outer(1.0 + at, [100.0, 200.0, 50.0, 10.0]) * (1 + 1e-5 * rng.standard_normal((len(at), M)))
    return predicted, rng.standard_normal((len(at), M)), 20 * rng.normal(size=(points, M, P))[at], at


def statistics_of(predicted, e, J):
    noise = white_noise(np.ones(M))
    found = local_statistics(e, J, noise, ParameterFrame(NAMES, np.ones(P), np.full(P, 0.02)))
    return replace(found, points=point_sums(predicted, e, J, noise, COLUMNS))


def test_at_one_operating_point_the_change_is_as_uncertain_as_the_error():
    """But for the share in which the records tell less than is known beforehand: a thousandth with so many."""
    predicted, e, J, _ = window(1)
    s = statistics_of(predicted, e, 100 * J)
    found = covariance_of_change(s, s, np.zeros((P, P)), VARIANCE)
    np.testing.assert_allclose(found, np.diag([4e-4, 0.0, 1e-4]), atol=1e-7)


def test_two_parameters_that_look_alike_get_no_changes_that_cancel():
    """A further column that differs by one per cent from another: the errors are as small as they were without it, and
    do the same to the readings where sensitivities are a little others."""
    predicted, e, J, _ = window(3)
    alike = np.concatenate([J, J[:, :, 2:] * (1 + 1e-2 * np.linspace(-1, 1, len(J))[:, None, None])], axis=2)
    noise = white_noise(np.ones(M))
    frame = ParameterFrame((*NAMES, "d"), np.ones(P + 1), np.full(P + 1, 0.02))
    found = replace(local_statistics(e, alike, noise, frame), points=point_sums(predicted, e, alike, noise, COLUMNS))
    covariance = covariance_of_change(found, found, np.zeros((P + 1, P + 1)), VARIANCE)
    assert np.sqrt(np.diag(covariance)).max() < 3 * np.sqrt(VARIANCE.max())
    plain = covariance_of_change(*[statistics_of(predicted, e, J)] * 2, np.zeros((P, P)), VARIANCE)
    elsewhere = alike * (1 + 0.01 * np.random.default_rng(3).standard_normal(alike.shape[1:]))
    done = np.einsum("kmp,pq,kmq->km", elsewhere, covariance, elsewhere).sum()
    expected = np.einsum("kmp,pq,kmq->km", elsewhere[:, :, :P], plain, elsewhere[:, :, :P]).sum()
    assert done == pytest.approx(expected, rel=0.1)


def test_errors_of_many_points_scatter_the_estimate_by_what_is_said():
    predicted, _, J, at = window(5)
    s = statistics_of(predicted, np.zeros(J.shape[:2]), J)
    said = covariance_of_change(s, s, np.zeros((P, P)), VARIANCE)
    rng = np.random.default_rng(1)
    delta = np.zeros((4000, 5, P))
    delta[:, :, COLUMNS] = np.sqrt(VARIANCE) * rng.standard_normal((4000, 5, 2))
    off = np.einsum("kmp,rkp->rkm", J, delta[:, at])
    estimates = np.linalg.solve(s.F, np.einsum("kmp,rkm->pr", J, off))
    np.testing.assert_allclose(np.cov(estimates), said, atol=0.1 * np.max(said))


def test_what_counts_as_noise_takes_its_part_of_the_errors():
    """With c as nuisance of variance C the statistic of a and b is the part of (1 + F C)⁻¹ s that is theirs."""
    predicted, e, J, _ = window(4)
    s = statistics_of(predicted, e, J)
    C = np.diag([0.0, 0.0, 0.01**2])
    kept = marginalise(s, ("a", "b"), C)
    through = np.linalg.inv(np.eye(P) + s.F @ C)[:2]
    np.testing.assert_allclose(kept.s, through @ s.s)
    inner = np.linalg.inv(kept.F + np.diag(kept.prior_sigma**-2.0)) @ through
    expected = inner @ np.einsum("q,qij->ij", VARIANCE, s.points) @ inner.T
    np.testing.assert_allclose(covariance_of_change(s, kept, C, VARIANCE), expected, rtol=1e-8)


def test_records_without_a_reading_are_at_no_point():
    predicted, e, J, at = window(3)
    e[at == 1] = np.nan
    some = at != 1
    whole, part = statistics_of(predicted, e, J), statistics_of(predicted[some], e[some], J[some])
    np.testing.assert_allclose(whole.points, part.points)
    assert whole.points == pytest.approx(np.swapaxes(whole.points, 1, 2))
