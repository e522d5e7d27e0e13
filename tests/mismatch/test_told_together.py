"""What cannot be told from a set with a law is told with it, whichever is likelier by a hair."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.judging import ALIAS
from enginediag_cli.mismatch.explain.mixed import Mixed
from enginediag_cli.mismatch.explain.rejected import Reason, Rejected
from enginediag_cli.mismatch.fit.remainder import Gates


def explained(name: str) -> Explanation:
    option = SimpleNamespace(label=name)
    return Explanation((option,), (), 0.0, 0.0, 0.5, 0.0, 1.0)


LISTED, WITH_LAW = explained("listed"), explained("with a law")

SEARCH = SimpleNamespace(sets=None, deciding=SimpleNamespace(leaves_to_a_curve=lambda label: True))
"""Of sets, that finds a curve which leaves less."""


class Asked(Search):
    """A search that names one set of what is listed, and finds this with laws."""

    def __init__(self, listed: float, mixed: Mixed):
        self.few = SimpleNamespace(are_all=False)
        self.listed, self.mixed = listed, mixed

    def _mixed(self, sets, tried):
        return self.mixed

    def _gained(self, sets, x):
        return self.listed


@pytest.mark.parametrize(
    ("behind", "named", "told"),
    [
        (20.0, ["listed"], []),
        (0.5 * ALIAS - 0.1, ["listed", "with a law"], []),
        (-0.5 * ALIAS + 0.1, [], ["with a law", "listed"]),
        (-20.0, [], ["with a law"]),
    ],
)
def test_sets_with_and_without_a_law_are_told_together_where_they_are_as_likely(behind, named, told):
    search = Asked(100.0, Mixed((WITH_LAW,), 100.0 - behind, None))
    found, mixed = search._or_with_laws(SEARCH, [LISTED], ())
    assert [x.label for x in found] == named
    assert [x.label for x in mixed.explanations] == told


def test_what_is_listed_stays_where_laws_explain_nothing():
    search = Asked(100.0, Mixed())
    assert search._or_with_laws(SEARCH, [LISTED], ()) == ([LISTED], Mixed())


def alone(name: str, weighed: float) -> SimpleNamespace:
    return SimpleNamespace(label=name, weighed=weighed, projection=SimpleNamespace(rest=lambda: None))


@pytest.mark.parametrize(
    ("left", "behind", "sought"),
    [
        (30.0, 4.0, True),  # 20 over the gate, 2 behind
        (30.0, -4.0, True),
        (30.0, 41.0, False),
        (90.0, 60.0, False),  # too far
        (9.0, 4.0, False),  # under the gate of its kind
    ],
)
@pytest.mark.parametrize("reason", [Reason.LEAVES_MISFIT, Reason.WORSE])
def test_a_rival_that_leaves_more_than_it_is_behind_may_lack_something_beside_it(left, behind, sought, reason):
    search = Search.__new__(Search)
    search.adequate = Gates(9.0, 10.0, 10.0)
    search.rejected = {"rival": Rejected(reason, left), "bound": Rejected(Reason.AT_BOUND)}
    search.left = lambda trial: SimpleNamespace(surprise=left)
    named = alone("named", 100.0)
    assert search._lacks_another(alone("rival", 100.0 + behind), named) is sought
    assert not search._lacks_another(named, named) and not search._lacks_another(alone("bound", 100.0), named)


@pytest.mark.parametrize(
    ("of_sets", "told"),
    [
        (20.0, ["set"]),
        (0.5 * ALIAS - 0.1, ["set", "single"]),
        (-0.5 * ALIAS + 0.1, ["single", "set"]),
        (-20.0, ["single"]),
    ],
)
def test_a_single_option_is_named_unless_sets_that_hold_its_rival_are_likelier(of_sets, told):
    class Single(Asked):
        def _of_sets(self, rest, singles, least):
            return SEARCH, [explained("set")]

        def _gained(self, sets, x):
            return of_sets if x.label == "set" else 0.0

        def _lacks_another(self, trial, than):
            return trial.label == "rival"

    search = Single(0.0, Mixed())
    search.fitted = {"single": alone("single", 100.0)}
    single = explained("single")
    assert [x.label for x in search._or_sets(None, [alone("rival", 101.0)], [single])] == told
    assert search._or_sets(None, [alone("other", 101.0)], [single]) == [single]
