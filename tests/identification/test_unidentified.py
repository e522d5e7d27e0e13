"""Combinations that the data leave open, by name."""

from __future__ import annotations

import numpy as np
import pytest

from enginediag_cli.identification.covariance import unidentified_combinations

NAMES = ("a", "b", "c", "d")


def open_combinations(J, prior_sigma):
    scaled = np.asarray(J, float) * prior_sigma
    information = scaled.T @ scaled
    return unidentified_combinations(
        information,
        np.linalg.inv(information + np.eye(len(prior_sigma))),
        np.asarray(prior_sigma, float),
        NAMES[: len(prior_sigma)],
    )


def test_nothing_is_named_when_all_is_seen():
    assert open_combinations(100 * np.eye(3), [1.0, 1.0, 1.0]) == ()


def test_two_parameters_seen_only_as_a_sum_are_open_in_their_difference():
    found = open_combinations([[100, 100, 0], [0, 0, 50]], [1.0, 1.0, 1.0])
    assert len(found) == 1
    assert set(found[0].parameters) == {"a", "b"}
    assert found[0].coefficients[1] == pytest.approx(-1.0)
    assert found[0].from_data == pytest.approx(0.0, abs=1e-6)


def test_coefficients_are_in_the_parameters_own_units():
    """Seen as a + 3b: when a rises by 1 and b falls by a third nothing is seen, whatever the priors are."""
    for prior_sigma in ([1.0, 1.0], [2.0, 0.5]):
        found = open_combinations([[100, 300]], prior_sigma)
        c = dict(zip(found[0].parameters, found[0].coefficients, strict=True))
        assert c["b"] / c["a"] == pytest.approx(-1 / 3)


def test_an_unseen_parameter_is_named_alone_beside_an_open_combination():
    found = open_combinations([[100, 100, 0, 0], [0, 0, 30, 0]], np.ones(4))
    assert ("d",) in [c.parameters for c in found]
    assert {"a", "b"} in [set(c.parameters) for c in found]
    assert len(found) == 2


def test_the_sentence_says_how_much_the_data_give():
    found = open_combinations([[100, 100], [0.1, -0.1]], [1.0, 1.0])
    assert str(found[0]).endswith(": data give 2 % of what is known")
