"""Smallest detectable changes are those that the tests then detect with the stated power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ncx2

from enginediag_cli.detection.verdict import (
    minimum_change,
    required_changes,
    threshold,
    undetectable_components,
)
from enginediag_cli.parameters import Parameter
from enginediag_cli.residuals.score import Score


def score_of(information, sigma=0.02):
    p = len(information)
    return Score(
        tuple("abcdef"[:p]),
        np.ones(p),
        np.full(p, sigma),
        np.zeros(p),
        information,
        0.0,
        int(np.linalg.matrix_rank(information)),
    )


def random_information(p=4, seed=1):
    A = np.random.default_rng(seed).standard_normal((20, p)) * 50
    return A.T @ A


def test_the_global_test_sees_the_smallest_change_with_the_stated_power():
    score = score_of(random_information())
    for i, size in enumerate(minimum_change(score, false_alarm=0.01, power=0.8)):
        change = np.zeros(4)
        change[i] = size
        noncentrality = float(change @ score.information @ change)
        assert ncx2.sf(threshold(score.rank, 0.01), score.rank, noncentrality) == pytest.approx(0.8, abs=1e-8)


def test_a_parameter_that_is_not_excited_has_no_smallest_change():
    information = random_information()
    information[3] = information[:, 3] = 0.0
    sizes = minimum_change(score_of(information))
    assert np.isinf(sizes[3]) and np.isfinite(sizes[:3]).all()


def parameter(name, quantity, family="health"):
    component = name.rpartition(".")[0]
    return Parameter(name, family, 1.0, 0.5, 1.5, 0.02, "1", component=component, quantity=quantity, words=name)


NAMES = ("fan.efficiency", "fan.flow_capacity", "hpc.efficiency", "sensor.T3.bias", "bleed.fraction")
QUANTITIES = ("efficiency", "flow_capacity", "efficiency", "bias", "fraction")


def described_score():
    families = ("health", "health", "health", "sensor", "health")
    known = {n: parameter(n, q, f) for n, q, f in zip(NAMES, QUANTITIES, families, strict=True)}
    score = score_of(np.eye(5))
    return replace(score, parameters=NAMES, meaning=known, prior_sigma=np.array([0.02, 0.02, 0.02, 5.0, 0.01]))


def test_what_must_show_is_by_quantity_or_as_a_site_chooses_and_nothing_of_instruments():
    score = described_score()
    assert required_changes(score.described, score.prior_sigma).tolist() == [0.02, 0.03, 0.02, np.inf, 0.01]
    chosen = (("*.efficiency", 0.005), ("hpc.*", 0.01), ("sensor.*", 2.0))
    assert required_changes(score.described, score.prior_sigma, chosen).tolist() == [0.005, 0.03, 0.01, 2.0, 0.01]


def test_a_component_is_seen_by_the_parameter_of_it_that_shows_best():
    score = described_score()
    limits = required_changes(score.described, score.prior_sigma)
    assert undetectable_components(score, np.array([0.5, 0.029, 0.019, 9.0, 0.01]), limits) == []
    unseen = undetectable_components(score, np.array([0.05, 0.06, 0.1, 9.0, np.inf]), limits)
    assert [u.parameter.name for u in unseen] == ["bleed.fraction", "hpc.efficiency", "fan.flow_capacity"]
    assert (unseen[2].size, unseen[2].limit) == (0.06, 0.03)


def test_a_power_below_the_false_alarm_rate_is_refused():
    with pytest.raises(ValueError, match="must"):
        minimum_change(score_of(random_information()), power=0.001)
