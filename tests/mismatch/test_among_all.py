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
from enginediag_cli.mismatch.fit.options import EFFECT, FREE, LAW, Option


def option(name: str, kind: str = EFFECT, at: str = "") -> Option:
    moved = (Discrepancy(at, name, 1.0),) if at else ()
    return Option(kind, name, "", CONSTANT, Hypothesis((), moved))


A, B, C = map(option, "abc")
LAW_AT_X, OTHER_LAW_AT_X, FREE_AT_X = option("l", LAW, "x"), option("m", LAW, "x"), option("f", FREE, "x")


def probabilities(named, *others) -> list[float]:
    """Of sets that are named, among these: each a tuple of options and its ln evidence."""
    trials = [
        SimpleNamespace(options=o, label=" + ".join(x.label for x in o), evidence=e) for o, e in (*named, *others)
    ]
    trials.sort(key=lambda t: -t.evidence)
    sets = SimpleNamespace(
        fits=SimpleNamespace(fitted={t.label: t for t in trials}),
        evidence=lambda t: t.evidence,
        likeliest=lambda: trials,
    )
    share = np.exp([e for _, e in named])
    told = [Explanation(o, (), 0.0, 0.0, p, 0.0, 1.0) for (o, _), p in zip(named, share / share.sum(), strict=True)]
    return [x.probability for x in among_all(sets, told)]


def test_a_set_that_leaves_something_and_is_as_likely_takes_half():
    assert probabilities([((A, B), -10.0)], ((A, C), -10.0)) == pytest.approx([0.5])
    assert probabilities([((A, B), -10.0)], ((A,), -10.0 + np.log(3.0))) == pytest.approx([0.25])


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
