"""What is named is as likely as it is among all sets that were fitted, those that leave something included."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from enginediag_cli.drivers import CONSTANT
from enginediag_cli.mismatch.explain.among_all import among_all
from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.fit.extended import Discrepancy
from enginediag_cli.mismatch.fit.identified import Hypothesis
from enginediag_cli.mismatch.fit.options import EFFECT, FORMULA_OPTION, FREE, Option


def option(name: str, kind: str = EFFECT, at: str = "") -> Option:
    moved = (Discrepancy(at, name, 1.0),) if at else ()
    return Option(kind, name, "", CONSTANT, Hypothesis((), moved))


A, B, C = map(option, "abc")
LAW_AT_X, OTHER_LAW_AT_X, FREE_AT_X = (
    option("l", FORMULA_OPTION, "x"),
    option("m", FORMULA_OPTION, "x"),
    option("f", FREE, "x"),
)


def told(named, *others) -> list[Explanation]:
    """What is told of sets that are named, among these: each a tuple of options and its ln evidence."""
    trials = [
        SimpleNamespace(options=o, label=" + ".join(x.label for x in o), evidence=e) for o, e in (*named, *others)
    ]
    trials.sort(key=lambda t: -t.evidence)
    sets = SimpleNamespace(
        fits=SimpleNamespace(
            fitted={t.label: t for t in trials},
            left=lambda t: SimpleNamespace(surprise=9.0),
            flights=lambda t: 1.0,
            explanation=lambda t, p, left, flights: Explanation(t.options, (), 0.0, 0.0, p, left, flights),
        ),
        evidence=lambda t: t.evidence,
        likeliest=lambda: trials,
    )
    share = np.exp([e for _, e in named])
    known = [Explanation(o, (), 0.0, 0.0, p, 0.0, 1.0) for (o, _), p in zip(named, share / share.sum(), strict=True)]
    return among_all(sets, known)


def probabilities(named, *others) -> list[float]:
    return [x.probability for x in told(named, *others)]


def test_a_set_that_leaves_something_and_is_as_likely_takes_half():
    assert probabilities([((A, B), -10.0)], ((A, C), -10.0)) == pytest.approx([0.5])
    assert probabilities([((A, B), -10.0)], ((C,), -10.0 + np.log(3.0))) == pytest.approx([0.25])


def test_a_member_that_is_not_settled_is_told_after_the_set_without_it():
    simpler, first = told([((A, B), -10.0)], ((A,), -11.0), ((C,), -9.0))
    assert simpler.options == (A,) and first.options == (A, B)
    assert first.probability / simpler.probability == pytest.approx(np.exp(1.0))
    assert simpler.left == 9.0  # what it leaves is told


def test_a_member_whose_odds_are_over_three_to_one_is_told():
    assert [x.options for x in told([((A, B), -10.0)], ((A,), -10.0 - np.log(4.0)), ((), -10.0))] == [(A, B)]


def test_forms_of_one_law_are_weighed_together_before_a_set_without_a_member_is_told_first():
    forms = [((A, B, LAW_AT_X), -20.0), ((A, B, OTHER_LAW_AT_X), -10.0)]
    assert [len(x.options) for x in told(forms, ((A, FREE_AT_X), -18.0))] == [3, 3]


def test_a_set_that_holds_all_that_is_named_is_no_rival():
    assert probabilities([((A, B), -10.0)], ((A, B, C), -9.0), ((A, B, FREE_AT_X), -8.0)) == pytest.approx([1.0])


def test_rivals_that_are_told_keep_their_odds():
    p = probabilities([((A, B), 0.0), ((A, C), -1.0)], ((B, C), 0.0))
    assert p[1] / p[0] == pytest.approx(np.exp(-1.0)) and sum(p) == pytest.approx((1 + np.exp(-1)) / (2 + np.exp(-1)))


def test_unlisted_physics_at_one_place_is_one_thing_whatever_its_form():
    assert probabilities([((A, LAW_AT_X), 0.0)], ((A, OTHER_LAW_AT_X), 0.0), ((A, FREE_AT_X), 1.0)) == [1.0]
    assert probabilities([((A, B), 0.0)], ((A, FREE_AT_X), 0.0), ((A, LAW_AT_X), -1.0)) == pytest.approx([0.5])


def test_where_nothing_is_named_nothing_is_weighed():
    assert probabilities([]) == []
