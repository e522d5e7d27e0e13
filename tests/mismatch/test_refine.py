"""Refinement: what is fitted, how unseen flights judge it, and when it is refused."""

from __future__ import annotations

import numpy as np
import pytest
from refine_flights import engine, evidence, flights, library

from enginediag_cli.mismatch.fit.identified import nuisance
from enginediag_cli.mismatch.refine.criteria import Prediction, Records, Significance, Verdict
from enginediag_cli.mismatch.refine.refine import fit_both, last_flights, refine, still_missing
from enginediag_cli.mismatch.refine.switch import find_switch


@pytest.fixture(scope="module")
def thin_air():
    return evidence(flights("reynolds_efficiency@hpc", {"exponent": 0.1}, seed=1)[0])


@pytest.fixture(scope="module")
def refined(thin_air):
    return refine(thin_air, last_flights(thin_air.flights, 2), library("reynolds_efficiency@hpc"))


def test_the_true_effect_is_fitted_and_unseen_flights_gain(refined):
    assert refined.verdict is Verdict.ACCEPTED and refined.failed == ""
    value = refined.effects[0].values["exponent"]
    assert abs(value - 0.1) < 3 * refined.standard_errors["reynolds_efficiency.hpc.exponent"]
    assert refined.unseen.gain > 0 and (refined.unseen.flight_gains > 0).all()
    assert refined.unseen.chi2_after < 1.16  # 720 readings, three standard deviations
    assert refined.unseen.chi2_after < refined.unseen.chi2_before


def test_unseen_flights_ask_for_all_of_a_right_change(refined):
    significant, better = refined.criteria
    assert isinstance(significant, Significance) and isinstance(better, Prediction)
    assert significant.p < 1e-6 and better.of is Records.ALL
    assert abs(better.share - 1.0) < 3 * better.standard_error and better.fall > 0
    assert refined.unseen.labels == ("flight 6", "flight 7")


def test_a_refined_model_leaves_nothing_that_stands_out(refined):
    assert refined.still_missing == ""


def test_the_wrong_effect_leaves_the_right_one_to_be_seen(thin_air):
    wrong = fit_both(thin_air, library("power_offtake@hp"), nuisance(thin_air))[1]
    assert wrong.converged and "hpc" in still_missing(wrong)


def test_an_effect_that_is_not_there_is_refused():
    healthy = evidence(flights("", {}, seed=3)[0])
    found = refine(healthy, last_flights(healthy.flights, 2), library("power_offtake@hp"))
    assert found.verdict is Verdict.REFUSED


def test_a_coefficient_at_its_bound_is_refused():
    # thin air only ever adds losses
    given = flights("reynolds_efficiency@hpc", {"exponent": -0.1}, seed=2)[0]
    found = refine(evidence(given), [5, 6], library("reynolds_efficiency@hpc"))
    assert "ends at a physical bound" in found.failed and found.unseen is None


def test_an_engine_without_flights_to_fit_is_refused(thin_air):
    with pytest.raises(ValueError, match="no flight is left to fit"):
        refine(thin_air, range(len(thin_air.flights)), library("reynolds_efficiency@hpc"))
    with pytest.raises(ValueError, match="no flight is left to judge"):
        refine(thin_air, [], library("reynolds_efficiency@hpc"))


@pytest.mark.slow
def test_a_switch_that_no_column_records_is_carried_and_its_states_are_found_on_unseen_flights():
    given, states = flights("customer_bleed@hpc", {"fraction": 0.02}, seed=4, switch=0.08)
    case = evidence(given)
    training = case.only(list(range(5)))
    (bleed,) = library("customer_bleed@hpc")
    finding = find_switch(training, bleed)
    assert finding is not None and finding.is_switch
    found = refine(case, [5, 6], [bleed], hidden=finding)
    assert found.verdict is Verdict.ACCEPTED
    assert {c.of for c in found.criteria if isinstance(c, Prediction)} == {Records.ON, Records.CONTRAST}
    assert found.effects[0].switch == "customer_bleed_hpc_on"
    inferred = np.concatenate([f.columns["customer_bleed_hpc_on"] for f in found.flights])
    # signal-to-noise per record is above 4: at least 95 of 100 states right
    assert np.mean(inferred[200:] == states[200:]) >= 0.95
    assert abs(found.effects[0].values["fraction"] - 0.02) < 0.0015
    assert set(found.unseen.states) == {"on", "off"}
    before, after = found.unseen.states["on"]
    assert np.mean([q.chi2 for q in after]) < 1.2 < np.mean([q.chi2 for q in before])
    assert found.alarms_after.alarms <= found.alarms_before.alarms


def test_flights_in_which_a_switch_is_never_on_cannot_judge_it():
    given, _ = flights("customer_bleed@hpc", {"fraction": 0.02}, count=5, seed=4, switch=0.08)
    off, _ = flights("", {}, count=7, seed=4)
    case = evidence(given + off[5:])
    (bleed,) = library("customer_bleed@hpc")
    found = refine(case, [5, 6], [bleed], hidden=find_switch(case.only(list(range(5))), bleed))
    assert found.verdict is Verdict.NOT_JUDGED
    assert [c.met for c in found.criteria] == [True, None, None]


def test_a_switched_effect_is_absent_where_it_is_off():
    from dataclasses import replace

    e = engine()
    (bleed,) = library("customer_bleed@hpc")
    switched = e.replace_effects([replace(bleed, values={"fraction": 0.02}, switch="valve")])
    always = e.replace_effects([replace(bleed, values={"fraction": 0.02})])
    u = {
        "altitude_m": np.array([0.0, 5000.0]),
        "mach": np.array([0.2, 0.5]),
        "dT_isa_K": np.zeros(2),
        "Wf_kg_s": np.array([2.0, 1.4]),
    }
    off, on = (switched.predict({**u, "valve": np.full(2, x)}).y for x in (0.0, 1.0))
    # other starts of the solver change the last digits
    np.testing.assert_allclose(off, e.predict(u).y, rtol=1e-11)
    np.testing.assert_allclose(off, switched.predict(u).y, rtol=1e-11)
    np.testing.assert_allclose(on, always.predict(u).y, rtol=1e-11)
