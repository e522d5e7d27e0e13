"""Several causes at once: sets of mixed kinds, one currency for them, and what is named in part."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from concealed import carried, evidence, flights, turbofan

from enginediag_cli.drivers import AMBIENT_PRESSURE
from enginediag_cli.mismatch.explain.answer import FORMULA, IDENTIFIED
from enginediag_cli.mismatch.explain.currency import Prices, narrowed, scales_of
from enginediag_cli.mismatch.explain.explain import Search
from enginediag_cli.mismatch.explain.free_members import Unlisted, free_option
from enginediag_cli.mismatch.explain.in_part import in_part
from enginediag_cli.mismatch.explain.members import identity
from enginediag_cli.mismatch.explain.promised import promising
from enginediag_cli.mismatch.explain.stepwise import Stepwise
from enginediag_cli.mismatch.fit.attempt import attempt
from enginediag_cli.mismatch.fit.evidence import Flight
from enginediag_cli.mismatch.fit.identified import NULL_HYPOTHESIS, identify_with, nuisance
from enginediag_cli.mismatch.fit.needed import is_needed, not_needed
from enginediag_cli.mismatch.fit.options import FORMULA_OPTION as OF_A_LAW
from enginediag_cli.mismatch.fit.options import effect_option, fault_options, onset, option_scores
from enginediag_cli.mismatch.fit.projection import Projection
from enginediag_cli.mismatch.fit.trial import HypothesisFit
from enginediag_cli.physics.registry import candidate_effects
from enginediag_cli.report.tables.explanation_text import residual_share_words, rest_sentences

REYNOLDS = ("reynolds_efficiency", "hpc", {"exponent": 0.1})
LOAD = ("power_offtake", "hp", {"fraction": 0.006})
CLEARANCE = ("active_clearance_control", "hpt", {"closing": 0.6})
OTHERS = {"reynolds_efficiency", "power_offtake", "handling_bleed", "guide_vanes", "turbine_tip_clearance"}


def stepped(recorded, column, share, since):
    """The flights with a sensor that reads wrong by a share from a flight on."""
    return [
        Flight(f.label, f.engine, {**f.columns, column: f.columns[column] * (1.0 + share * (k >= since))})
        for k, f in enumerate(recorded)
    ]


def library(*without):
    return [e for e in candidate_effects(turbofan()) if e.term.NAME in OTHERS | {CLEARANCE[0]} - set(without)]


@cache
def three_causes(backwards=False):
    recorded = stepped(flights(carried(REYNOLDS, LOAD), np.random.default_rng(21)), "T45_K", 0.004, 3)
    effects = library()
    return Search(evidence(recorded), effects[::-1] if backwards else effects).run()


def names(explanation):
    return {identity(o) for o in explanation.options}


@pytest.mark.slow
def test_two_effects_of_different_drivers_and_a_sensor_that_steps_are_all_named():
    a = three_causes()
    assert a.status == IDENTIFIED and not a.in_part and a.unexplained == pytest.approx(0.0, abs=0.05)
    assert names(a.explanations[0]) == {
        ("reynolds_efficiency@hpc",),
        ("power_offtake@hp",),
        ("sensor.T45.scale",),
    }


@pytest.mark.slow
def test_the_order_of_the_library_does_not_matter():
    one, other = three_causes(), three_causes(backwards=True)
    assert names(one.explanations[0]) == names(other.explanations[0])
    assert one.explanations[0].objective == pytest.approx(other.explanations[0].objective, abs=0.1)


@pytest.mark.slow
def test_coefficients_of_three_causes_are_within_their_intervals():
    truth = {"reynolds_efficiency.hpc.exponent": 0.1, "power_offtake.hp.fraction": 0.006}
    found = {c.name: c for c in three_causes().explanations[0].coefficients}
    for name, value in truth.items():
        assert abs(found[name].value - value) < 3.0 * found[name].standard_error


@pytest.fixture(scope="module")
def base():
    e = evidence(flights(carried(REYNOLDS), np.random.default_rng(22)))
    found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
    return HypothesisFit((), found, Projection(found))


def option(name):
    return next(effect_option(e) for e in candidate_effects(turbofan()) if e.label == name)


def test_the_evidence_of_one_more_member_is_what_its_columns_promise(base):
    prices = Prices([effect_option(e) for e in library()])
    member = option("power_offtake@hp")
    (scored,) = option_scores(base.found, base.projection, [member])
    trial = attempt([member], base.found, nuisance(base.found.evidence))
    gained = prices.evidence(trial) - prices.evidence(base)
    promised = prices.promise(scored, scales_of(member), prices.of(member))
    # a load is nearly linear
    assert gained == pytest.approx(promised, abs=0.05 * abs(promised) + 0.5)


def test_narrowing_is_half_the_logarithm_of_the_information_in_prior_units(base):
    R = base.projection.R
    assert not base.projection.offsets or all(len(own.R) == 0 for own in base.projection.offsets.values())
    assert narrowed(base.projection) == pytest.approx(0.5 * np.linalg.slogdet(R.T @ R)[1])


def test_a_member_costs_the_logarithm_of_how_many_there_are_of_its_kind():
    options = [effect_option(e) for e in library()]
    labels = {o.label for o in options}
    assert Prices(options).of(options[0]) == pytest.approx(np.log(len(labels) / 0.5))


def test_a_member_that_is_not_there_is_not_needed(base):
    both = [option("reynolds_efficiency@hpc"), option("handling_bleed@booster")]
    trial = attempt(both, base.found, nuisance(base.found.evidence))
    assert not_needed(trial, 8.0) == "handling_bleed@booster"
    assert is_needed(trial, both[0], 8.0) and not is_needed(trial, both[1], 8.0)


def test_a_step_between_the_onsets_that_are_scored_promises_what_its_fit_gains():
    recorded = list(flights((), np.random.default_rng(25)))
    at, columns = 23, dict(recorded[2].columns)
    columns["T45_K"] = columns["T45_K"] * (1.0 + 0.004 * (np.arange(60) >= at))
    recorded[2] = replace(recorded[2], columns=columns)
    recorded[3:] = stepped(recorded[3:], "T45_K", 0.004, 0)
    e = evidence(recorded)
    found = identify_with(e, NULL_HYPOTHESIS, nuisance(e))
    base = HypothesisFit((), found, Projection(found))
    options = fault_options(found)
    prices = Prices(options)
    scores = option_scores(found, base.projection, options)
    coarse = max(prices.promise(s, scales_of(s.option), prices.of(s.option)) for s in scores)
    first = promising(prices, base, scores, 4)[0]
    assert identity(first.option) == ("sensor.T45.scale",) and onset(first.option) == 2 * 60 + at
    trial = attempt([first.option], found, nuisance(e))
    assert trial.converged and first.gain > coarse
    assert first.gain == pytest.approx(prices.evidence(trial) - prices.evidence(base), rel=0.05)


@pytest.mark.slow
def test_a_member_that_is_not_needed_is_dropped():
    e = evidence(flights(carried(REYNOLDS), np.random.default_rng(22)))
    search = Search(e, library())
    search.run()
    stepwise = Stepwise(search, None)
    sets = stepwise.sets
    search.refit([(option("reynolds_efficiency@hpc"), option("handling_bleed@booster"))])
    beam = [t for t in sets.likeliest() if len(t.options) == 2]
    search.fitted.pop("reynolds_efficiency@hpc", None)
    (dropped,) = [s for s in stepwise._proposed(beam, (), -np.inf) if len(s) == 1]
    assert [o.label for o in dropped] == ["reynolds_efficiency@hpc"]


@pytest.mark.slow
def test_an_unlisted_effect_is_one_law_and_not_several_listed_effects():
    recorded = flights(carried(CLEARANCE), np.random.default_rng(3))
    a = Search(evidence(recorded), library(CLEARANCE[0], "turbine_tip_clearance")).run()
    assert a.status == FORMULA and a.unexplained == 0.0
    assert len(a.explanations[0].options) == 1 and a.law.places[0][0].name == "hpt.efficiency"
    assert {v.name for (group,), _ in a.law.drivers[:1] for v in group} >= {"ambient_pressure"}


@cache
def fault_beside_unlisted():
    recorded = stepped(flights(carried(CLEARANCE), np.random.default_rng(24)), "T3_K", 0.004, 2)
    search = Search(evidence(recorded), library(CLEARANCE[0], "turbine_tip_clearance"))
    return search, search.run()


@cache
def in_part_alone():
    """What would be told of it if no law could be."""
    search, a = fault_beside_unlisted()
    part = in_part(Stepwise(search, a.cells[0]))
    return replace(a, explanations=(part.explanation,), unexplained=part.unexplained, rest=part.cells)


@pytest.mark.slow
def test_a_fault_beside_an_unlisted_effect_is_named_with_a_law():
    _, a = fault_beside_unlisted()
    assert a.status == IDENTIFIED and a.unexplained == 0.0 and a.kind == "law + sensor fault"
    fault, law = sorted(a.explanations[0].options, key=lambda o: o.kind == OF_A_LAW)
    assert fault.target.name == "sensor.T3.scale" and law.component == "hpt"


@pytest.mark.slow
def test_a_fault_beside_an_unlisted_effect_is_named_in_part_where_no_law_can_be():
    a = in_part_alone()
    assert a.status == IDENTIFIED and a.in_part and a.kind == "sensor fault"
    assert names(a.explanations[0]) == {("sensor.T3.scale",)}
    (c,) = a.explanations[0].coefficients
    assert abs(c.value - 0.004) < 4.0 * c.standard_error


@pytest.mark.slow
def test_of_a_name_in_part_the_rest_is_told_with_its_share_and_its_driver():
    a = in_part_alone()
    assert 0.05 < a.unexplained < 0.95 and a.rest[0].driver.driver == AMBIENT_PRESSURE
    (told,) = rest_sentences(a)
    assert f"{100 * a.unexplained:.0f} % of it" in told and "part of the mismatch" in told
    assert AMBIENT_PRESSURE.words in told and residual_share_words(a) == ""


@pytest.mark.slow
def test_a_name_that_explains_all_says_that_nothing_stays():
    a = three_causes()
    assert list(rest_sentences(a)) == [] and residual_share_words(a) == "; nothing of its excess stays unexplained"
    assert "12 % of its excess" in residual_share_words(replace(a, unexplained=0.12))


def test_a_free_curve_takes_what_a_listed_effect_would(base):
    search = Search(base.found.evidence, library())
    search.look_from(base)
    offers = Unlisted(Prices(search.library), search.along_drivers)(base)
    best = max(offers, key=lambda o: o.gain)
    assert best.option.component == "hpc" and best.gain > 0.0
    assert all(d.sigma > 0.0 for d in best.option.hypothesis.discrepancies)
    assert free_option.__doc__
