"""What cannot be told from a set with a law is told with it, whichever is likelier by a hair."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.mismatch.explain.answer import Explanation
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.judging import ALIAS
from enginediag_cli.mismatch.explain.mixed import Mixed


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
