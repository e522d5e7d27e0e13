"""Numbers as people write them."""

from __future__ import annotations

import math

import pytest

from enginediag_cli.report.sentences import format_quantity, p_value, probability, rounded


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [(2.0345, 0.31, "2.0"), (2.0345, 0.14, "2.03"), (123456.7, 2345.0, "123000"), (-0.04, 0.3, "0.0")],
)
def test_a_value_has_the_decimals_that_its_uncertainty_supports(value, uncertainty, text):
    assert rounded(value, uncertainty) == text


@pytest.mark.parametrize(("value", "text"), [(0.00123, "0.00123"), (250000.0, "250000"), (1e9, "1e+09"), (0.0, "0")])
def test_a_value_without_uncertainty_has_three_digits_and_rarely_an_exponent(value, text):
    assert rounded(value) == text


def test_an_unknown_value_is_said_to_be_unknown():
    assert rounded(math.nan) == "unknown"


def test_the_unit_stands_behind_value_and_uncertainty():
    assert format_quantity(4.12, "K", 0.8) == "4.1 K ± 0.8 K"
    assert format_quantity(4.12, "K") == "4.12 K"


def test_a_probability_never_claims_certainty():
    assert [probability(p) for p in (1.0, 0.97, 0.0)] == ["> 0.99", "0.97", "< 0.01"]


def test_a_tiny_p_value_is_a_bound():
    assert [p_value(p) for p in (0.253, 0.031, 2.3e-5, 0.0)] == ["0.25", "0.03", "2e-05", "< 1e-12"]
