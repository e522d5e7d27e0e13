"""The law of a set is told along its own variables, weighed beside what the set holds besides."""

from __future__ import annotations

from copy import deepcopy

import concealed
import numpy as np
import pytest

from enginediag_cli.engine.term import Coefficient, Effect
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.fitted_sets import FittedSets
from enginediag_cli.mismatch.explain.law_members import LawMembers
from enginediag_cli.mismatch.explain.law_of_set import LawOfSet, OfSet
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION, Option, onset
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.remainder import remainder
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.mismatch.laws.scan import Scan, known_variables, scored
from enginediag_cli.mismatch.laws.search import LawSearch
from enginediag_cli.mismatch.laws.shortlist import Proposal, proposal
from enginediag_cli.mismatch.laws.summary import summary
from enginediag_cli.physics.law import Expression, Law, LawPlace, formula_variables

WAVE = "a * ((mach - 0.5) / 0.15) * exp(-((mach - 0.5) / 0.15) ** 2)"
STEP, SINCE, RECORDS = 0.004, 3, 40


@pytest.fixture(scope="module")
def sets() -> FittedSets:
    """Of flights with a wave over Mach number at the HPC's efficiency, and a T45 that reads 0.4 % more since one."""
    engine = concealed.turbofan()
    size = Coefficient("a", "1", "size", lower=-1.0, upper=1.0, sigma=0.05, typical=0.03)
    at = LawPlace("hpc.efficiency", "hpc", "", True)
    law = Law("truth", at, Expression.parse(WAVE), {"mach": formula_variables(engine.network)["mach"]}, (size,))
    flown = concealed.flights((Effect(law, at.site, {"a": 0.03}),), np.random.default_rng(31), count=6, records=RECORDS)
    recorded = [
        Flight(f.label, f.engine, {**f.columns, "T45_K": f.columns["T45_K"] * (1.0 + STEP * (k >= SINCE))})
        for k, f in enumerate(flown)
    ]
    search = Search(concealed.evidence(recorded), [])
    found = identify_with(search.evidence, NULL_HYPOTHESIS, search.along)
    search.look_from(HypothesisFit((), found, Projection(found)))
    search.weighed(remainder(search.base, search.library, search.along_drivers))
    return FittedSets(search)


@pytest.fixture(scope="module")
def members(sets: FittedSets) -> LawMembers:
    """The laws that these sets know."""
    return LawMembers(sets.fits.base.found, sets.prices)


def step_of(sets: FittedSets) -> Option:
    """The step of T45 that begins when it does."""
    own = (o for o in sets.fits.library if o.label.startswith("sensor.T45.scale"))
    return next(o for o in own if onset(o) == SINCE * RECORDS)


def law_at(sets: FittedSets, members: LawMembers, name: str, form: str, variables: list[str]) -> Proposal:
    """The best law of this form at a place."""
    base = sets.fits.base
    place = [w for w in members.where if w.name == name]
    own = [f for f in members.formulas if f.form.name == form and [k.variable.name for k in f.of] == variables]
    return proposal(scored(base.found, base.projection, place, own, 0.0)[0], base.found.evidence.engine)


def named(sets: FittedSets, members: LawMembers, form: str, variables: list[str], beside: str = ""):
    """A set of the step and of a law of this form, as it might have been named; with a fault `beside` them."""
    law = law_at(sets, members, "hpc.efficiency", form, variables)
    members.learn([law])
    further = [next(o for o in sets.fits.library if o.label.startswith(beside))] if beside else []
    (trial,) = sets.fits.refit([(step_of(sets), *further, law.option)]) or []
    return [sets.fits.explanation(trial, 1.0, 0.0, 1.0)]


@pytest.mark.slow
@pytest.mark.parametrize("idle", ["", "sensor.P3.scale"])
def test_a_law_that_joined_along_two_variables_is_told_along_its_own_one(
    sets: FittedSets, members: LawMembers, idle: str
) -> None:
    of_set = LawOfSet(sets, members).of(named(sets, members, "bump_by", ["mach", "power"], beside=idle))
    told, first = of_set.explanations, of_set.explanations[0]
    laws = [o for o in first.options if o.kind == FORMULA_OPTION]
    variables = {n for o in laws for e in o.hypothesis.effects for n in e.term.variables}
    assert variables == {"mach"} and any(o.label.startswith("sensor.T45.scale") for o in first.options)
    # what the law leaves nothing to do is not told beside it
    assert len(first.options) == len(laws) + 1
    assert sum(x.probability for x in told) == pytest.approx(1.0)
    step = next(c for c in first.coefficients if "T45" in c.name)
    assert abs(step.value - STEP) < 4.0 * step.standard_error
    law = of_set.finding
    assert law is not None and law.places[0][0].name == "hpc.efficiency" and law.band is not None
    assert any(v.name == "mach" for groups in law.along for group in groups for v in group)
    # what the other member explains is no part of what the law does
    assert law.excess < sets.fits.base.objective - sets.fits.base.projection.dof


@pytest.mark.slow
def test_the_law_of_each_rival_is_searched_and_what_holds_the_same_then_is_told_once(
    sets: FittedSets, members: LawMembers
) -> None:
    """The rival holds the same step and a fault besides, which its law leaves nothing to do once it is searched."""
    first = named(sets, members, "bump", ["mach"])
    law = next(o for o in first[0].options if o.kind == FORMULA_OPTION)
    beside = next(o for o in sets.fits.library if o.label.startswith("sensor.P3.scale"))
    (trial,) = sets.fits.refit([(deepcopy(step_of(sets)), beside, law)]) or []
    rival = sets.fits.explanation(trial, 0.1, 0.0, 1.0)
    told = LawOfSet(sets, members).of([rival, *first]).explanations
    assert all("P3" not in x.label for x in told) and len({x.label for x in told}) == len(told)
    assert sum(x.probability for x in told) == pytest.approx(1.1)


@pytest.mark.slow
def test_what_is_known_of_laws_at_two_places_has_a_place_where_only_these_were_fitted(
    sets: FittedSets, members: LawMembers
) -> None:
    both = tuple(law_at(sets, members, f"hpc.{q}", "optimum", ["mach"]) for q in ("efficiency", "flow_capacity"))
    search = LawSearch(sets.fits.base, Scan((), tuple(known_variables(sets.fits.base.found))), sets.fits.refit, (both,))
    assert search.single and not search.single[0].at_one_place and not search.double
    finding = summary(search, search.single[:1], sets.fits.base, True)
    assert finding.places[0][0].name.startswith("hpc.") and finding.together == pytest.approx(1.0)


def test_sets_without_a_law_stay_as_they_were_named(
    sets: FittedSets, members: LawMembers, monkeypatch: pytest.MonkeyPatch
) -> None:
    (trial,) = sets.fits.refit([(step_of(sets),)]) or []
    monkeypatch.setattr(sets.fits, "fitted", {trial.label: trial})  # no set with a law is near it
    alone = [sets.fits.explanation(trial, 1.0, 0.0, 1.0)]
    assert LawOfSet(sets, members).of(alone) == OfSet(tuple(alone))
