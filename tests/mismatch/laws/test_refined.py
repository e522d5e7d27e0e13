"""What is said of a form before it is fitted in the simulator is what the fit says, and its shape is the fit's."""

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
from enginediag_cli.mismatch.laws.alike import places_alike
from enginediag_cli.mismatch.laws.carried import Carried, carried
from enginediag_cli.mismatch.laws.grammar import FORMS
from enginediag_cli.mismatch.laws.posterior import evidence_of
from enginediag_cli.mismatch.laws.refined import refined
from enginediag_cli.mismatch.laws.said import Said
from enginediag_cli.mismatch.laws.scan import Candidate, formulas, formulas_of, known_variables, scored
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

LISTED = ("reynolds_index", "power", "mach")
NARROW = "a * (exp(-((mach - 0.55) / 0.07) ** 2) - exp(-((0 - 0.55) / 0.07) ** 2))"
ABOVE = "a * (max(mach - 0.6, 0) * (power - 0.93))"


class Searched:
    """A law at the HPC's efficiency, concealed in flights, and a fit that carries the best law of one variable."""

    def __init__(self, formula: str, size: float, of: tuple[str, ...], carrying: str):
        engine = concealed.turbofan()
        every = formula_variables(engine.network)
        a = Coefficient("a", "1", "size", lower=-10.0, upper=10.0, sigma=0.05, typical=size)
        acts = LawPlace("hpc.efficiency", "hpc", "", True)
        law = Law("truth", acts, Expression.parse(formula), {n: every[n] for n in of}, (a,))
        truth = Effect(law, acts.site, {"a": size})
        self.given = concealed.evidence(concealed.flights((truth,), np.random.default_rng(1300), count=4, records=40))
        found = identify_with(self.given, NULL_HYPOTHESIS, nuisance(self.given))
        self.base = HypothesisFit((), found, Projection(found))
        self.known = [k for k in known_variables(found) if k.variable.name in LISTED]
        place = next(p for p in locations(found) if p.name == "hpc.efficiency")
        one = [k for k in self.known if k.variable.name == carrying]
        first = scored(found, self.base.projection, [place], list(formulas_of(one, self.known)), 0.0)[0]
        trial = self.fitted(first)
        self.at: Carried = carried(self.base, trial, trial.hypothesis.effects, place, self.known)

    def fitted(self, candidate: Candidate) -> HypothesisFit:
        """Inside the simulator."""
        option = proposal(candidate, self.given.engine).option
        return attempt([option], self.base.found, nuisance(self.given))

    def refined(self) -> list[Candidate]:
        return refined(Said(self.at), list(formulas(self.known)), self.known, 0.0)


@pytest.fixture(scope="module")
def narrow() -> Searched:
    return Searched(NARROW, 0.03, ("mach",), "reynolds_index")


def test_the_likeliest_form_and_its_shape_are_those_of_the_fit(narrow: Searched) -> None:
    best = narrow.refined()[0]
    assert best.formula.form.name == "bump" and [k.variable.name for k in best.formula.of] == ["mach"]
    assert best.formula.shape["c"] == pytest.approx(0.55, abs=0.02)
    assert best.formula.shape["w"] == pytest.approx(0.07, abs=0.02)
    trial = narrow.fitted(best)
    assert trial.converged
    assert evidence_of(narrow.base, trial, best.prior) == pytest.approx(best.weight, abs=3.0)


def test_a_narrow_curve_between_two_tries_is_missed_by_a_scan(narrow: Searched) -> None:
    tried = scored(narrow.base.found, narrow.base.projection, [narrow.at.place], list(formulas(narrow.known)), 0.0)
    bump = max(c.weight for c in tried if c.formula.form.name == "bump" and len(c.formula.of) == 1)
    assert narrow.refined()[0].weight > bump + 5.0


def test_a_threshold_times_another_variable_is_told_from_either_alone() -> None:
    searched = Searched(ABOVE, 5.0, ("mach", "power"), "mach")
    best = searched.refined()
    assert {k.variable.name for k in best[0].formula.of} == {"mach", "power"}
    alone = max(c.weight for c in best if len(c.formula.of) == 1)
    assert best[0].weight > alone + 3.0


def test_the_order_of_the_tries_changes_nothing(narrow: Searched) -> None:
    tries = list(formulas(narrow.known))
    forward, backward = (
        refined(Said(narrow.at), tries, narrow.known, 0.0),
        refined(Said(narrow.at), tries[::-1], narrow.known, 0.0),
    )
    for one, other in zip(forward[:5], backward[:5], strict=True):
        assert one.formula.form is other.formula.form
        assert one.weight == pytest.approx(other.weight, abs=1e-6)


def test_every_form_is_said_once_of_the_same_variables(narrow: Searched) -> None:
    said = narrow.refined()
    keys = [(c.formula.form.name, frozenset(k.variable.name for k in c.formula.of)) for c in said]
    assert len(keys) == len(set(keys))
    assert {name for name, _ in keys} <= {f.name for f in FORMS}
    assert all(np.isfinite(c.weight) for c in said)


def test_a_prior_of_the_place_is_added_as_it_is(narrow: Searched) -> None:
    tries = list(formulas(narrow.known))
    one, other = (
        refined(Said(narrow.at), tries, narrow.known, 0.0)[0],
        refined(Said(narrow.at), tries, narrow.known, -2.0)[0],
    )
    assert other.weight == pytest.approx(one.weight - 2.0)
    assert replace(other, weight=one.weight, prior=one.prior).formula.shape == one.formula.shape


def test_places_are_alike_that_say_the_same_and_no_others(narrow: Searched) -> None:
    found, f = narrow.base.found, narrow.at.f
    every = locations(found)
    said = {p.name for p in places_alike(narrow.base, narrow.at.place, f, every)}
    assert narrow.at.place.name not in said
    assert not any(p.component == "lpt" or p.name.startswith("sensor.") for p in every if p.name in said)
    # a law so small that nothing shows it is alike everywhere
    assert len(places_alike(narrow.base, narrow.at.place, 1e-4 * f, every)) == len(every) - 1
    # a larger one is told from more places
    larger = {p.name for p in places_alike(narrow.base, narrow.at.place, 10.0 * f, every)}
    assert larger <= said
