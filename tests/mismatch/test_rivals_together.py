"""What is told of rivals that two searches have found: no more than certainty for all of them."""

from __future__ import annotations

import pytest

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.explain import _together
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import EFFECT, Option


def told(name: str, probability: float) -> Explanation:
    return Explanation((Option(EFFECT, name, "", CONSTANT, Hypothesis()),), (), 0.0, 0.0, probability, 0.0, 1.0)


def test_probabilities_of_rivals_add_up_to_certainty_at_most_and_keep_their_odds():
    found = _together([told("a", 0.9)], [told("b", 0.3), told("a", 0.1)])
    assert [x.label for x in found] == ["a", "b"]
    assert [x.probability for x in found] == pytest.approx([0.75, 0.25])


def test_what_leaves_room_for_others_stays_as_it_is():
    assert [x.probability for x in _together([told("a", 0.5)], [told("b", 0.2)])] == [0.5, 0.2]
