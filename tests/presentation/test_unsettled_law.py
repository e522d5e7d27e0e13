"""What a law varies with is told as settled only where one set of variables is likely enough."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.presentation.laws import law_statement

EFFECT = SimpleNamespace(term=SimpleNamespace(STATEMENT="Efficiency changes with Mach number.", EQUATION="eta (1 + f)"))


def found(*probabilities: float) -> LawFinding:
    drivers = tuple(((), p) for p in probabilities)
    return LawFinding((), (), drivers, 100.0, 1.0, (0.0, 0.0), "1", None)


@pytest.mark.parametrize(
    ("probabilities", "together"),
    [((0.97, 0.03), 1), ((0.36, 0.33, 0.28, 0.03), 3), ((0.9, 0.1), 2), ((1.0,), 1), ((0.5, 0.3), 2)],
)
def test_as_many_are_told_together_as_hold_the_truth(probabilities, together):
    assert len(found(*probabilities).along) == together


def test_the_likeliest_of_several_is_no_statement_of_its_own():
    settled, open_ = (next(law_statement(EFFECT, found(*p))) for p in ((0.97, 0.03), (0.36, 0.33, 0.31)))
    assert settled.strip() == EFFECT.term.STATEMENT
    assert "cannot tell apart" in open_ and open_.endswith(EFFECT.term.STATEMENT)
    assert next(law_statement(EFFECT, None)).strip() == EFFECT.term.STATEMENT
