"""Members that remember and act at one place have an order, one behind the other; laws have none."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.engine.recall import UNKNOWN_PAST
from enginediag_cli.mismatch.fit.attempt import _one_behind_the_other
from enginediag_cli.mismatch.fit.options import EFFECT, FORMULA_OPTION
from enginediag_cli.mismatch.laws.search import LawSearch


def option(kind: str, label: str, place: str = "burner", inputs=UNKNOWN_PAST) -> SimpleNamespace:
    term, site = SimpleNamespace(INPUTS=inputs), SimpleNamespace(targets=(place,))
    effect = SimpleNamespace(term=term, site=site, amplitudes=("a",))
    return SimpleNamespace(kind=kind, label=label, hypothesis=SimpleNamespace(effects=(effect,)))


@pytest.mark.parametrize(
    ("kinds", "places", "ordered"),
    [
        ((EFFECT, EFFECT), ("burner", "burner"), True),
        ((EFFECT, EFFECT), ("burner", "shaft"), False),
        ((FORMULA_OPTION, FORMULA_OPTION), ("burner", "burner"), False),
        ((EFFECT, FORMULA_OPTION), ("burner", "burner"), False),
    ],
)
def test_only_effects_at_one_place_work_on_what_the_other_makes(kinds, places, ordered):
    two = [option(k, f"{k}{n}", p) for n, (k, p) in enumerate(zip(kinds, places, strict=True))]
    assert _one_behind_the_other(two) == ordered


def test_a_fit_that_turned_the_order_of_its_members_is_still_that_of_its_laws(monkeypatch):
    a, b, law = option(EFFECT, "a"), option(EFFECT, "b"), option(FORMULA_OPTION, "l")
    monkeypatch.setattr(
        "enginediag_cli.mismatch.laws.search.Fitted.to",
        lambda base, laws, trial: SimpleNamespace(laws=laws, standing=0.0),
    )
    search = SimpleNamespace(
        base=SimpleNamespace(options=(a, b)),
        fit=lambda sets: [SimpleNamespace(options=options[::-1]) for options in sets],
    )
    proposal = SimpleNamespace(option=law)
    (found,) = LawSearch._fitted(search, [(proposal,)])
    assert found.laws == (proposal,)
