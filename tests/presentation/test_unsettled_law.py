"""What a law varies with is settled only where one set of variables is likely enough; a reader can follow it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.laws.finding import LawFinding
from enginediag_cli.physics.laws.expression import Expression
from enginediag_cli.physics.laws.law import Acts, Law
from enginediag_cli.presentation.laws import equation, law_statement, of_many

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


def _law(count: int) -> Effect:
    """A formula of so many coefficients at the HPC's efficiency."""
    sizes = tuple(Coefficient(f"a{k}", "1", "size", 0.0, -1.0, 1.0, 0.1, 0.0) for k in range(count))
    acts = Acts("hpc.efficiency", "hpc", "", True)
    text = Expression.parsed(" + ".join(f"a{k}" for k in range(count)))
    return Effect(Law("truth", acts, text, {}, sizes, "Efficiency changes."), acts.site, {})


def test_a_formula_of_many_coefficients_is_not_written_out():
    few, many = _law(5), _law(6)
    assert not of_many(few.term) and list(law_statement(few, None))[1].endswith("f = a0 + a1 + a2 + a3 + a4")
    assert of_many(many.term) and "a0" not in list(law_statement(many, None))[1]
    assert "6 coefficients" in equation(many.term) and "hpc.efficiency (1 + f)" in equation(many.term)
