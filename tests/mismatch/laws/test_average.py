"""Where no form of a law is settled its average over the likely ones is one law, which engine files carry."""

from __future__ import annotations

import warnings
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
from enginediag_cli.mismatch.laws.at_place import said_at
from enginediag_cli.mismatch.laws.average import Averaged, Sought, average_of, smooth_member
from enginediag_cli.mismatch.laws.band import summed
from enginediag_cli.mismatch.laws.carried import Carried
from enginediag_cli.mismatch.laws.fitted import LIKELIER, Fitted
from enginediag_cli.mismatch.laws.mean import NEAR, Along, Member, mean_of
from enginediag_cli.mismatch.laws.refined import refined
from enginediag_cli.mismatch.laws.said import Said, Says
from enginediag_cli.mismatch.laws.scan import Candidate, KnownVariable, Scan, formulas_of, known_variables
from enginediag_cli.mismatch.laws.shortlist import proposal
from enginediag_cli.physics.engine_file import law_entry
from enginediag_cli.physics.law import LONGEST, Expression, Law, LawPlace, formula_variables
from enginediag_cli.validation.formula_marks import build_formulas

SWING = "a * (mach - 0.55) / 0.15 * exp(-((mach - 0.55) / 0.15) ** 2)"
FORMS = ("step", "optimum", "bump")
UNLIKELY = -1000.0
"""ln of the prior of a place at which smooth curves have no say."""


def average_from(
    first: Fitted, fitted: list[Fitted], sought: list[Candidate], says: Says, prior: float
) -> Averaged | None:
    """Of the first one's variables alone."""
    engine = first.trial.found.evidence.engine
    along = Sought(fitted, sought, {}).along(first.where, says.known, {first.where: first.evidence}, engine)
    return average_of(first, along, says, prior)


class Ground:
    """A wave over Mach number at the HPC's efficiency; three other forms that were fitted to it, another that was
    only sought, and what the place says."""

    def __init__(self) -> None:
        engine = concealed.turbofan()
        mach = formula_variables(engine.network)["mach"]
        size = Coefficient("a", "1", "size", lower=-1.0, upper=1.0, sigma=0.05, typical=0.02)
        law = Law(
            "truth", LawPlace("hpc.efficiency", "hpc", "", True), Expression.parse(SWING), {"mach": mach}, (size,)
        )
        truth = Effect(law, law.acts.site, {"a": 0.02})
        given = concealed.evidence(concealed.flights((truth,), np.random.default_rng(1320), count=4, records=40))
        found = identify_with(given, NULL_HYPOTHESIS, nuisance(given))
        self.engine, self.base = given.engine, HypothesisFit((), found, Projection(found))
        self.known: list[KnownVariable] = [k for k in known_variables(found) if k.variable.name in ("mach", "power")]
        place = next(p for p in locations(found) if p.name == "hpc.efficiency")
        own = [k for k in self.known if k.variable.name == "mach"]
        self.said = Said(
            Carried(found, self.base.projection, place, np.zeros(len(found.number)), 0.0, tuple(self.known))
        )
        sought = refined(self.said, list(formulas_of(own, self.known)), own, 0.0)
        best = {c.formula.form.name: c for c in sought}
        self.fitted = [replace(self._fitted(best[name]), evidence=20.0) for name in FORMS]
        self.sought: list[Candidate] = [replace(best["valley"], weight=20.0)]

    def _fitted(self, candidate: Candidate) -> Fitted:
        law = proposal(candidate, self.engine)
        trial = attempt([law.option], self.base.found, nuisance(self.base.found.evidence))
        return Fitted.to(self.base, (law,), trial)

    def average(self, *evidence: float) -> Averaged | None:
        """With this ln evidence of the three."""
        fitted = [replace(f, evidence=e) for f, e in zip(self.fitted, evidence, strict=True)]
        return average_from(fitted[0], fitted, self.sought, self.said.kept, UNLIKELY)


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground()


def test_a_curve_that_is_too_large_to_square_is_none_without_a_warning(ground: Ground) -> None:
    huge = np.linspace(1.0, 1e200, len(ground.base.found.number))[:, None, None]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        G, _, _ = ground.said.of(huge)
    assert not np.isfinite(G).all()


def curve_of(averaged: Averaged, known: list[KnownVariable]) -> np.ndarray:
    (effect,) = averaged.law.option.hypothesis.effects
    size = {effect.parameter_name("a"): averaged.law.candidate.amplitude}
    return summed([effect], known, size)


def test_the_average_is_that_of_all_forms_by_their_probabilities(ground: Ground) -> None:
    averaged = ground.average(20.0, 20.0, 19.0)
    assert averaged is not None
    curves = [
        summed(f.effects, ground.known, {n: v for n, (v, _) in f.trial.coefficients.items()}) for f in ground.fitted
    ]
    curves += [c.amplitude * c.formula.curve for c in ground.sought]
    odds = np.exp([0.0, 0.0, -1.0, 0.0])
    p = np.sqrt(odds)  # evidence tells approximations apart more surely than they are right
    mean = p @ np.array(curves) / p.sum()
    assert ground.said.any.apart(curve_of(averaged, ground.known), mean) < NEAR
    assert [x.probability for x in averaged.forms] == pytest.approx(sorted(p / p.sum(), reverse=True))
    assert averaged.evidence == pytest.approx(20.0 + np.log(odds.sum()))


def test_all_smooth_curves_of_a_variable_are_one_of_its_members(ground: Ground) -> None:
    """As likely as laws without a listed form are: the rest of the probability is that of the forms."""
    mach = [k for k in ground.known if k.variable.name == "mach"]
    fitted = [replace(f, evidence=20.0) for f in ground.fitted]
    smooth = smooth_member(ground.said.kept, mach, len({k.group for k in ground.known}), 0.0)
    for ahead in (-20.0, 0.0, 2.0):
        prior = 20.0 + ahead - smooth.evidence
        averaged = average_from(fitted[0], fitted, ground.sought, ground.said.kept, prior)
        assert averaged is not None
        its = sum(x.probability for x in averaged.forms if x.words == smooth.words)
        assert its == pytest.approx(1.0 / (1.0 + 4.0 * np.exp(-0.5 * ahead)), abs=1e-4)


def test_an_engine_file_carries_it_and_it_is_nothing_at_the_design_point(ground: Ground) -> None:
    averaged = ground.average(20.0, 20.0, 20.0)
    assert averaged is not None
    (effect,) = averaged.law.option.hypothesis.effects
    values = {"a": averaged.law.candidate.amplitude}
    built = build_formulas(ground.engine, [law_entry(effect.replace_values({effect.parameter_name("a"): values["a"]}))])
    assert built is not None and len(built) == 1
    at_design = {n: np.array([v.reference]) for n, v in effect.term.variables.items()}
    there = np.asarray(effect.term.expression.evaluate({**at_design, **values}), float)
    assert np.abs(there).max() < 1e-9 * np.ptp(curve_of(averaged, ground.known))


def test_a_form_that_has_most_of_it_is_told_as_it_stands(ground: Ground) -> None:
    assert ground.average(28.0, 20.0, 20.0) is None


def test_a_form_that_these_flights_do_not_tell_from_the_average_is_told_as_it_stands(ground: Ground) -> None:
    first = ground.fitted[0]
    c = {n: v for n, (v, _) in first.trial.coefficients.items()}
    curve = summed(first.effects, ground.known, c)
    twin = replace(ground.sought[0], amplitude=1.0, formula=replace(ground.sought[0].formula, curve=curve))
    assert average_from(first, [first], [twin], ground.said.kept, UNLIKELY) is None
    smaller = replace(twin, formula=replace(twin.formula, curve=0.2 * curve))
    assert average_from(first, [first], [smaller], ground.said.kept, UNLIKELY) is None  # a fit finds its size again
    other = replace(twin, formula=replace(twin.formula, curve=np.abs(curve - np.mean(curve))))
    assert average_from(first, [first], [other], ground.said.kept, UNLIKELY) is not None


def test_its_prior_says_that_it_is_as_likely_as_all_its_forms_together(ground: Ground) -> None:
    averaged = ground.average(20.0, 20.0, 20.0)
    assert averaged is not None
    trial = attempt([averaged.law.option], ground.base.found, nuisance(ground.base.found.evidence))
    assert trial.converged
    fitted = averaged.fitted(Fitted.to(ground.base, (averaged.law,), trial), 0.0)
    again = Fitted.to(ground.base, fitted.laws, trial)
    assert fitted.forms == averaged.forms and again.evidence == pytest.approx(averaged.evidence)
    # χ² is convex in the curve
    assert trial.objective < max(f.trial.objective for f in ground.fitted) + 1.0


def test_weighed_at_a_fit_that_carries_it_an_average_follows_a_large_law_better(ground: Ground) -> None:
    """The derivatives of an engine that lacks a part of a large law are not those of one that has it."""
    scan, left, last = Scan((), tuple(ground.known)), [], ground.fitted[1]
    for _ in range(2):
        said = said_at(ground.base, last, scan)
        assert said is not None
        # smooth curves outweigh all forms
        averaged = average_from(last, ground.fitted, [], said.kept, 1000.0)
        assert averaged is not None and len(averaged.forms) == 1
        trial = attempt([averaged.law.option], ground.base.found, nuisance(ground.base.found.evidence))
        left.append(trial.objective)
        last = averaged.fitted(Fitted.to(ground.base, (averaged.law,), trial), 0.0)
    assert left[1] < left[0] < min(f.trial.objective for f in ground.fitted)


def test_a_sum_that_predicts_worse_than_with_a_further_form_is_no_part_beside_it(ground: Ground) -> None:
    """A further form that only prediction asks for leaves a law as likely as it was, by definition: not as a rival."""
    first, second = ground.fitted[:2]
    mach = [k for k in ground.known if k.variable.name == "mach"]
    trial = attempt([*first.options, *second.options], ground.base.found, nuisance(ground.base.found.evidence))
    both = Fitted((*first.laws, *second.laws), trial, first.evidence + LIKELIER)
    for more, count in ((both, 1), (replace(both, evidence=first.evidence + 1.0), 2)):
        members = Sought([more, first], [], {}).members("hpc.efficiency", mach, ground.known, ground.engine)
        assert len(members) == count and members[0].words == tuple(p.candidate.formula.form.words for p in both.laws)


def member(curve: np.ndarray, evidence: float, text: str = "1") -> Member:
    return Member(("by",), text, curve, evidence)


def test_laws_of_other_variables_are_parts_by_the_probability_of_these(ground: Ground) -> None:
    """Three to one for Mach number, whatever the forms."""
    mach, power = (next(k for k in ground.known if k.variable.name == n) for n in ("mach", "power"))
    one, other = 0.3 * (mach.values - 0.55), 0.1 * (power.values - 0.8)
    along = [
        Along((mach,), np.log(3.0), (member(one, 5.0),)),
        Along((power,), 0.0, (member(other, 40.0), member(0.9 * other, 40.0))),
    ]
    mean = mean_of(along, one, ground.said.any)
    assert mean is not None
    assert ground.said.any.apart(mean.curve, 0.75 * one + 0.25 * 0.95 * other) < NEAR
    assert [x.probability for x in mean.of] == pytest.approx([0.75, 0.125, 0.125])


def test_an_average_is_written_with_the_fewest_of_its_laws(ground: Ground) -> None:
    """Ten that are one curve, and one that is another."""
    (mach,) = (k for k in ground.known if k.variable.name == "mach")
    one, other = 0.3 * (mach.values - 0.55), 0.3 * (mach.values - 0.55) ** 2
    ten = tuple(member(one * (1.0 + 1e-6 * k), 10.0) for k in range(10))
    mean = mean_of([Along((mach,), 0.0, (*ten, member(other, 10.0)))], other, ground.said.any)
    assert mean is not None and len(mean.of) == 11 and len(mean.written) == 2
    assert ground.said.any.apart(mean.curve, (10.0 * one + other) / 11.0) < NEAR


def test_where_formulas_have_no_room_the_average_is_what_comes_nearest_or_none(ground: Ground) -> None:
    (mach,) = (k for k in ground.known if k.variable.name == "mach")
    one, other, third = (0.3 * (mach.values - 0.55) ** n for n in (1, 2, 3))
    long = "1" * (LONGEST + 1)
    parts = (member(one, 10.0), member(other, 10.0, long), member(third, 10.0))
    mean = mean_of([Along((mach,), 0.0, parts)], one, ground.said.any)
    assert mean is not None and all(x.member.text != long for x in mean.written)
    assert mean_of([Along((mach,), 0.0, (member(one, 10.0), member(other, 10.0, long)))], one, ground.said.any) is None
