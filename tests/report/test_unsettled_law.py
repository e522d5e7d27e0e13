"""What a law varies with is settled only where one set of variables is likely enough; a reader can follow it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.laws.finding import LawFinding, Share
from enginediag_cli.physics.law import Expression, Law, LawPlace
from enginediag_cli.report.tables.formulas import LONG, equation, is_long, law_sentences, law_statement

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
    assert "do not separate" in open_ and open_.endswith(EFFECT.term.STATEMENT)
    assert next(law_statement(EFFECT, None)).strip() == EFFECT.term.STATEMENT


def _law(count: int) -> Effect:
    """A formula of so many coefficients at the HPC's efficiency."""
    sizes = tuple(
        Coefficient(f"a{k}", "1", "size", lower=-1.0, upper=1.0, sigma=0.1, typical=0.0) for k in range(count)
    )
    acts = LawPlace("hpc.efficiency", "hpc", "", True)
    text = Expression.parse(" + ".join(f"a{k}" for k in range(count)))
    return Effect(Law("truth", acts, text, {}, sizes, "Efficiency changes."), acts.site, {})


def test_a_formula_of_many_coefficients_is_not_written_out():
    few, many = _law(5), _law(6)
    assert not is_long(few.term) and list(law_statement(few, None))[1].endswith("f = a0 + a1 + a2 + a3 + a4")
    assert is_long(many.term) and "a0" not in list(law_statement(many, None))[1]
    assert "6 coefficients" in equation(many.term) and "hpc.efficiency (1 + f)" in equation(many.term)


MACH, N1 = SimpleNamespace(name="mach", words="Mach number"), SimpleNamespace(name="N1", words="N1")


def averaged(*forms: Share) -> LawFinding:
    place = SimpleNamespace(name="hpc.efficiency", words="HPC efficiency", component="hpc")
    law = SimpleNamespace(location=place, option=SimpleNamespace(hypothesis=SimpleNamespace(effects=(_law(1),))))
    return LawFinding((law,), ((place, 1.0),), ((((MACH,),), 1.0),), 100.0, 1.0, (-0.01, 0.01), "1", None, (), forms)


def test_of_an_average_the_forms_are_told_and_the_likeliest_formula():
    step = Share(("as a smooth step in",), "0.01 * tanh(mach)", 0.55, (MACH,), True)
    both = Share(("in proportion to", "near one value of"), "0.02 * mach", 0.24, (MACH,), True)
    other = Share(("in proportion to",), "0.02 * N1", 0.20, (N1,), False)
    told = "\n".join(law_sentences(averaged(step, both, other, Share(("by",), "1", 0.01, (MACH,), False))))
    assert (
        "the average of 4: as a smooth step in it (0.55), in proportion to it and near one value of it (0.24) or "
        "in proportion to N1 (0.20), of which 2 stand for all." in told
    )
    assert "The likeliest alone: f = 0.01 * tanh(mach)." in told
    long = Share(step.words, "0" * (LONG + 1), 1.0, (MACH,), True)
    assert "likeliest alone" not in "\n".join(law_sentences(averaged(long)))
    assert "average" not in "\n".join(law_sentences(averaged()))


def test_a_formula_that_is_long_is_not_written_out():
    acts = LawPlace("hpc.efficiency", "hpc", "", True)
    size = Coefficient("a", "1", "size", lower=-1.0, upper=1.0, sigma=0.1, typical=0.0)
    text = "a * (" + " + ".join(["0.123456"] * (LONG // 10)) + ")"
    law = Law("long", acts, Expression.parse(text), {}, (size,), "Efficiency changes.")
    assert is_long(law) and "long formula" in equation(law) and "0.123456" not in equation(law)
