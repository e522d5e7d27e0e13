"""Variables of a law are told by smooth curves of all kinds, also where no listed form is the law's."""

from __future__ import annotations

from dataclasses import replace

import concealed
import numpy as np
import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.freeform import locations
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.carried import carried
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import KnownVariable, formulas_of, known_variables, prior_of_a_place, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.mismatch.laws.smooth import Smooth, prior_of_variables, smooth_evidence
from enginediag_cli.mismatch.laws.steps import bends_of
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

LISTED = ("reynolds_index", "power", "mach")


def _searched(formula: str, size: float, of: tuple[str, ...], carrying: str) -> list[Smooth]:
    """What smooth curves say of a law."""
    said, known, prior = _said(formula, size, of, carrying)
    return smooth_evidence(said, known, prior)


def _said(
    formula: str, size: float, of: tuple[str, ...], carrying: str, seed: int = 1300
) -> tuple[Said, list[KnownVariable], float]:
    """Of a law at the HPC's efficiency, at a fit that carries the best law of one variable."""
    engine = concealed.turbofan()
    acts = LawPlace("hpc.efficiency", "hpc", "", True)
    a = Coefficient("a", "1", "size", lower=-1.0, upper=1.0, sigma=0.05, typical=size)
    every = formula_variables(engine.network)
    law = Law("truth", acts, Expression.parse(formula), {n: every[n] for n in of}, (a,))
    given = concealed.evidence(
        concealed.flights((Effect(law, acts.site, {"a": size}),), np.random.default_rng(seed), count=4, records=40)
    )
    found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
    base = HypothesisFit((), found, Projection(found))
    known = [k for k in known_variables(found) if k.variable.name in LISTED]
    place = next(p for p in locations(found) if p.name == "hpc.efficiency")
    one = [k for k in known if k.variable.name == carrying]
    first = proposal(scored(found, base.projection, [place], list(formulas_of(one, known)), 0.0)[0], given.engine)
    trial = attempt([first.option], found, nuisance(given))
    at = carried(base, trial, trial.hypothesis.effects, place, known)
    assert at.found.converged and at.gain == pytest.approx(0.5 * (base.objective - trial.objective), abs=2.0)
    return Said(at), known, prior_of_a_place(found)


def test_a_curve_that_no_form_has_is_of_its_own_variable() -> None:
    sine = "a * ((mach - 0.5) / 0.2) * exp(-((mach - 0.5) / 0.2) ** 2)"
    said = _searched(f"{sine} - a * ((0 - 0.5) / 0.2) * exp(-((0 - 0.5) / 0.2) ** 2)", 0.03, ("mach",), "power")
    assert said[0].names == {"mach"}
    other = next(s for s in said if s.names == {"power"})
    assert said[0].evidence > other.evidence + 20.0


def test_a_product_is_told_from_either_variable_alone() -> None:
    said = _searched("a * (power - 1) * (mach - 0)", 0.25, ("power", "mach"), "power")
    assert said[0].names == {"power", "mach"}
    single = max(s.evidence for s in said if len(s.of) == 1)
    assert said[0].evidence > single + 5.0


def test_a_sum_of_a_valley_of_each_of_two_is_likelier_as_that_than_as_any_surface() -> None:
    def valley(x: str, c: float, w: float) -> str:
        return f"(({x} - {c}) / {w}) ** 4 / (1 + (({x} - {c}) / {w}) ** 4)"

    both = [("mach", 0.5, 0.15), ("power", 0.75, 0.1)]
    at_design = " - ".join(valley("0" if x == "mach" else "1", c, w) for x, c, w in both)
    formula = f"a * ({' + '.join(valley(*own) for own in both)} - {at_design})"
    said, known, prior = _said(formula, 0.03, ("mach", "power"), "power")
    smooth = smooth_evidence(said, known, prior)
    of = [k for k in known if k.variable.name in ("mach", "power")]
    whole = bends_of(said.kept, of).evidence + prior_of_variables(of, len({k.group for k in known})) + prior
    assert whole > max(s.evidence for s in smooth) + 3.0


def test_a_law_of_one_variable_is_not_told_of_two() -> None:
    said = _searched("a * (mach - 0)", 0.03, ("mach",), "mach")
    assert said[0].names == {"mach"}


def test_what_the_variables_are_called_in_what_order_changes_nothing() -> None:
    found = _searched("a * (mach - 0)", 0.03, ("mach",), "mach")
    again = _searched("a * (mach - 0)", 0.03, ("mach",), "mach")
    assert [replace(s, of=()) for s in found] == [replace(s, of=()) for s in again]
